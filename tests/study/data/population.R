# What R says of comparisons.csv and of accuracy.csv with cells missing: the values in
# population.json. Run as: Rscript population.R > population.json, in this folder.
suppressMessages({library(lme4); library(lmerTest); library(emmeans); library(afex)})
line <- function(name, ...) {
  values <- sprintf("%.10g", unlist(list(...)))
  cat(sprintf('  "%s": [%s],\n', name, paste(values, collapse = ", ")))
}
cat("{\n")
d <- read.csv("comparisons.csv")
d$x <- log(d$height_um / 50)
g <- glmer(cbind(hits, totals - hits) ~ x + (1 | participant), d, binomial("probit"), nAGQ = 25)
b <- fixef(g)
line("glmer threshold, spread, sd of thresholds", -b[1] / b[2], 1 / b[2], sqrt(VarCorr(g)[[1]][1]) / b[2])
line("glmer log likelihood", logLik(g))
p <- glm(cbind(hits, totals - hits) ~ x, binomial("probit"), subset(d, participant == 3))
line("glm threshold, spread, deviance", -coef(p)[1] / coef(p)[2], 1 / coef(p)[2], deviance(p))
d <- read.csv("accuracy.csv")
d$row <- seq_len(nrow(d)) - 1
for (n in c("participant", "group", "condition", "stimulus")) d[[n]] <- factor(d[[n]])
d$y <- abs(d$estimate_um - d$height_um)
w <- afex::aov_ez("participant", "y", d, within = "condition", fun_aggregate = mean)
s <- summary(w)
line("Mauchly W, p", s$sphericity.tests[1, ])
line("Greenhouse and Geisser epsilon, p", s$pval.adjustments[1, 1:2])
line("Huynh and Feldt epsilon, p", s$pval.adjustments[1, 3:4])
d$y <- d$estimate_um - d$height_um
u <- subset(d, (row * 7919) %% 10 >= 2 & !(participant == "3" & condition == "soft"))
m <- lmer(y ~ condition * stimulus + (1 | participant) + (1 | participant:condition), u)
v <- anova(m, type = 3)["condition", ]
line("unbalanced mixed F", v[["F value"]], v[["Pr(>F)"]], v$NumDF, v$DenDF)
v <- as.data.frame(VarCorr(m))
line("unbalanced standard deviations", v$sdcor)
e <- as.data.frame(summary(pairs(emmeans(m, ~condition, lmer.df = "satterthwaite"), adjust = "none"), infer = TRUE))
for (i in seq_len(nrow(e))) line(paste("unbalanced pair", e$contrast[i]), e$estimate[i], e$lower.CL[i], e$upper.CL[i], e$p.value[i], e$df[i])
cat(sprintf('  "origin": "%s; lme4 %s, lmerTest %s, emmeans %s, afex %s"\n}\n', R.version.string,
  packageVersion("lme4"), packageVersion("lmerTest"), packageVersion("emmeans"), packageVersion("afex")))
