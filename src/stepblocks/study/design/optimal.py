"""The heights and trials that make the interval of a threshold, a JND or an exponent narrowest."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from scipy.stats import t

from stepblocks.contact import Array
from stepblocks.contact.domain import read_number
from stepblocks.errors import StudyError
from stepblocks.mistakes import shorten_value
from stepblocks.predict.set_design.route import MakingRoute
from stepblocks.study.analysis.bounded import Bounded
from stepblocks.study.analysis.psychometric import MAX_LAPSE, Z975
from stepblocks.study.design.adaptive import Prior, parse_prior
from stepblocks.study.design.blocks import Declared, choose_blocks
from stepblocks.study.design.information import (
    CurveShape,
    Sensitivity,
    compute_curve_sensitivity,
    compute_line_sensitivity,
)
from stepblocks.study.design.placement import ExpectedInterval, HeightDesign, Placement, Target
from stepblocks.study.design.trial_exchange import (
    Criterion,
    allocate_evenly_spaced_units,
    exchange_trials,
    merge_equivalent_heights,
)

LAPSE = 0.02  # expected rate of errors at either end
MAGNITUDE_NOISE = 0.3  # standard deviation of ln(magnitude) that is expected
TRIALS = 60  # of a participant
EQUAL_HEIGHTS = 7  # of the equal spacing that a design is compared with
_FEWEST_HEIGHTS = 3  # that the analyses of comparisons and of magnitudes need
_MOST_CANDIDATES = 2000
_MOST_TRIALS = 10_000
_MOST_NEEDED = 10_000_000  # trials up to which a width is sought
_MOST_TURNS = 10  # in which trials and their placement are found for a width
_UNIT_OF_PAIRS = 2  # a block is compared as often first as second
_ROUNDING = 1e-6  # of a step, by which a limit may miss a whole number of them
_EXPECTED = ("equal", "equal_factor", "weber", "weber_factor")  # of comparisons


@dataclass(frozen=True)
class _Expectation:
    """What is expected, and what trials at each candidate tell about it.

    Attributes
    ----------
    target : Target
        What is to be known best.
    candidates : ndarray, shape (heights,)
        Heights in rising order [m].
    sensitivity : Sensitivity
        Of an answer at each.
    standard : float
        Height that others are compared with [m]; of no meaning for an exponent.
    prior : Prior
        Expected threshold and Weber fraction.
    exponent : float
        Expected exponent [1].
    """

    target: Target
    candidates: Array
    sensitivity: Sensitivity
    standard: float
    prior: Prior
    exponent: float

    @property
    def criterion(self) -> Criterion:
        """Criterion that is minimised."""
        return Criterion(self.sensitivity, self.target.parameter_indices, self.target.spread_index)

    @property
    def inseparable_trials(self) -> int:
        """How many trials stay together."""
        if self.target is Target.EXPONENT:
            return 1
        return _UNIT_OF_PAIRS

    def predict_all_intervals(self, trials: Array) -> tuple[ExpectedInterval, ...]:
        """Return the intervals that trials at each candidate give."""
        if self.target is Target.EXPONENT:
            return (self.predict_interval(Target.EXPONENT, trials),)
        threshold = self.predict_interval(Target.THRESHOLD, trials)
        return threshold, self.predict_interval(Target.JND, trials)

    def predict_interval(self, quantity: Target, trials: Array) -> ExpectedInterval:
        """Return the interval of a quantity: Student's of an exponent, else of the logarithm."""
        criterion = Criterion(self.sensitivity, quantity.parameter_indices, quantity.spread_index)
        log_variance = criterion.compute_value(trials)
        error = math.exp(0.5 * log_variance)
        if quantity is Target.EXPONENT:
            reach = float(t.ppf(0.975, trials.sum() - 2.0)) * error
            ends = Bounded(self.exponent, self.exponent - reach, self.exponent + reach)
            return ExpectedInterval(quantity, ends)
        factor = math.exp(Z975 * error)
        if quantity is Target.THRESHOLD:
            middle = self.standard * self.prior.equal
            return ExpectedInterval(quantity, Bounded(middle, middle / factor, middle * factor))
        log_ratio = math.log1p(self.prior.weber)
        logs = Bounded(log_ratio, log_ratio / factor, log_ratio * factor)
        return ExpectedInterval(quantity, logs.transform(_compute_weber_fraction))

    def is_width_reached(self, trials: Array, width: float) -> bool:
        """Tell whether the interval of the target is at most so wide."""
        return self.predict_interval(self.target, trials).width <= width

    def find_needed_trials(
        self, trial_shares: Array, width: float, trial_multiple: int
    ) -> int | None:
        """Return the least number of trials, in some shares, whose interval has a width.

        The number is a whole multiple of `trial_multiple`; None where millions are not enough.
        """

        def is_enough(multiple_count: int) -> bool:
            """Tell whether so many multiples are enough."""
            return self.is_width_reached(multiple_count * trial_multiple * trial_shares, width)

        low, high = 0, max(math.ceil(_FEWEST_HEIGHTS / trial_multiple), 1)
        while not is_enough(high):
            low, high = high, 2 * high
            if low * trial_multiple > _MOST_NEEDED:
                return None
        while high - low > 1:
            middle = (low + high) // 2
            if is_enough(middle):
                high = middle
            else:
                low = middle
        return high * trial_multiple

    def build_placement(self, trials: Array, width: float | None, trial_multiple: int) -> Placement:
        """Describe trials at each candidate, and find how many reach a width, if any is given."""
        needed = None
        if width is not None:
            needed = self.find_needed_trials(trials / trials.sum(), width, trial_multiple)
        used = np.flatnonzero(trials)
        return Placement(
            heights=tuple(self.candidates[used].tolist()),
            trials=tuple(trials[used].astype(int).tolist()),
            intervals=self.predict_all_intervals(trials),
            needed=needed,
        )


