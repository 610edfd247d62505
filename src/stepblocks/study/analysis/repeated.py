"""What participants' own differences say, whatever their variances and correlations."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import integrate, linalg, optimize, stats

from stepblocks.contact import Array
from stepblocks.files.tables import Table
from stepblocks.study.analysis.anova import Interval, Term, make_term, make_tukey_interval

_FAR = 20.0  # from t, how far its noncentrality is sought [1]
_TINY = 1e-300  # keeps a quotient of variances that vanish finite


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
        Mauchly's W, and the probability of one as small if all variances are equal; not-a-number
        where there is one contrast, or more contrasts than degrees of freedom.
    """

    epsilon: float
    huynh_feldt: float
    statistic: float
    p: float


class CorrectedTest(NamedTuple):
    """A test whose degrees of freedom are multiplied by an epsilon, with that epsilon."""

    term: Term
    sphericity: Sphericity


class _Mauchly(NamedTuple):
    """Mauchly's test of sphericity: W [1] and its probability."""

    statistic: float
    p: float


def tabulate_participant_means(data: Table) -> Table:
    """Return the mean of ``value`` of each participant (rows) in each condition (columns)."""
    # what a block adds is taken off first, so that a missing judgement moves no mean
    if "stimulus" in data:
        without_block = data["value"] - data.groupby("stimulus")["value"].transform("mean")
        data = data.assign(value=without_block + data["value"].mean())
    return data.groupby(["participant", "condition"])["value"].mean().unstack()


def assess_contrast_effect(
    term_name: str, participant_means: Array, contrasts: Array, participant_groups: ArrayLike = ""
) -> CorrectedTest:
    """Test orthonormal contrasts of participants' means, corrected for sphericity.

    Of participants of several groups, test whether the groups differ.

    Parameters
    ----------
    term_name : str
        Of the term.
    participant_means : ndarray, shape (participants, conditions)
        Means of the participants.
    contrasts : ndarray, shape (q, conditions)
        Orthonormal rows.
    participant_groups : array_like, shape (participants,), optional
        Group of each participant.

    Returns
    -------
    CorrectedTest
        With the degrees of freedom multiplied by Huynh and Feldt's epsilon. Geisser's epsilon alone
        is too small where variances are alike: of studies of ten participants without an effect,
        3 to 4 % then claim one.

    References
    ----------
    Huynh, H., Feldt, L. S. (1976), J. Educational Statistics 1, 69-82,
    doi:10.3102/10769986001001069; of groups Lecoutre, B. (1991), ibid. 16, 371-372,
    doi:10.3102/10769986016004371.
    """
    values = participant_means @ contrasts.T
    people, q = values.shape
    index = np.unique(np.broadcast_to(participant_groups, people), return_inverse=True)[1]
    groups = int(index.max()) + 1
    member = np.eye(groups)[index]
    freedom = people - groups
    means = member @ np.linalg.pinv(member) @ values
    residuals = values - means
    covariance = residuals.T @ residuals / freedom
    sphericity = _assess_sphericity(covariance, freedom)
    trace = float(np.trace(covariance))
    explained = means
    if groups > 1:
        explained = means - means.mean(axis=0)
    rank = max(groups - 1, 1)
    f = float((explained**2).sum()) / rank / max(trace, _TINY)
    df = q * sphericity.huynh_feldt
    return CorrectedTest(make_term(term_name, rank * df, freedom * df, math.nan, f), sphericity)


def _assess_sphericity(covariance: Array, dof: int) -> Sphericity:
    """Return both epsilons and Mauchly's test.

    `covariance`, shape (q, q), is that of orthonormal contrasts with `dof` degrees of freedom.
    """
    q = len(covariance)
    trace = float(np.trace(covariance))
    epsilon = trace**2 / (q * max(float((covariance * covariance).sum()), _TINY))
    unbiased = ((dof + 1.0) * q * epsilon - 2.0) / (q * max(dof - q * epsilon, _TINY))
    huynh_feldt = float(np.clip(unbiased, epsilon, 1.0))
    mauchly = _compute_mauchly_test(covariance, dof)
    return Sphericity(epsilon, huynh_feldt, mauchly.statistic, mauchly.p)


def _compute_mauchly_test(covariance: Array, dof: int) -> _Mauchly:
    """Compute Mauchly's test of whether a covariance, shape (q, q), is a multiple of the identity.

    Mauchly, J. W. (1940), doi:10.1214/aoms/1177731915.
    """
    q = len(covariance)
    if q < 2 or q > dof:
        return _Mauchly(math.nan, math.nan)
    statistic = float(np.linalg.det(covariance / (float(np.trace(covariance)) / q)))
    scale = dof - (2.0 * q * q + q + 2.0) / (6.0 * q)
    chi_squared = -scale * math.log(max(statistic, _TINY))
    return _Mauchly(statistic, float(stats.chi2.sf(chi_squared, q * (q + 1) / 2.0 - 1.0)))


