"""Psychometric functions of a group, in which every participant has a threshold and a spread."""

# The likelihood of each participant is computed once, on a grid of threshold, spread and lapse
# rate; a fit of the population to these tables then costs little. Logarithms of threshold and
# spread are normal over participants, lapse rates normal but for their limits. Source of the model:
# Moscatelli, Mezzetti, Lacquaniti (2012), Journal of Vision 12(11):26, doi:10.1167/12.11.26; of
# lapse rates with a distribution: Kuss, Jaekel, Wichmann (2005), Journal of Vision 5, 478-492,
# doi:10.1167/5.5.8.

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import OptimizeResult, minimize
from scipy.special import gammainccinv, gammaincinv, ndtr
from scipy.stats import t

from stepblocks.errors import StudyError
from stepblocks.study import Array, Table, require
from stepblocks.study.analysis.anova import Interval
from stepblocks.study.analysis.psychometric import (
    MAX_LAPSE,
    Psychometric,
    compute_weber,
    find_crossing,
    fit_psychometric,
)

# what is compared, and its axis in the model of a group
QUANTITIES = {"spread of comparisons": 1, "point of subjective equality": 0}

_LAPSES = np.linspace(0.0, MAX_LAPSE, 6)


@dataclass(frozen=True)
class Estimate:
    """A mean over participants, of a logarithm, or a difference of two, with its 95 % interval.

    Attributes
    ----------
    value, low, high : float
        Natural logarithm of the quantity [1]; an end that the answers leave open is infinite.
    spread : float
        Standard deviation between participants, of the same logarithm [1].
    p : float
        Probability of a value at least this far from zero if it is zero.
    df : float
        Degrees of freedom of its Student's t.
    """

    value: float
    low: float
    high: float
    spread: float
    p: float
    df: float


@dataclass(frozen=True)
class Curve:
    """Psychometric function of one participant.

    Attributes
    ----------
    who : str
        Participant.
    levels : tuple of float
        Heights compared with the standard [m].
    hits, totals : tuple of int
        Answers "higher", and trials, of each height.
    fit : Psychometric or None
        None where the answers do not determine one.
    reason : str
        Why not; empty with a fit.
    """

    who: str
    levels: tuple[float, ...]
    hits: tuple[int, ...]
    totals: tuple[int, ...]
    fit: Psychometric | None
    reason: str


@dataclass(frozen=True)
class Comparisons:
    """Comparisons with a standard in one setting.

    Attributes
    ----------
    setting : str
        Levels of the declared factors; empty where there are none.
    curves : tuple of Curve
        Of each participant.
    standard : float
        Height of the standard [m].
    equal, spread : Estimate or None
        Means over participants of ln(point of subjective equality / standard) and of ln(sigma);
        None with fewer than two participants.
    people : tuple of (str, float, float)
        Participant, point of subjective equality [m] and Weber fraction [1], drawn towards the
        group by the model.
    model : Population or None
        Of these participants, in the same order.
    """

    setting: str
    curves: tuple[Curve, ...]
    standard: float
    equal: Estimate | None
    spread: Estimate | None
    people: tuple[tuple[str, float, float], ...] = ()
    model: "Population | None" = None


class Grid:
    """Likelihood of each participant over threshold, spread and lapse rate.

    Parameters
    ----------
    levels : array_like, shape (n,)
        Natural logarithm of each level.
    hits, totals : array_like, shape (participants, n)
        Answers "higher", and trials, of each participant at each level.
    """

    def __init__(self, levels: ArrayLike, hits: ArrayLike, totals: ArrayLike) -> None:
        x, k, n = (np.asarray(values, dtype=np.float64) for values in (levels, hits, totals))
        require(len(x) >= 3, f"a psychometric function needs three levels, got {len(x)}")
        finer = math.sqrt(max(float(n.sum(axis=1).max()) / 150.0, 1.0))
        sizes = [min(int(size * finer), 301) for size in (80, 40)]
        span, gap = float(np.ptp(x)), float(np.diff(np.sort(x)).min())
        self.middles = np.linspace(x.min() - 0.3 * span, x.max() + 0.3 * span, sizes[0])
        self.spreads = np.linspace(math.log(0.25 * gap), math.log(3.0 * span), sizes[1])
        rising = ndtr((x - self.middles[:, None, None]) / np.exp(self.spreads)[:, None])
        lapse = _LAPSES[:, None]
        p = np.clip(lapse + (1.0 - 2.0 * lapse) * rising[:, :, None, :], 1e-12, 1.0 - 1e-12)
        log = np.tensordot(k, np.log(p), (1, 3)) + np.tensordot(n - k, np.log1p(-p), (1, 3))
        self.axes = (self.middles, self.spreads, _LAPSES)
        self.likelihood: Array = np.exp(log - log.max(axis=(1, 2, 3), keepdims=True))