@dataclass(frozen=True)
class _DesignShape:
    """What the trials of a design have to keep to.

    Attributes
    ----------
    number : int
        Least number of heights, with `same_trials` the number.
    same_trials : bool
        Whether every height gets as many trials.
    unit : int
        Trials that stay together.
    """

    number: int
    same_trials: bool
    unit: int

    @property
    def trial_multiple(self) -> int:
        """Number of which the number of trials is a whole multiple."""
        if self.same_trials:
            return self.unit * self.number
        return self.unit

    @property
    def fewest_trials(self) -> int:
        """Fewest trials that the least number of heights needs."""
        return self.unit * self.number

    def round_up_trials(self, trials: int) -> int:
        """Return the next number of trials that the shape can have."""
        return self.trial_multiple * math.ceil(
            max(trials, self.fewest_trials) / self.trial_multiple
        )


def _compute_weber_fraction(log_ratio: float) -> float:
    """Return a Weber fraction from the logarithm of one plus it; infinite beyond all floats."""
    try:
        return math.expm1(log_ratio)
    except OverflowError:
        return math.inf


def place_heights(
    source: Declared | Sequence[float] | MakingRoute,
    target: str,
    *,
    standard: float | str | None = None,
    prior: Mapping[str, object] = MappingProxyType({}),
    lapse: float = LAPSE,
    curve: str = CurveShape.NORMAL,
    exponent: float = 1.0,
    noise: float = MAGNITUDE_NOISE,
    trials: int | None = None,
    number: int = _FEWEST_HEIGHTS,
    same_trials: bool = False,
    equal_number: int = EQUAL_HEIGHTS,
    width: float | str | None = None,
    only: str | None = None,
) -> HeightDesign:
    """Place the trials of a participant at the heights that tell most.

    Parameters
    ----------
    source : str, Path, StimulusSet, MakingRoute or sequence of float
        Which heights there are: step blocks of a stimulus file or set, every height that a route
        makes from its `least` to its `most`, or heights [m].
    target : str
        What is to be known best: ``"threshold"``, ``"jnd"`` or ``"both"`` of comparisons with a
        standard (c-optimal, D-optimal for both), or ``"exponent"`` of magnitudes.
    standard : float or str
        Height of the block that all others are compared with [m], or its name in the source; of
        comparisons alone.
    prior : mapping
        What is expected of comparisons, as of `design_study`: medians ``equal`` of the threshold
        over the standard and ``weber`` of the Weber fraction of height, and ``equal_factor`` and
        ``weber_factor``, by which one standard deviation changes them; 1 for a certain value [1].
    lapse : float
        Expected rate of errors at either end, half that of random answers, at most 0.1 [1]. It is
        estimated beside the others unless it is 0.
    curve : str
        ``"normal"``, which the analysis fits, or ``"logistic"``.
    exponent, noise : float
        Expected exponent of the height, and standard deviation of the natural logarithm of a
        magnitude around the power law [1].
    trials : int, optional
        Of the participant in one setting, 60 where neither these nor a `width` are given; even in
        comparisons, where the standard comes as often first as second.
    number : int
        Least number of heights, at least 3; with `same_trials` the number of heights.
    same_trials : bool
        Whether every height gets as many trials, as `design_study` gives them.
    equal_number : int
        Heights of the equal spacing that is shown beside the design.
    width : float or str, optional
        In place of `trials`: there are as many as make the 95 % interval of the target, from end
        to end, at most so wide, placed for this number: [m] of a threshold, else [1].
    only : str, optional
        Pattern of the blocks of a stimulus file that are candidates.

    Returns
    -------
    HeightDesign
        Heights, trials and expected 95 % intervals of the design and of equal spacing. An interval
        is from the Fisher information, in the middle (of its logarithm) over expected values; that
        of a threshold has the second order of the error of the spread (see `Criterion`).

    Raises
    ------
    StepblocksError
        If an option is out of range, or there are too few or too many heights.

    Examples
    --------
    >>> import stepblocks
    >>> route = stepblocks.MakingRoute(least="20 um", most="100 um", step="1 um")
    >>> design = stepblocks.place_heights(route, "exponent", trials=30)
    >>> [round(height * 1e6) for height in design.optimal.heights]
    [20, 99, 100]
    >>> design.optimal.trials
    (15, 1, 14)
    """
    goal = _parse_target(target)
    candidates, named = _list_candidates_and_named_heights(source, only)
    if goal is Target.EXPONENT:
        if standard is not None or prior:
            raise StudyError("standard and prior apply to comparisons, got them with an exponent")
        expectation = _make_exponent_expectation(candidates, exponent, noise)
    else:
        height = _read_standard_height(standard, named)
        expectation = _make_curve_expectation(goal, candidates, height, prior, lapse, curve)
    _check_count("number", number, _FEWEST_HEIGHTS, len(candidates))
    _check_count("equal_number", equal_number, _FEWEST_HEIGHTS, _MOST_CANDIDATES)
    shape = _DesignShape(number, same_trials, expectation.inseparable_trials)
    asked = _read_width(goal, width)
    if asked is not None and trials is not None:
        raise StudyError("trials or width must be given, got both")
    if asked is not None:
        trials = _find_trials_for_width(expectation, shape, asked)
    elif trials is None:
        trials = shape.round_up_trials(TRIALS)
    _check_count("trials", trials, shape.unit * number, _MOST_TRIALS)
    if trials % shape.trial_multiple:
        raise StudyError(f"trials must be a multiple of {shape.trial_multiple}, got {trials}")
    best = _find_best_trials(expectation, trials, shape)
    equal = shape.unit * allocate_evenly_spaced_units(
        candidates, equal_number, trials // shape.unit
    )
    criterion = expectation.criterion
    loss = criterion.compute_value(equal) - criterion.compute_value(best)
    return HeightDesign(
        target=goal,
        optimal=expectation.build_placement(best, asked, shape.trial_multiple),
        equal=expectation.build_placement(equal, asked, shape.unit),
        efficiency=math.exp(-loss / len(goal.parameter_indices)),
    )


