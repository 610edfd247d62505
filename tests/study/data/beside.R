# What R says of published data and of comparisons.csv: the values in beside.json. The first line of
# each name is the function of R. Run as: Rscript beside.R > beside.json, in this folder.
suppressMessages({
  library(lme4); library(lmerTest); library(emmeans); library(afex); library(car)
  library(ordinal); library(psyphy); library(BayesFactor)
})
emm_options(lmer.df = "satterthwaite")
line <- function(name, ...) {
  values <- sprintf("%.10g", unlist(list(...)))
  cat(sprintf('  "%s": [%s],\n', name, paste(values, collapse = ", ")))
}
cat("{\n")

# Maxwell and Delaney (1990), table 12.1: reaction times, two factors within participants
m <- afex::md_12.1
write.csv(m, "reactions.csv", row.names = FALSE, quote = FALSE)
for (n in c("id", "noise", "angle")) m[[n]] <- factor(m[[n]])
a <- anova(aov_ez("id", "rt", m, within = c("noise", "angle")), correction = "HF")
for (n in rownames(a)) line(paste("afex", n), a[n, "F"], a[n, "Pr(>F)"], a[n, "num Df"], a[n, "den Df"])
r <- summary(aov(rt ~ noise * angle + Error(id / (noise * angle)), m))
r <- r[["Error: id:angle"]][[1]]
line("aov angle, uncorrected", r[["F value"]][1], r[["Pr(>F)"]][1], r$Df)
l <- lmer(rt ~ angle + (1 | id), aggregate(rt ~ id + angle, m, mean),
  contrasts = list(angle = "contr.sum"))
line("lmer angle, one judgement a cell", unlist(anova(l)["angle", c("F value", "Pr(>F)", "NumDF", "DenDF")]))
p <- as.data.frame(summary(pairs(emmeans(l, ~angle)), infer = TRUE))
for (i in seq_len(nrow(p))) {
  line(paste("emmeans", gsub("angle", "", p$contrast[i])), p$estimate[i], p$lower.CL[i], p$upper.CL[i],
    p$p.value[i], p$df[i])
}
line("lmer angle, logLik by REML", logLik(l))
w <- tapply(m$rt, list(m$id, m$angle), mean)
for (pair in list(c("0", "4"), c("0", "8"), c("4", "8"))) {
  t <- t.test(w[, pair[1]], w[, pair[2]], paired = TRUE)
  error <- t$estimate / t$statistic
  reach <- qtukey(0.95, 3, t$parameter) / sqrt(2) * error
  line(paste("ptukey", paste(pair, collapse = " - ")), t$estimate, t$estimate - reach, t$estimate + reach,
    ptukey(abs(t$statistic) * sqrt(2), 3, t$parameter, lower.tail = FALSE))
  b <- ttestBF(w[, pair[1]], w[, pair[2]], paired = TRUE, rscale = sqrt(2) / 2)
  line(paste("ttestBF", paste(pair, collapse = " - ")), 1 / extractBF(b)$bf)
}

# O'Brien and Kaiser (1985), Psychological Bulletin 97, 316-333: groups of 5, 4 and 7
o <- afex::obk.long
write.csv(o, "treatments.csv", row.names = FALSE, quote = FALSE)
for (n in c("id", "treatment", "phase", "hour")) o[[n]] <- factor(o[[n]])
f <- suppressMessages(aov_ez("id", "value", o, between = "treatment", within = "phase",
  fun_aggregate = mean, type = 2))
a <- anova(f, correction = "HF")
for (n in c("treatment", "treatment:phase")) {
  line(paste("afex", n), a[n, "F"], a[n, "Pr(>F)"], a[n, "num Df"], a[n, "den Df"])
}
line("afex phase, epsilons of Geisser, and of Huynh and Feldt",
  suppressWarnings(summary(f))$pval.adjustments["phase", c("GG eps", "HF eps")])
level <- aggregate(value ~ id + treatment, o, mean)
h <- TukeyHSD(aov(value ~ treatment, level))$treatment
for (i in seq_len(nrow(h))) line(paste("TukeyHSD", rownames(h)[i]), h[i, "diff"], h[i, "lwr"], h[i, "upr"], h[i, "p adj"])
# all judgements as if they were independent, unbalanced: the sums of squares of type II
f <- lm(value ~ treatment * phase, o)
a <- Anova(f, type = 2)
for (n in rownames(a)[1:3]) line(paste("Anova of lm", n), a[n, "F value"], a[n, "Pr(>F)"], a[n, "Df"], a["Residuals", "Df"])
p <- as.data.frame(summary(suppressMessages(pairs(emmeans(f, ~treatment))), infer = TRUE))
for (i in seq_len(nrow(p))) line(paste("emmeans of lm", p$contrast[i]), p$estimate[i], p$lower.CL[i], p$upper.CL[i], p$p.value[i])

# Randall (1989), J. Sensory Studies 4, 13-36: nine judges rate the bitterness of wine
w <- ordinal::wine
write.csv(w[c("rating", "temp", "contact", "judge")], "wine.csv", row.names = FALSE, quote = FALSE)
f <- clm(rating ~ temp + contact, data = w)
s <- coef(summary(f))
for (n in c("tempwarm", "contactyes")) line(paste("clm", n), s[n, 1:2])
line("clm, logLik", logLik(f))
f <- clm(rating ~ temp + judge, data = w)
line("clm tempwarm, level of each judge", coef(summary(f))["tempwarm", 1:2])
f <- clmm(rating ~ temp + (1 | judge), data = w, nAGQ = 25, control = clmm.control(gradTol = 1e-8))
line("clmm tempwarm", coef(summary(f))["tempwarm", 1])
f <- clmm(rating ~ temp + contact + (1 | judge), data = w, nAGQ = 25, control = clmm.control(gradTol = 1e-8))
line("clmm tempwarm, contactyes", coef(summary(f))[c("tempwarm", "contactyes"), 1])
line("clmm, logLik", logLik(f))
f <- glmer(I(rating > 2) ~ temp + (1 | judge), w, binomial, nAGQ = 25)
line("glmer tempwarm of two categories", fixef(f)[["tempwarm"]])