def iterate_factor_tests(
    participant_means: Table, levels: Mapping[str, Sequence[str]]
) -> Iterator[Term]:
    """Test every factor and interaction of a table whose columns cross all levels, in order.

    Parameters
    ----------
    participant_means : DataFrame
        Means of the participants (rows) in each condition (columns).
    levels : mapping of sequence of str
        Levels of each factor; those of the last vary fastest over the columns.
    """
    for size in range(1, len(levels) + 1):
        for chosen in itertools.combinations(levels, size):
            contrasts = _build_interaction_contrasts(levels, chosen)
            yield assess_contrast_effect(
                ":".join(chosen), participant_means.to_numpy(), contrasts
            ).term


def _build_interaction_contrasts(
    levels: Mapping[str, Sequence[str]], chosen_factors: Sequence[str]
) -> Array:
    """Return the contrasts of an interaction of the chosen factors, averaged over the others."""
    contrasts: Array = np.ones((1, 1))
    for name, values in levels.items():
        helmert = linalg.helmert(len(values), full=True)  # its first row is the mean
        rows = helmert[1:] if name in chosen_factors else helmert[:1]
        contrasts = np.asarray(np.kron(contrasts, rows), dtype=np.float64)
    return contrasts


def compare_conditions_within_participants(table: Table) -> tuple[Interval, ...]:
    """Compare every two columns by the participants' own differences.

    Intervals hold together after Games, P. A., Howell, J. F. (1976), J. Educational Statistics 1,
    113-125, doi:10.3102/10769986001002113. Pairs in which no participant differs from the others
    are left out.
    """
    found = []
    for first, second in itertools.combinations(table.columns, 2):
        differences = (table[first] - table[second]).dropna()
        if len(differences) < 2 or not float(np.ptp(differences)) > 0.0:
            continue
        mean = float(differences.mean())
        spread = float(differences.std())
        found.append(
            make_tukey_interval(
                first,
                second,
                mean,
                spread / math.sqrt(len(differences)),
                len(differences) - 1.0,
                levels=table.shape[1],
                effect_size=mean / spread,
            )
        )
    return tuple(found)


def compute_null_bayes_factor(t_statistic: float, participant_count: float) -> float:
    """Return the Bayes factor for no difference, from Student's t of paired differences.

    The effect size under a difference has a Cauchy prior of scale 0.707: Rouder et al. (2009),
    Psychonomic Bulletin & Review 16, 225-237, doi:10.3758/PBR.16.2.225.
    """
    df = participant_count - 1.0

    def compute_weighted_likelihood(effect_variance: float) -> float:
        """Return the likelihood of t times the prior of the variance g of the effect size."""
        wide = 1.0 + 0.5 * participant_count * effect_variance
        log = -0.5 * math.log(wide) - 0.5 * (df + 1.0) * math.log1p(
            t_statistic * t_statistic / (wide * df)
        )
        return math.exp(log - 1.5 * math.log(effect_variance) - 0.5 / effect_variance) / math.sqrt(
            2.0 * math.pi
        )

    null = math.exp(-0.5 * (df + 1.0) * math.log1p(t_statistic * t_statistic / df))
    alternative, _ = integrate.quad(compute_weighted_likelihood, 0.0, math.inf)
    return null / float(alternative)


def compute_effect_size_interval(
    t_statistic: float, participant_count: float
) -> tuple[float, float]:
    """Return the 95 % interval of d, the mean over the standard deviation of differences [1].

    By the noncentral t distribution: Steiger, J. H., Fouladi, R. T. (1997), Noncentrality interval
    estimation and the evaluation of statistical models.
    """
    df, scale = participant_count - 1.0, math.sqrt(participant_count)
    reach = abs(t_statistic) + _FAR

    def compute_probability_below(delta: float) -> float:
        """Return the probability of less than t under a noncentrality; 0 or 1 far off."""
        found = float(stats.nct.cdf(t_statistic, df, delta))
        if math.isnan(found):
            return float(delta < t_statistic)
        return found

    def find_noncentrality(probability: float) -> float:
        """Find the noncentrality under which less than t has a probability."""
        return float(
            optimize.brentq(
                lambda delta: compute_probability_below(delta) - probability,
                t_statistic - reach,
                t_statistic + reach,
            )
        )

    return find_noncentrality(0.975) / scale, find_noncentrality(0.025) / scale


def approximate_null_bayes_factor(term: Term) -> float:
    """Return the approximate Bayes factor for no effect, from an F within participants.

    By the Bayesian information criterion: Masson, M. E. J. (2011), Behavior Research Methods 43,
    679-690, doi:10.3758/s13428-010-0049-5. Each participant's own mean takes one observation.
    """
    observations = term.df + term.df_error
    gain = observations * math.log1p(term.f * term.df / term.df_error)
    return math.exp(0.5 * (term.df * math.log(observations) - gain))
