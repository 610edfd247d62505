"""Any slot as a smooth function of any covariate: the way in for an effect that nobody foresaw."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepblocks.lawsearch.law import Law, Parameter, SizedChange
from stepblocks.quantities import format_column_label
from stepblocks.rig.forward import SPEED_OVER_LOAD
from stepblocks.rig.state import DragState, Floats

Change = Callable[[DragState, Floats], DragState]
Size = Callable[[NDArray[np.generic], Mapping[str, float]], Floats]
Names = tuple[str, ...]

_PIECES = 4
_RUN = "run_order"


@dataclass(frozen=True)
class CovariateRange:
    """Where a covariate lay in the data: numbers from `low` to `high`, or labels.

    Attributes
    ----------
    name : str
        A column, or a quantity of the model.
    low : float
    high : float
    log : bool
        Laid out by its logarithm, as where it spans a decade.
    labels : tuple[str, ...]
        Empty for numbers.
    distinct : int
        How many different numbers it takes.
    pair : tuple[CovariateRange, ...]
        Two that act together, of which it is the product.
    """

    name: str
    low: float = 0.0
    high: float = 1.0
    log: bool = False
    labels: tuple[str, ...] = ()
    distinct: int = 100
    pair: "tuple[CovariateRange, ...]" = ()

    @property
    def freedom(self) -> int:
        """Columns of its smooth."""
        if self.labels:
            return len(self.labels) - 1
        return min(_PIECES, self.distinct - 1)

    def unit(self, column: NDArray[np.generic]) -> Floats:
        """Lay numbers out from 0 to 1; beyond the range they stay at its end."""
        numbers = np.asarray(column, dtype=np.float64)
        low, high = self.low, self.high
        if self.log:
            numbers = np.log(np.maximum(numbers, 1e-12))
            low, high = float(np.log(low)), float(np.log(high))
        return np.asarray(np.clip((numbers - low) / (high - low), 0.0, 1.0))

    def line(self, column: NDArray[np.generic]) -> Floats:
        """Return the one column of a straight line, from -1 to 1 over the range.

        For a pair it is the product of two.
        """
        if self.pair:
            first, second = self.pair
            return first.line(column[:, 0]) * second.line(column[:, 1])
        return (2.0 * self.unit(column) - 1.0)[:, None]

    def basis(self, column: NDArray[np.generic]) -> Floats:
        """Columns of the smooth, each zero in the middle of the range.

        They are cubic B-splines, or one column per label.
        """
        from scipy.interpolate import BSpline

        if self.labels:
            # a label that the data did not have is taken for the mean of all
            mean = ~np.isin(column, self.labels) / len(self.labels)
            return np.stack([(column == label) + mean for label in self.labels[1:]], axis=1)
        if self.freedom < _PIECES:
            return self.line(column) ** np.arange(1, self.freedom + 1)
        # a constant belongs to the nominal model: one spline goes, the rest vanish in the middle
        knots = np.concatenate([np.zeros(3), np.linspace(0.0, 1.0, _PIECES - 1), np.ones(3)])
        splines = BSpline(knots, np.eye(_PIECES + 1), 3)
        places = np.append(self.unit(column), 0.5)
        values = splines(places)
        above_middle = values[:-1] - values[-1]
        return np.asarray(above_middle[:, [0, 1, 3, 4]])


def _make_scaling(between: tuple[float, float] | None = None, **powers: float) -> Change:
    """Multiply each slot by a power of exp g, where g may be held between two bounds."""

    def scale(state: DragState, g: Floats) -> DragState:
        held = g if between is None else np.clip(g, *between)
        slots = {}
        for slot, power in powers.items():
            slots[slot] = getattr(state, slot) * np.exp(power * held)
        return state.changed(**slots)

    return scale


def _make_shift(*slots: str, by: float = 0.1) -> Change:
    """Add `by` times g to each slot, in its unit."""

    def shift(state: DragState, g: Floats) -> DragState:
        shifted = {slot: getattr(state, slot) + by * g for slot in slots}
        return state.changed(**shifted)

    return shift


def _scale_seen_load(state: DragState, g: Floats) -> DragState:
    """Multiply the load by exp g, as the normal gauge sees it."""
    weight = state.set_load + state.sensed_offset
    return state.changed(
        load=state.load * np.exp(g), sensed_offset=state.sensed_offset + weight * np.expm1(g)
    )


def _scale_climb_load(state: DragState, g: Floats) -> DragState:
    """Multiply the load by exp g while the tip climbs."""
    return state.changed(climb_load=state.climb_load + state.set_load * np.expm1(g))


class Move(NamedTuple):
    """How a smooth g enters a slot."""

    slot: str
    form: str
    change: Change


# several ways where the bench may show a slot in several ways
SLOT_MOVES = {
    "radius": Move("contact_geometry", "(R + r) exp g", _make_scaling((-1.0, 1.5), radius=1)),
    "height": Move("contact_geometry", "H + 10 um g", _make_shift("height", by=1e-5)),
    "friction": Move("friction", "mu exp g", _make_scaling((-4.0, 2.0), friction=1)),
    "load": Move("normal_load", "F_py exp g, unseen by the gauge", _make_scaling(load=1)),
    "seen_load": Move("normal_load", "F_py exp g, seen by the gauge", _scale_seen_load),
    "load_offset": Move("normal_load", "F_py + 0.1 N g", _make_shift("load", "sensed_offset")),
    "climb_load": Move("normal_load", "F_py exp g while climbing", _scale_climb_load),
    "stiffness": Move("stiffness", "k exp g", _make_scaling(stiffness=1, ring_stiffness=1)),
    "weighed_stiffness": Move(
        "stiffness",
        "k exp g, energies weighed with it",
        _make_scaling(stiffness=1, ring_stiffness=1, conversion=-1),
    ),
    # the amplitude of a ring that keeps its pitch counts on the declared spring all the same
    "ramp_stiffness": Move(
        "stiffness", "k exp g, pitch unchanged", _make_scaling(stiffness=1, conversion=1)
    ),
    "conversion": Move("conversion", "C_v exp g", _make_scaling(conversion=1)),
    "drag": Move("drag", "F_x + 0.1 N g", _make_shift("drag")),
    "climb_drag": Move("drag", "F_px + 0.1 N g", _make_shift("climb_drag")),
    "gain": Move("sensor", "gauge gain exp g", _make_scaling(gain=1)),
}


_STEPPING = ("radius", "friction", "conversion", "seen_load", "gain")
_JUMPING = ("friction", "conversion")
# what a batch of blocks, a pause and the trial before may change; edges are polished by passes
_MOVED_BY: dict[str, tuple[str, ...]] = {
    "block": ("radius", "friction", "conversion"),
    "pause_s": _JUMPING,
    "trials_since_rest": _JUMPING,
    "passes_of_block": ("radius",),
    "previous_load_n": _JUMPING,
    "previous_height_um": _JUMPING,
    SPEED_OVER_LOAD: _JUMPING,
}
_SHORTEST_PERIOD = 6.0  # trials
_MOST_TURNS = 500  # half turns of a swing over the run: of thousands of trials more are most work
_LEVELS = ("second", "third", "fourth", "fifth")
_STEP_SHAPES = 12  # places along the run at which a search looks for a sudden change
_STEP_WIDTH = 2e-3  # of the range: a hundredth of the spacing leaves a fit no way to move


def list_smooth_laws(covariates: Sequence[CovariateRange]) -> tuple[Law, ...]:
    """Return every slot over every covariate as a line, a smooth and a jump, along the run a swing.

    What the log implies, such as the passes over a block, moves a few slots alone.
    """
    laws: list[Law] = []
    for covariate in covariates:
        laws += _list_covariate_laws(covariate)
        if covariate.labels and covariate.name != "block":
            laws.append(_make_added_load_law(covariate))
        is_number = not covariate.labels and not covariate.pair
        if is_number and covariate.distinct > 2 * _STEP_SHAPES:
            laws += _list_jump_laws(covariate)
    return tuple(laws)


def _list_covariate_laws(covariate: CovariateRange) -> list[Law]:
    """List lines and smooths of every slot that a covariate may move."""
    laws = []
    for slot in _MOVED_BY.get(covariate.name, SLOT_MOVES):
        if _has_trend(covariate):
            laws.append(_make_trend_law(slot, covariate))
        if not covariate.pair:
            laws.append(_make_smooth_law(slot, covariate))
    return laws


def _has_trend(covariate: CovariateRange) -> bool:
    """Whether a straight line over a covariate says more than a jump.

    Pauses are short or long, and a line through two heaps does not.
    """
    if covariate.pair:
        return True
    return not covariate.labels and covariate.distinct > 2 and covariate.name != "pause_s"


def _list_jump_laws(covariate: CovariateRange) -> list[Law]:
    """List sudden changes over a covariate; along the run also several levels, and swings."""
    if covariate.name != _RUN:
        return [_make_step_law(slot, covariate) for slot in _JUMPING]
    laws = [_make_step_law(slot, covariate) for slot in _STEPPING]
    for slot in _JUMPING:
        for levels in range(3, len(_LEVELS) + 2):
            laws.append(_make_levels_law(slot, covariate, levels))
        laws.append(_make_periodic_law(slot, covariate))
    return laws


def _make_added_load_law(covariate: CovariateRange) -> Law:
    """Let each label press by a force of its own more than the weights."""
    names = tuple(f"added_n[{label}]" for label in covariate.labels)

    def add(column: NDArray[np.generic], values: Mapping[str, float]) -> Floats:
        labels = np.asarray(column)
        is_label = [labels == label for label in covariate.labels]
        return np.select(is_label, [values[name] for name in names], 0.0)

    return Law(
        f"added_load_{covariate.name}",
        f"F_py + b, by {covariate.name}",
        tuple(Parameter(name, "N", 0.0, -0.3, 0.6, 0.01) for name in names),
        SizedChange(_make_shift("load", "sensed_offset", by=1.0), add),
        "normal_load",
        covariate.name,
        description=f"the load differs from the weights by {covariate.name}:",
    )


def _make_step_size(covariate: CovariateRange, sizes: Names, places: Names) -> Size:
    """Size of a change that goes from level to level where a covariate passes the places.

    `sizes` and `places` are the names of the parameters; each size counts from the first level.
    """
    width = _STEP_WIDTH * (covariate.high - covariate.low)

    def step(column: NDArray[np.generic], values: Mapping[str, float]) -> Floats:
        numbers = np.asarray(column, dtype=np.float64)
        past = numbers[:, None] - [values[name] for name in places]
        rises = np.diff([values[name] for name in sizes], prepend=0.0)
        passed = 0.5 * (1.0 + np.tanh(past / (2.0 * width)))
        return np.asarray(passed @ rises)

    return step


def _make_step_place(covariate: CovariateRange) -> Parameter:
    """Make the place along a covariate at which something changes at once."""
    name = "at_trial" if covariate.name == _RUN else "at"
    reach = covariate.high - covariate.low
    middle = covariate.low + 0.5 * reach
    return Parameter(name, "1", middle, covariate.low, covariate.high, 0.02 * reach)


def _list_step_shapes(
    covariate: CovariateRange, places: Names, shares: NDArray[np.float64]
) -> tuple[dict[str, float], ...]:
    """List where a search looks for the places, by shares of the range, shape (n, places)."""
    reach = covariate.high - covariate.low
    shapes = []
    for row in shares.tolist():
        shape = {}
        for name, share in zip(places, row, strict=True):
            shape[name] = covariate.low + reach * share
        shapes.append(shape)
    return tuple(shapes)


def _make_step_law(slot: str, covariate: CovariateRange) -> Law:
    """Change a slot where a covariate passes a value: of the radius along the run a chipped tip."""
    if slot == "radius":
        return _make_chip_law(covariate)
    move = SLOT_MOVES[slot]
    place = _make_step_place(covariate)
    size = Parameter("step", "1", 0.0, -3.0, 3.0, 0.1)
    shares = np.arange(0.5, _STEP_SHAPES)[:, None] / _STEP_SHAPES
    words = "" if covariate.name == _RUN else f"a {covariate.name.replace('_', ' ')} of "
    return Law(
        f"step_{slot}_{covariate.name}",
        f"{move.form}, g from one value of {covariate.name} on",
        (size, place),
        SizedChange(move.change, _make_step_size(covariate, (size.name,), (place.name,))),
        move.slot,
        covariate.name,
        _list_step_shapes(covariate, (place.name,), shares),
        named=slot in _JUMPING,
        rank=15,
        description=f"{slot} changes at once: by {{}} in ln, from {words}{{}} on",
        steps=(place.name,),
    )


def _make_chip_law(covariate: CovariateRange) -> Law:
    """Change the radius of the tip at once along the run."""
    place = _make_step_place(covariate)
    size = Parameter("radius_step_m", "m", 0.0, -1e-4, 3e-4, 3e-6)
    shares = np.arange(0.5, _STEP_SHAPES)[:, None] / _STEP_SHAPES
    step = _make_step_size(covariate, (size.name,), (place.name,))
    return Law(
        "tip_chip",
        f"R + w from one value of {covariate.name} on",
        (size, place),
        SizedChange(_make_shift("radius", by=1.0), step),
        SLOT_MOVES["radius"].slot,
        covariate.name,
        _list_step_shapes(covariate, (place.name,), shares),
        rank=2,
        description="the tip chipped: its radius changed by {}, at {}",
        steps=(place.name,),
    )


def _make_levels_law(slot: str, covariate: CovariateRange, levels: int) -> Law:
    """Let a slot go from level to level along the run, each counted from the first."""
    move = SLOT_MOVES[slot]
    size = Parameter("step", "1", 0.0, -3.0, 3.0, 0.1)
    place = _make_step_place(covariate)
    parameters: list[Parameter] = []
    sizes, places = [], []
    for level in _LEVELS[: levels - 1]:
        sizes.append(f"{size.name}[{level}]")
        places.append(f"{place.name}[{level}]")
        parameters += [replace(size, name=sizes[-1]), replace(place, name=places[-1])]
    # where a search begins
    shares = np.arange(1, levels)[None] / levels
    return Law(
        f"step_{slot}_{covariate.name}~{levels}",
        f"{move.form}, g from one value of {covariate.name} on",
        tuple(parameters),
        SizedChange(move.change, _make_step_size(covariate, tuple(sizes), tuple(places))),
        move.slot,
        covariate.name,
        _list_step_shapes(covariate, tuple(places), shares),
        named=slot in _JUMPING,
        rank=15,
        description=f"{slot} goes from level to level along the run, by ln above the first and "
        "from:",
        steps=tuple(places),
    )


def _make_periodic_law(slot: str, covariate: CovariateRange) -> Law:
    """Let a slot swing along the run.

    Any period from a few trials to three quarters of the run may be found: what went up and down
    once need not come back.
    """
    move = SLOT_MOVES[slot]
    reach = covariate.high - covariate.low
    cosine = Parameter("cosine", "1", 0.0, -2.0, 2.0, 0.05)
    period = Parameter("period_trials", "1", 0.5 * reach, 0.8 * _SHORTEST_PERIOD, 0.75 * reach, 0.5)

    def swing(order: NDArray[np.generic], values: Mapping[str, float]) -> Floats:
        phase = 2.0 * np.pi * np.asarray(order, dtype=np.float64) / values["period_trials"]
        return np.asarray(values["cosine"] * np.cos(phase) + values["sine"] * np.sin(phase))

    # half a turn over the whole run apart, so that a fit begins within its own valley
    last_turn = min(int(2.0 * reach / _SHORTEST_PERIOD), _MOST_TURNS)
    turns = np.arange(3, last_turn + 1)
    return Law(
        f"periodic_{slot}_{covariate.name}",
        f"{move.form}, g = a cos(2 pi n / P) + b sin(2 pi n / P)",
        (cosine, replace(cosine, name="sine"), period),
        SizedChange(move.change, swing),
        move.slot,
        covariate.name,
        tuple({"period_trials": float(2.0 * reach / turn)} for turn in turns),
        rank=12,
        description=f"{slot} swings along the run: cosine {{}}, sine {{}}, every {{}} trials",
    )


def _make_trend_law(slot: str, covariate: CovariateRange) -> Law:
    """Let a slot follow a covariate along a straight line."""
    move = SLOT_MOVES[slot]
    description = ""
    is_drift = covariate.name == _RUN and slot in _JUMPING
    is_line = not is_drift and not covariate.pair
    if is_drift:
        description = f"{slot} drifts along the run, by ln"
    if is_line:
        of = format_column_label(covariate.name).partition(",")[0]
        description = f"{slot.replace('_', ' ')} follows the {of} along a line, slope"
    return Law(
        f"trend_{slot}_{covariate.name}",
        f"{move.form}, g a straight line over {covariate.name}",
        (_make_amplitude("slope"),),
        SizedChange(move.change, _follow(covariate.line, ("slope",))),
        move.slot,
        covariate.name,
        named=is_drift,
        rank=10,
        description=description,
        is_line=is_line,
    )


def _make_smooth_law(slot: str, covariate: CovariateRange) -> Law:
    """Let a slot follow a covariate along a smooth, or take a level for each label."""
    move = SLOT_MOVES[slot]
    has_levels = bool(covariate.labels) and slot in _JUMPING and covariate.name != "block"
    if has_levels:
        names = tuple(f"g[{label}]" for label in covariate.labels[1:])
        description = (
            f"{slot} has a level for each {covariate.name}, by ln above that of "
            f"{covariate.labels[0]}:"
        )
    else:
        names = tuple(f"g{number}" for number in range(1, covariate.freedom + 1))
        description = ""
    return Law(
        f"smooth_{slot}_{covariate.name}",
        f"{move.form}, g smooth over {covariate.name}",
        tuple(_make_amplitude(name) for name in names),
        SizedChange(move.change, _follow(covariate.basis, names)),
        move.slot,
        covariate.name,
        named=has_levels,
        rank=20,
        description=description,
    )


def _make_amplitude(name: str) -> Parameter:
    """Make the amplitude of a line or a smooth."""
    return Parameter(name, "1", 0.0, -3.0, 3.0, 0.1)


def _follow(basis: Callable[[NDArray[np.generic]], Floats], names: Names) -> Size:
    """Size of a change that is a sum of columns, each by its amplitude.

    A fit asks for the same column hundreds of times; the reference that is kept makes its identity
    safe.
    """
    last_column: NDArray[np.generic] | None = None
    columns: Floats = np.empty(0)

    def follow(column: NDArray[np.generic], values: Mapping[str, float]) -> Floats:
        nonlocal last_column, columns
        if last_column is not column:
            last_column, columns = column, basis(column)
        return np.asarray(columns @ np.array([values[name] for name in names]))

    return follow
