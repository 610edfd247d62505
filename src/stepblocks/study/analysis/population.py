"""Psychometric functions of a group, in which every participant has a threshold and a spread."""

# The likelihood of each participant is computed once, on a grid of threshold, spread and lapse
# rate; a fit of the population to these tables then costs little. Logarithms of threshold and
# spread are normal over participants, lapse rates normal but for their limits. Source of the model:
# Moscatelli, Mezzetti, Lacquaniti (2012), Journal of Vision 12(11):26, doi:10.1167/12.11.26; of
# lapse rates with a distribution: Kuss, Jaekel, Wichmann (2005), Journal of Vision 5, 478-492,
# doi:10.1167/5.5.8.

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, reduce
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize
from scipy.special import ndtr
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
_KNOWN = 1e6  # degrees of freedom of an error that no spread of participants has to tell


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
        # The last axis, of few lapse rates, comes first: long rows of memory are summed faster
        self._likelihood = np.ascontiguousarray(np.moveaxis(likelihood, -1, 1))
        self.likelihood, self.axes = likelihood, axes
        self._start, self._bounds = list[float](), list[tuple[float, float]]()
        for index, axis in enumerate(axes):
            others = tuple(n for n in range(1, likelihood.ndim) if n != index + 1)
            own = likelihood.sum(axis=others)
            means, step = own @ axis / own.sum(axis=1), float(axis[1] - axis[0])
            spread = max(float(means.std()), 2.0 * step)
            self._start += [float(means.mean()), math.log(spread)]
            # a narrower normal would fall between the points of the grid
            narrow, wide = math.log(0.6 * step), math.log(float(np.ptp(axis)))
            self._bounds += [(float(axis[0]), float(axis[-1])), (narrow, wide)]
        self.best = self._maximise(self._start)

    def _priors(self, point: Array) -> tuple[list[Array], list[Array]]:
        # Return the distribution along each axis, and the slopes of its logarithm
        exponents, slopes = list[Array](), list[Array]()
        for index, axis in enumerate(self.axes):
            spread = math.exp(point[2 * index + 1])
            away = (axis - point[2 * index]) / spread
            exponents.append(-0.5 * away**2)
            slopes.append(np.array([away / spread, away**2]))
        weights = [np.exp(exponent - exponent.max()) for exponent in exponents]
        return [weight / weight.sum() for weight in weights], slopes

    def _integrate_others(self, priors: Sequence[Array]) -> list[Array]:
        # Return the likelihood along each axis, the others summed with their distributions
        own, people, along = self._likelihood, len(self._likelihood), list[Array]()
        left = [priors[-1], *priors[:-1]]  # as they stand in memory
        while len(left) > 1:
            last = left.pop()
            own = own.reshape(people, -1, len(last))
            along.append(reduce(np.outer, left).ravel() @ own)
            own = own.reshape(-1, len(last)) @ last
        return [*along[::-1], own.reshape(people, -1)]

    def _loss(self, point: Array) -> tuple[float, Array]:
        # Return minus the log likelihood, and its gradient
        (priors, slopes), gradient = self._priors(point), list[float]()
        for prior, slope, along in zip(priors, slopes, self._integrate_others(priors), strict=True):
            whole = along @ prior
            posterior = (along / whole[:, np.newaxis]).sum(axis=0) * prior
            gradient += (slope @ (posterior - len(whole) * prior)).tolist()
        return -float(np.log(whole).sum()), -np.array(gradient)

    def _maximise(self, start: Sequence[float], place: int = -1, value: float = 0.0) -> Any:
        # Maximise the likelihood, one parameter held where a place is given
        held = [(value, value) if n == place else one for n, one in enumerate(self._bounds)]
        first = [value if n == place else one for n, one in enumerate(start)]
        return minimize(
            self._loss,
            first,
            jac=True,
            method="L-BFGS-B",
            bounds=held,
            options={"ftol": 1e-11, "gtol": 1e-6},
        )

    def estimate(self, index: int) -> Estimate:
        """Return the mean over participants along an axis."""
        place, best = 2 * index, self.best
        middle, spread, nearest = float(best.x[place]), math.exp(best.x[place + 1]), best.x
        # The likelihood ratio of the mean of a normal sample is n ln(1 + t^2 / (n - 1)): the
        # interval is Student's where participants differ. Where they seem alike, their spread
        # ends at its bound, and the error left is that of their own answers, known from these.
        alike = best.x[place + 1] < self._bounds[place + 1][0] + 0.01
        df = _KNOWN if alike else len(self._likelihood) - 1.0
        limit = (df + 1.0) * math.log1p(float(t.ppf(0.975, df)) ** 2 / df)

        @cache
        def ratio(value: float) -> float:
            nonlocal nearest
            # the last optimum may be far away, where a climb can end on another hill
            tried = [self._maximise(start, place, value) for start in (nearest, best.x)]
            found = min(tried, key=lambda one: float(one.fun))
            nearest = found.x
            return 2.0 * (float(found.fun) - float(best.fun))

        low, high = (
            find_crossing(lambda value: ratio(value) - limit, middle, end, step)
            for end, step in zip(self._bounds[place], (-0.5 * spread, 0.5 * spread), strict=True)
        )
        p = math.nan
        if self._bounds[place][0] < 0.0 < self._bounds[place][1]:
            at_zero = df * math.expm1(max(ratio(0.0), 0.0) / (df + 1.0))
            p = 2.0 * float(t.sf(math.sqrt(at_zero), df))
        return Estimate(middle, low, high, spread, p, df)

    def predict_participants(self, index: int) -> Array:
        """Return the mean of each participant's posterior along an axis."""
        priors = self._priors(self.best.x)[0]
        posterior = self._integrate_others(priors)[index] * priors[index]
        return np.asarray(posterior @ self.axes[index] / posterior.sum(axis=1))

    def profile(self, index: int) -> Array:
        """Return the likelihood of each participant along one of two axes and the lapse rates."""
        prior = self._priors(self.best.x)[0][1 - index]
        return np.tensordot(self.likelihood, prior, (2 - index, 0))


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
    # (1947), Biometrika 34, 28-35, doi:10.1093/biomet/34.1-2.28: of means this is his test.
    apart, freedom = one.value - other.value, np.array([one.df, other.df])
    widths = [
        (one.value - one.low, other.high - other.value),
        (one.high - one.value, other.value - other.low),
    ]
    squares = (np.array(widths) / t.ppf(0.975, freedom)) ** 2
    with np.errstate(invalid="ignore"):  # an end that the answers leave open has all of the error
        shares = np.nan_to_num(squares / squares.sum(axis=1, keepdims=True), nan=1.0)
    errors, df = np.sqrt(squares.sum(axis=1)), 1.0 / (shares**2 @ (1.0 / freedom))
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


def compare_settings(
    quantity: str, one: Comparisons, other: Comparisons, without: str = ""
) -> Interval:
    """Compare the logarithm of a quantity, within participants where they met both settings.

    A participant may be left out.
    """
    index = QUANTITIES[quantity]
    (own, model), (facing, same) = (_leave_out(found, without) for found in (one, other))
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
        df=gap.df if gap.df < _KNOWN else math.inf,
    )


def _leave_out(found: Comparisons, who: str) -> tuple[list[str], Population]:
    # Return the names and the population of all others
    assert found.model is not None
    kept = [place for place, (name, _, _) in enumerate(found.people) if name != who]
    model = Population(found.model.likelihood[kept], found.model.axes) if who else found.model
    return [found.people[place][0] for place in kept], model


def _fit_curve(who: str, own: Table) -> Curve:
    by_level = own.groupby("height")["higher"].agg(["sum", "count"])
    levels, hits, totals = (
        tuple(column.tolist()) for column in (by_level.index, by_level["sum"], by_level["count"])
    )
    try:
        fit, reason = fit_psychometric(levels, hits, totals), ""
    except StudyError as error:
        fit, reason = None, str(error)
    return Curve(who, levels, hits, totals, fit, reason)