# participants of comparisons.csv, and one who lapses; one lapse rate for both ends of the curve
d <- read.csv("comparisons.csv")
d$x <- log(d$height_um / 50)
lapsed <- data.frame(x = log(c(25, 32, 40, 45, 55, 62, 75, 90) / 50), hits = c(3, 2, 9, 14, 24, 33, 37, 37), totals = 40)
for (who in c("2", "3", "7", "who lapses")) {
  p <- if (who == "who lapses") lapsed else subset(d, participant == who)
  fit <- function(lapse) suppressWarnings(glm(cbind(hits, totals - hits) ~ x, binomial(probit.2asym(lapse, lapse)), p,
    start = c(0, 5), control = list(epsilon = 1e-14, maxit = 200)))
  lost <- function(lapse) deviance(fit(lapse))
  best <- optimize(lost, c(0, 0.1), tol = 1e-10)$minimum
  if (lost(0) <= lost(best)) best <- 0
  b <- unname(coef(fit(best)))
  line(paste("psyphy participant", who), -b[1] / b[2], 1 / b[2], best, lost(best))
  # the ends of a profile likelihood, by nothing but optim and uniroot
  loss <- function(middle, logspread, lapse) {
    q <- lapse + (1 - 2 * lapse) * pnorm((p$x - middle) / exp(logspread))
    q <- pmin(pmax(q, 1e-15), 1 - 1e-15)
    -2 * sum(dbinom(p$hits, p$totals, q, log = TRUE))
  }
  start <- c(-b[1] / b[2], log(1 / b[2]), max(best, 1e-3))
  least <- function(place, value) {
    left <- setdiff(1:3, place)
    min(sapply(c(1e-6, 0.02, 0.05), function(rate) {
      s <- start; s[3] <- rate
      optim(s[left], function(at) { x <- numeric(3); x[place] <- value; x[left] <- at; do.call(loss, as.list(x)) },
        method = "L-BFGS-B", lower = c(-3, -8, 0)[left], upper = c(3, 4, 0.1)[left],
        control = list(factr = 10, pgtol = 0))$value
    }))
  }
  bottom <- min(least(1, start[1]), least(2, start[2]), do.call(loss, as.list(replace(start, 3, best))))
  ends <- function(place) sapply(c(-1, 1), function(side) uniroot(function(v) least(place, v) - bottom - qchisq(0.95, 1),
    sort(c(start[place], start[place] + side * c(0.5, 1.2)[place])), tol = 1e-9)$root)
  line(paste("optim participant", who), ends(1), ends(2))
}

# the group of comparisons.csv. glmer: intercepts and slopes normal over participants
g <- glmer(cbind(hits, totals - hits) ~ x + (x | participant), d, binomial("probit"))
b <- fixef(g)
line("glmer probit, threshold, spread", -b[1] / b[2], 1 / b[2])
v <- as.matrix(vcov(g))
slope <- c(-1 / b[2], b[1] / b[2]^2)
line("glmer probit, standard errors of threshold and ln(spread)", sqrt(sum(slope * (v %*% slope))),
  sqrt(v[2, 2]) / b[2])
# thresholds and ln(spread) normal over participants, without lapses: quadrature and nlminb of R
z <- seq(-5, 5, length.out = 41)
w <- dnorm(z) / sum(dnorm(z))
loss <- function(at) {
  grid <- expand.grid(middle = at[1] + exp(at[2]) * z, spread = at[3] + exp(at[4]) * z)
  weight <- as.vector(outer(w, w))
  -sum(sapply(split(d, d$participant), function(p) {
    q <- pnorm(outer(p$x, grid$middle, "-") / rep(exp(grid$spread), each = nrow(p)))
    log(sum(weight * exp(colSums(matrix(dbinom(p$hits, p$totals, q, log = TRUE), nrow(p))))))
  }))
}
n <- nlminb(c(0.05, -2, -1.6, -1), loss, control = list(rel.tol = 1e-12))
line("nlminb means and standard deviations of thresholds and ln(spread)", n$par[1], exp(n$par[2]), n$par[3], exp(n$par[4]))
people <- length(unique(d$participant))
limit <- people * log1p(qt(0.975, people - 1)^2 / (people - 1))
ends <- function(place, reach) sapply(c(-1, 1), function(side) uniroot(function(v) {
  s <- n$par; s[place] <- v
  k <- nlminb(s[-place], function(at) loss(append(at, v, place - 1)), control = list(rel.tol = 1e-12))
  2 * (k$objective - n$objective) - limit
}, sort(c(n$par[place], n$par[place] + side * reach)), tol = 1e-6)$root)
line("nlminb ends of the mean threshold", ends(1, 0.4))
line("nlminb ends of the mean ln(spread)", ends(3, 0.9))

versions <- sapply(c("lme4", "lmerTest", "emmeans", "afex", "car", "ordinal", "psyphy", "BayesFactor"), function(n)
  paste(n, packageVersion(n)))
cat(sprintf('  "origin": "%s; %s"\n}\n', R.version.string, paste(versions, collapse = ", ")))