def _find_trials_for_width(expectation: _Expectation, shape: _DesignShape, width: float) -> int:
    """Return the number of trials whose best placement gives an interval of a width.

    The best shares depend a little on the number, so that both are found in turn.
    """
    trials = shape.round_up_trials(TRIALS)
    for _ in range(_MOST_TURNS):
        best = _find_best_trials(expectation, trials, shape)
        needed = expectation.find_needed_trials(best / best.sum(), width, shape.trial_multiple)
        most_trials = shape.trial_multiple * (_MOST_TRIALS // shape.trial_multiple)
        # shares for few trials may tell too little of the lapses for any number of trials
        if needed is None or needed > most_trials:
            needed = most_trials
        needed = shape.round_up_trials(needed)
        if needed == trials:
            break
        trials = needed
    while not expectation.is_width_reached(_find_best_trials(expectation, trials, shape), width):
        trials += shape.trial_multiple
        if trials > _MOST_TRIALS:
            raise StudyError(
                f"width must be reached by {_MOST_TRIALS} trials, got {width:g}; ask for a wider "
                "interval"
            )
    return trials


def _find_best_trials(expectation: _Expectation, trials: int, shape: _DesignShape) -> Array:
    """Return the best trials at each candidate.

    The search starts from equal spacing over all candidates and over three halves of them.
    """
    number = shape.number
    unit = shape.unit
    if shape.same_trials:
        unit = trials // number
    units = trials // unit
    candidates = expectation.candidates
    criterion = expectation.criterion
    found = []
    for start in _list_search_starts(candidates, number, units):
        exchanged = exchange_trials(criterion, start, unit, number)
        found.append(merge_equivalent_heights(criterion, exchanged, unit, number))
    return unit * min(found, key=lambda shares: round(criterion.compute_value(unit * shares), 9))


def _list_search_starts(candidates: Array, height_count: int, unit_count: int) -> list[Array]:
    """Return where the search starts: a number of heights in each of several ranges."""
    size = len(candidates)
    starts = []
    for first, end in ((0, size), (0, size // 2), (size // 4, size - size // 4), (size // 2, size)):
        if end - first < height_count:
            continue
        # by their ranks, so that no two of the heights are the same candidate
        inside = allocate_evenly_spaced_units(
            np.arange(first, end, dtype=np.float64), height_count, unit_count
        )
        start = np.zeros(size)
        start[first:end] = inside
        starts.append(start)
    return starts


def _parse_target(target: str) -> Target:
    """Read what is to be known best."""
    try:
        return Target(target)
    except ValueError:
        known = ", ".join(Target)
        raise StudyError(f"target must be one of {known}, got {shorten_value(target)}") from None


def _list_candidates_and_named_heights(
    source: Declared | Sequence[float] | MakingRoute, name_pattern: str | None
) -> tuple[Array, dict[str, float]]:
    """Return the different heights in rising order [m], and those of named blocks."""
    named = dict[str, float]()
    if isinstance(source, MakingRoute):
        heights = _list_heights_of_route(source)
    else:
        for item in choose_blocks(source, name_pattern=name_pattern).items:
            named[item.identity] = item.height
        heights = list(named.values())
    candidates = np.unique(heights)
    if not _FEWEST_HEIGHTS <= len(candidates) <= _MOST_CANDIDATES:
        raise StudyError(
            f"there must be {_FEWEST_HEIGHTS} to {_MOST_CANDIDATES} different heights to choose "
            f"from, got {len(candidates)}"
        )
    return candidates, named


def _list_heights_of_route(route: MakingRoute) -> list[float]:
    """Return the whole multiples of the step of a route from its least to its most [m]."""
    lowest, highest, step = route.least, route.most, route.step
    # a route has read its lengths
    if not (isinstance(lowest, float) and isinstance(highest, float) and isinstance(step, float)):
        raise StudyError("a route must state the least and the most height, got one without")
    first = math.ceil(lowest / step - _ROUNDING)
    last = math.floor(highest / step + _ROUNDING)
    number = last - first + 1
    if number > _MOST_CANDIDATES:
        raise StudyError(
            f"a route must make at most {_MOST_CANDIDATES} heights, got {number}: choose a larger "
            "step"
        )
    return [round(multiple * step, 12) for multiple in range(first, last + 1)]


def _make_exponent_expectation(candidates: Array, exponent: object, noise: object) -> _Expectation:
    """Check what is expected of magnitudes, and compute what they tell at each candidate."""
    slope = _read_number_within_limits("exponent", exponent, -100.0, 100.0)
    deviation = _read_number_within_limits("noise", noise, 1e-6, 10.0)
    sensitivity = compute_line_sensitivity(candidates, deviation)
    return _Expectation(Target.EXPONENT, candidates, sensitivity, math.nan, Prior(), slope)


def _make_curve_expectation(
    target: Target,
    candidates: Array,
    standard: float,
    prior: Mapping[str, object],
    lapse: object,
    curve: str,
) -> _Expectation:
    """Check what is expected of comparisons, and compute what they tell at each candidate."""
    rate = _read_number_within_limits("lapse", lapse, 0.0, MAX_LAPSE)
    if curve not in list(CurveShape):
        known = ", ".join(CurveShape)
        raise StudyError(f"curve must be one of {known}, got {shorten_value(curve)}")
    expected = _parse_expected_values(prior)
    sensitivity = compute_curve_sensitivity(candidates, standard, expected, rate, CurveShape(curve))
    return _Expectation(target, candidates, sensitivity, standard, expected, math.nan)


def _read_standard_height(
    standard: float | str | None, heights_by_name: Mapping[str, float]
) -> float:
    """Return the height of the standard [m], which may be the name of a block."""
    if standard is None:
        raise StudyError("standard must be given for comparisons: the height of the block [m]")
    if isinstance(standard, str) and standard in heights_by_name:
        return heights_by_name[standard]
    return _read_number_within_limits("standard", standard, 1e-9, 10e-3, "length")


def _parse_expected_values(stated_values: Mapping[str, object]) -> Prior:
    """Complete the expected values of comparisons; unlike a prior, they may be certain.

    Raises
    ------
    StudyError
        If a name is none of an expected value, or a value is out of range.
    """
    unknown = set(stated_values) - set(_EXPECTED)
    if unknown:
        raise StudyError(f"prior must name {', '.join(_EXPECTED)}, got {sorted(unknown)[0]!r:.40}")
    uncertain = dict[str, object]()
    certain = dict[str, float]()
    for name, value in stated_values.items():
        if name.endswith("_factor") and str(value).strip() in ("1", "1.0"):
            certain[name] = 1.0
        else:
            uncertain[name] = value
    return replace(parse_prior(uncertain), **certain)


def _read_number_within_limits(
    name: str, value: object, least: float, most: float, dimension: str = "ratio"
) -> float:
    """Read a number in SI, and refuse one outside its limits."""
    number = read_number(name, value, dimension)
    if not least <= number <= most:
        raise StudyError(f"{name} must be {least:g} to {most:g}, got {shorten_value(value)}")
    return number


def _check_count(name: str, value: object, least: int, most: int) -> None:
    """Refuse what is no whole number within limits."""
    is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not is_whole or not least <= int(str(value)) <= most:
        raise StudyError(
            f"{name} must be a whole number from {least} to {most}, got {shorten_value(value)}"
        )


def _read_width(target: Target, width: float | str | None) -> float | None:
    """Read the width that the interval of the target is to have, in its unit."""
    if width is None:
        return None
    if target is Target.BOTH:
        raise StudyError("width must be that of a threshold or of a JND, got target both")
    dimension = "ratio"
    if target is Target.THRESHOLD:
        dimension = "length"
    number = read_number("width", width, dimension)
    if not (math.isfinite(number) and number > 0.0):
        raise StudyError(f"width must be positive and finite, got {shorten_value(width)}")
    return number