class Population:
    """Independent normal distributions of the participants along the axes of their likelihoods.

    Parameters
    ----------
    likelihood : ndarray, shape (participants, n, ...)
        One axis for each of `axes`.
    axes : sequence of ndarray
        Equally spaced values.
    """

    def __init__(self, likelihood: Array, axes: Sequence[Array]) -> None:
        require(len(likelihood) > 1, "a population must have at least two participants, got one")
        self.likelihood, self.axes = likelihood, axes
        # Participants come last: each axis is then summed over long rows of memory
        self._rows = np.ascontiguousarray(np.moveaxis(likelihood, 0, -1))
        start, bounds = list[float](), list[tuple[float, float]]()
        for index, axis in enumerate(axes):
            own = likelihood.sum(axis=tuple(n for n in range(1, likelihood.ndim) if n != index + 1))
            means = own @ axis / own.sum(axis=1)
            step = float(axis[1] - axis[0])
            start += [float(means.mean()), math.log(max(means.std(), 2.0 * step))]
            # a narrower normal would fall between the points of the grid
            bounds += [(axis[0], axis[-1]), (math.log(0.6 * step), math.log(np.ptp(axis)))]
        self._bounds = np.array(bounds)
        self.best = self.maximise(np.array(start))
        # the table, the contrasts and the page ask for the same means
        self.estimate = cache(self._estimate_mean)

    def _weigh(self, point: Array, index: int) -> Array:
        # Return the distribution along an axis, times the powers 0, 1 and 2 of how many spreads
        # its values are from the middle
        away = (self.axes[index] - point[2 * index]) / math.exp(point[2 * index + 1])
        weight = np.exp(0.5 * (np.min(away**2) - away**2))
        return np.asarray([np.ones_like(away), away, away**2] * (weight / weight.sum()))

    def _find_moments(self, point: Array) -> tuple[Array, Array, Array]:
        # Return each participant's likelihood; mean and mean square along each axis, in spreads
        # from the middle, of each participant's posterior; and the same of the distribution
        weights = [self._weigh(point, index) for index in range(len(self.axes))]
        sums = self._rows
        for index, rows in enumerate(weights):
            sums = np.tensordot(rows, sums, (1, index))
        # the last axis stands first, so that the powers of each axis are 3 times as far apart
        places = 3 ** np.arange(len(weights))[:, np.newaxis] * np.arange(3)
        along = sums.reshape(3 ** len(weights), -1)[places]
        return (
            along[0, 0],
            along[:, 1:] / along[0, 0],
            np.array([rows[1:].sum(axis=1, keepdims=True) for rows in weights]),
        )

    def _loss(self, point: Array) -> tuple[float, Array]:
        # Return minus the log likelihood, and its gradient
        whole, seen, prior = self._find_moments(point)
        slopes = (seen - prior).sum(axis=2)
        slopes[:, 0] /= np.exp(point[1::2])
        return -float(np.log(whole).sum()), -slopes.ravel()

    def maximise(self, start: Array, place: int = -1, value: float = 0.0) -> OptimizeResult:
        """Maximise the likelihood, with one parameter held at a value where a place is given."""
        bounds = self._bounds.copy()
        if place >= 0:
            bounds[place] = value
        return minimize(
            self._loss,
            np.clip(start, *bounds.T),
            jac=True,
            method="L-BFGS-B",
            bounds=bounds,
            options={"ftol": 1e-11, "gtol": 1e-6},
        )

    def _estimate_mean(self, index: int) -> Estimate:
        # Return the mean over participants along an axis
        place = 2 * index
        point = self.best.x
        middle, spread = float(point[place]), math.exp(point[place + 1])
        climbed = {middle: point}

        @cache
        def assess(value: float) -> float:
            """Return how probable a likelihood ratio as large is if the mean is `value`."""
            nearest = climbed[min(climbed, key=lambda known: abs(known - value))]
            found = self.maximise(nearest, place, value)
            if found.x[place + 1] < self._bounds[place + 1, 0] + 0.01:
                # participants who seem alike may lie on another hill than ones who differ
                apart = found.x.copy()
                apart[place + 1] = math.log(math.hypot(spread, value - middle))
                found = min(found, self.maximise(apart, place, value), key=lambda one: one.fun)
            climbed[value] = found.x
            people, share = self._count_participants(found.x, index)
            return find_tail(2.0 * (float(found.fun) - float(self.best.fun)), people, share)

        people, share = self._count_participants(point, index)
        error = spread / math.sqrt(people * share)
        low, high = (
            find_crossing(
                lambda value: math.log(0.05 / max(assess(value), 1e-300)), middle, end, step
            )
            for end, step in zip(self._bounds[place], (-2.5 * error, 2.5 * error), strict=True)
        )
        return Estimate(
            middle,
            low,
            high,
            spread,
            assess(0.0) if self._bounds[place, 0] < 0.0 < self._bounds[place, 1] else math.nan,
            people - 1.0,
        )

    def _count_participants(self, point: Array, index: int) -> tuple[float, float]:
        # Return the number of participants who tell the mean along an axis, and which share of the
        # variance of what they tell is theirs: the rest is the uncertainty of their answers
        _, seen, prior = self._find_moments(point)
        shares = prior[index, 1] - prior[index, 0] ** 2 - seen[index, 1] + seen[index, 0] ** 2
        shares = np.clip(shares, 1e-6, 1.0 - 1e-6)
        whole, squares = float(shares.sum()), float((shares**2).sum())
        return max(whole**2 / squares, 2.0), squares / whole

    def predict_participants(self, index: int) -> Array:
        """Return the mean of each participant's posterior along an axis."""
        middle, log_spread = self.best.x[2 * index : 2 * index + 2]
        return np.asarray(
            middle + math.exp(log_spread) * self._find_moments(self.best.x)[1][index, 0]
        )

    def profile(self, index: int) -> Array:
        """Return the likelihood of each participant along one of two axes and the lapse rates."""
        return np.tensordot(self.likelihood, self._weigh(self.best.x, 1 - index)[0], (2 - index, 0))


