"""What participants' own differences say, whatever their variances and correlations."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import integrate, linalg, stats

from stepblocks.study import Array, Table
from stepblocks.study.analysis.anova import Interval, Term, make_interval, make_term


@dataclass(frozen=True)
class Sphericity:
    """How equal the variances of the differences between conditions are.

    Attributes
    ----------
    epsilon : float
        Greenhouse and Geisser's; 1 where all variances are equal [1].
    huynh_feldt : float
        Huynh and Feldt's, at most 1, by which degrees of freedom are multiplied [1].
    statistic, p : float
        Mauchly's W, and the probability of one as small if all variances are equal.
    """

    epsilon: float
    huynh_feldt: float
    statistic: float
    p: float


def average_participants(data: Table) -> Table:
    """Return the mean of ``value`` of each participant (rows) in each condition (columns)."""
    # what a block adds is taken off first, so that a missing judgement moves no mean
    if "stimulus" in data:
        own = data["value"] - data.groupby("stimulus")["value"].transform("mean")
        data = data.assign(value=own + data["value"].mean())
    return data.groupby(["participant", "condition"])["value"].mean().unstack()


def assess_effect(
    name: str, table: Array, contrasts: Array, group: ArrayLike = ""
) -> tuple[Term, Sphericity]:
    """Test orthonormal contrasts of participants' means, corrected for sphericity.

    Of participants of several groups, test whether the groups differ.
    """
    # Geisser's epsilon alone is too small where variances are alike: of studies of ten participants
    # without an effect, 3 to 4 % then claim one. Huynh, H., Feldt, L. S. (1976), J. Educational
    # Statistics 1, 69-82, doi:10.3102/10769986001001069; of groups Lecoutre, B. (1991), ibid. 16,
    # 371-372, doi:10.3102/10769986016004371. The test of sphericity is Mauchly's (1940),
    # doi:10.1214/aoms/1177731915.
    own = table @ contrasts.T
    people, q = own.shape
    index = np.unique(np.broadcast_to(group, people), return_inverse=True)[1]
    groups = int(index.max()) + 1
    member = np.eye(groups)[index]
    rank = max(groups - 1, 1)
    freedom = people - groups
    means = member @ np.linalg.pinv(member) @ own
    apart = own - means
    spread = apart.T @ apart / freedom
    trace = float(np.trace(spread))
    epsilon = trace**2 / (q * max(float((spread * spread).sum()), 1e-300))
    less = ((freedom + 1.0) * q * epsilon - 2.0) / (q * max(freedom - q * epsilon, 1e-300))
    statistic = p = math.nan
    if 1 < q <= freedom:
        statistic = float(np.linalg.det(spread / (trace / q)))
        scale = freedom - (2.0 * q * q + q + 2.0) / (6.0 * q)
        p = float(stats.chi2.sf(-scale * math.log(max(statistic, 1e-300)), q * (q + 1) / 2.0 - 1.0))
    sphericity = Sphericity(epsilon, float(np.clip(less, epsilon, 1.0)), statistic, p)
    df = q * sphericity.huynh_feldt
    explained = means - means.mean(axis=0) if groups > 1 else means
    f = float((explained**2).sum()) / rank / max(trace, 1e-300)
    return make_term(name, rank * df, freedom * df, math.nan, f), sphericity


def assess_factors(table: Table, levels: Mapping[str, Sequence[str]]) -> Iterator[Term]:
    """Test every factor and interaction of a table whose columns cross all levels, in order."""
    for size in range(1, len(levels) + 1):
        for chosen in itertools.combinations(levels, size):
            contrasts = np.ones((1, 1))
            for name, values in levels.items():
                # the first row of the whole matrix is the mean
                whole = linalg.helmert(len(values), full=True)
                contrasts = np.kron(contrasts, whole[1:] if name in chosen else whole[:1])
            yield assess_effect(":".join(chosen), table.to_numpy(), contrasts)[0]


def compare_participants(table: Table) -> tuple[Interval, ...]:
    """Compare every two columns by the participants' own differences.

    Intervals hold together after Games, P. A., Howell, J. F. (1976), J. Educational Statistics 1,
    113-125, doi:10.3102/10769986001002113.
    """
    found = []
    for first, second in itertools.combinations(table.columns, 2):
        apart = (table[first] - table[second]).dropna()
        if len(apart) > 1 and float(np.ptp(apart)) > 0.0:
            spread = float(apart.std())
            error, effect = spread / math.sqrt(len(apart)), float(apart.mean()) / spread
            found.append(
                make_interval(
                    (first, second),
                    (float(apart.mean()), error),
                    len(apart) - 1.0,
                    table.shape[1],
                    effect,
                )
            )
    return tuple(found)


def compute_bayes_factor(t: float, people: float) -> float:
    """Return how many times likelier Student's t of paired differences is under no difference.

    The effect size under a difference has a Cauchy prior of scale 0.707: Rouder et al. (2009),
    Psychonomic Bulletin & Review 16, 225-237, doi:10.3758/PBR.16.2.225.
    """
    df = people - 1.0

    def weigh(g: float) -> float:
        wide = 1.0 + 0.5 * people * g
        log = -0.5 * math.log(wide) - 0.5 * (df + 1.0) * math.log1p(t * t / (wide * df))
        return math.exp(log - 1.5 * math.log(g) - 0.5 / g) / math.sqrt(2.0 * math.pi)

    null = math.exp(-0.5 * (df + 1.0) * math.log1p(t * t / df))
    return null / float(integrate.quad(weigh, 0.0, math.inf)[0])


def approximate_bayes_factor(term: Term) -> float:
    """Return how many times likelier an F within participants is under no effect."""
    # By the Bayesian information criterion: Masson, M. E. J. (2011), Behavior Research Methods 43,
    # 679-690, doi:10.3758/s13428-010-0049-5. Each participant's own mean takes one observation.
    observations = term.df + term.df_error
    gain = observations * math.log1p(term.f * term.df / term.df_error)
    return math.exp(0.5 * (term.df * math.log(observations) - gain))
