# What R says of accuracy.csv: the values in accuracy.json. Run as: Rscript accuracy.R > accuracy.json, in this folder.
suppressMessages({library(lme4); library(lmerTest); library(emmeans); library(afex)})
emm_options(lmer.df = "satterthwaite")
d <- read.csv("accuracy.csv", colClasses = c(participant = "character", group = "character", condition = "character",
  stimulus = "character"))
for (n in c("participant", "group", "condition", "stimulus")) d[[n]] <- factor(d[[n]])
d$bias <- d$estimate_um - d$height_um
d$absolute <- abs(d$bias)
line <- function(name, ...) cat(sprintf('  "%s": [%s],\n', name, paste(sprintf("%.10g", unlist(list(...))), collapse = ", ")))
pairs_of <- function(name, fit) {
  e <- emmeans(fit, ~condition)
  p <- as.data.frame(summary(pairs(e), infer = TRUE))
  for (i in seq_len(nrow(p))) line(paste(name, p$contrast[i]), p$estimate[i], p$lower.CL[i], p$upper.CL[i], p$p.value[i], p$df[i])
  t <- as.data.frame(test(pairs(e), delta = 2, side = "equivalence", adjust = "none"))
  for (i in seq_len(nrow(t))) line(paste(name, "TOST", t$contrast[i]), t$t.ratio[i], t$p.value[i])
}
cat("{\n")
for (name in c("bias", "absolute")) {
  d$y <- d[[name]]
  a <- summary(aov(y ~ condition * stimulus, d))[[1]]
  line(paste(name, "F"), a[["F value"]][1], a[["Pr(>F)"]][1], a$Df[1], a$Df[4])
  h <- TukeyHSD(aov(y ~ condition * stimulus, d), "condition")$condition
  for (i in seq_len(nrow(h))) line(paste(name, "Tukey", rownames(h)[i]), h[i, "diff"], h[i, "lwr"], h[i, "upr"], h[i, "p adj"])
  m <- suppressMessages(lmer(y ~ condition * stimulus + (1 | participant) + (1 | participant:condition), d))
  v <- anova(m)["condition", ]
  line(paste(name, "mixed F"), v[["F value"]], v[["Pr(>F)"]], v$NumDF, v$DenDF)
  r <- summary(aov(y ~ condition * stimulus + Error(participant / condition), d))[["Error: participant:condition"]][[1]]
  line(paste(name, "repeated measures F"), r[["F value"]][1], r[["Pr(>F)"]][1], r$Df[1], r$Df[2])
  pairs_of(paste(name, "pair"), m)
}
cells <- aggregate(bias ~ participant + condition + stimulus, d, function(x) sum((x - mean(x))^2))
s <- aggregate(bias ~ participant + condition, cells, sum)
s$y <- 0.5 * log(s$bias / 8)  # four blocks of three judgements leave eight degrees of freedom
m <- lmer(y ~ condition + (1 | participant), s)
v <- anova(m)["condition", ]
line("spread mixed F", v[["F value"]], v[["Pr(>F)"]], v$NumDF, v$DenDF)
p <- as.data.frame(summary(pairs(emmeans(m, ~condition)), infer = TRUE))
for (i in seq_len(nrow(p))) line(paste("spread pair", p$contrast[i]), exp(p$estimate[i]), exp(p$lower.CL[i]), exp(p$upper.CL[i]), p$p.value[i])
g <- suppressMessages(anova(aov_ez("participant", "absolute", d, between = "group", within = "condition", type = 2,
  fun_aggregate = mean), correction = "HF"))
for (n in c("group", "group:condition")) line(paste("groups", n), g[n, "F"], g[n, "Pr(>F)"], g[n, "num Df"], g[n, "den Df"])
cat(sprintf('  "origin": "%s; lme4 %s, lmerTest %s, emmeans %s, afex %s"\n}\n', R.version.string, packageVersion("lme4"),
  packageVersion("lmerTest"), packageVersion("emmeans"), packageVersion("afex")))