def find_tail(ratio: float, people: float, share: float) -> float:
    """Return the probability of a larger likelihood ratio of the mean of normal participants.

    Each has a known error; `share` of the variance of what they show is between participants, who
    never vary by less than nothing. With a share of one it is Student's t, of zero nearly normal.
    """
    # The ratio follows from the mean and the variance of a sample, which are independent. The
    # spread is the one that fits the tested mean: what the sample has by itself is too narrow.
    half, known = 0.5 * (people - 1.0), 1.0 - share
    squares = 2.0 * np.geomspace(gammaincinv(half, 1e-13), gammainccinv(half, 1e-13), 300)
    weight = np.exp(half * np.log(squares) - 0.5 * squares)
    variance = squares / people
    seen = np.maximum(variance, known)
    least = ratio / people + np.log(seen / known) + variance / seen
    square = known * np.where(least < 1.0, least, np.exp(np.minimum(least - 1.0, 700.0)))
    away = np.sqrt(people * np.maximum(square - variance, 0.0))
    return float(weight @ (2.0 * ndtr(-away)) / weight.sum())


def compare_within(one: Array, other: Array, axis: Array) -> Estimate:
    """Compare two conditions by the same participants, `one` minus `other`.

    Parameters
    ----------
    one, other : ndarray, shape (participants, n, lapses)
        Likelihoods along an axis and lapse rates, as `Population.profile` returns them.
    axis : ndarray, shape (n,)
        Equally spaced values.
    """
    # The mean of a participant's two values is free: it is summed over the whole axis. A lapse rate
    # is the participant's in both conditions: with one for each condition, what that of all takes
    # in one of them from the spread of everybody would count as a difference.
    apart = np.array(
        [
            [np.correlate(*pair, "full") for pair in zip(first.T, second.T, strict=True)]
            for first, second in zip(one, other, strict=True)
        ]
    ).swapaxes(1, 2)
    steps = (axis[1] - axis[0]) * np.arange(1 - len(axis), len(axis))
    return Population(apart / apart.max(axis=(1, 2), keepdims=True), (steps, _LAPSES)).estimate(0)


def compare_between(one: Estimate, other: Estimate) -> Estimate:
    """Compare two groups of participants, `one` minus `other`."""
    # Half widths of both intervals after Zou, G. Y., Donner, A. (2008), Statistics in Medicine 27,
    # 1693-1702, doi:10.1002/sim.3095, taken as errors with the degrees of freedom of Welch, B. L.
    # (1947), Biometrika 34, 28-35, doi:10.1093/biomet/34.1-2.28: of means this is his test. They go
    # by participants; more, for the share of the error that is known, claim too few differences.
    apart = one.value - other.value
    freedom = np.array([one.df, other.df])
    widths = [
        (one.value - one.low, other.high - other.value),
        (one.high - one.value, other.value - other.low),
    ]
    squares = (np.array(widths) / t.ppf(0.975, freedom)) ** 2
    with np.errstate(invalid="ignore"):  # an end that the answers leave open has all of the error
        shares = np.nan_to_num(squares / squares.sum(axis=1, keepdims=True), nan=1.0)
    errors = np.sqrt(squares.sum(axis=1))
    df = 1.0 / (shares**2 @ (1.0 / freedom))
    below, above = (errors * t.ppf(0.975, df)).tolist()
    facing = 0 if apart > 0.0 else 1  # the end on the side of zero
    return Estimate(
        apart,
        apart - below,
        apart + above,
        math.nan,
        2.0 * float(t.sf(abs(apart) / errors[facing], df[facing])),
        float(df[facing]),
    )


def fit_setting(setting: str, own: Table, standard: float) -> Comparisons:
    """Fit the curve of each participant in one setting, and the population of several."""
    curves = tuple(
        _fit_curve(str(name), one) for name, one in own.groupby("participant", sort=False)
    )
    tables = own.pivot_table(
        index="participant", columns="height", values="higher", aggfunc=["sum", "count"]
    ).fillna(0.0)
    if len(curves) < 2 or tables["sum"].shape[1] < 3:
        return Comparisons(setting, curves, standard, None, None)
    grid = Grid(
        np.log(tables["sum"].columns.to_numpy(float) / standard), tables["sum"], tables["count"]
    )
    model = Population(grid.likelihood, grid.axes)
    middles, widths = (model.predict_participants(index) for index in (0, 1))
    people = tuple(
        (str(who), standard * math.exp(middle), compute_weber(wide))
        for who, middle, wide in zip(tables.index, middles, widths, strict=True)
    )
    return Comparisons(
        setting, curves, standard, model.estimate(0), model.estimate(1), people, model
    )


def compare_settings(quantity: str, one: Comparisons, other: Comparisons) -> Interval:
    """Compare the logarithm of a quantity, within participants where they met both settings."""
    index = QUANTITIES[quantity]
    model, same = one.model, other.model
    assert model is not None
    assert same is not None
    own, facing = ([who for who, _, _ in found.people] for found in (one, other))
    both = sorted(set(own) & set(facing))
    if len(both) > 1 and np.array_equal(model.axes[index], same.axes[index]):
        rows, facing_rows = ([people.index(who) for who in both] for people in (own, facing))
        gap = compare_within(
            model.profile(index)[rows], same.profile(index)[facing_rows], model.axes[index]
        )
    else:
        gap = compare_between(model.estimate(index), same.estimate(index))
    return Interval(
        one.setting,
        other.setting,
        gap.value,
        gap.low,
        gap.high,
        gap.p,
        effect_size=math.nan,
        error=0.5 * (gap.high - gap.low) / float(t.ppf(0.975, gap.df)),
        df=gap.df,
    )


def leave_out(found: Comparisons, who: str) -> Comparisons:
    """Return what all others say; what the group of all says is not among it."""
    assert found.model is not None
    kept = [place for place, (name, _, _) in enumerate(found.people) if name != who]
    return replace(
        found,
        equal=None,
        spread=None,
        people=tuple(found.people[place] for place in kept),
        model=Population(found.model.likelihood[kept], found.model.axes),
    )


def _fit_curve(who: str, own: Table) -> Curve:
    by_level = own.groupby("height")["higher"].agg(["sum", "count"])
    levels, hits, totals = (
        tuple(column.tolist()) for column in (by_level.index, by_level["sum"], by_level["count"])
    )
    try:
        return Curve(who, levels, hits, totals, fit_psychometric(levels, hits, totals), "")
    except StudyError as error:
        return Curve(who, levels, hits, totals, None, str(error))
