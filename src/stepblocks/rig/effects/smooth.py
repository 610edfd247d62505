"""Any slot as a smooth function of any covariate: the way in for an effect that nobody foresaw."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepblocks.lawsearch.law import Law, Parameter, SizedChange
from stepblocks.rig.forward import SPEED_OVER_LOAD
from stepblocks.rig.state import DragState, Floats

Change = Callable[[DragState, Floats], DragState]

_PIECES = 4


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
        return len(self.labels) - 1 if self.labels else min(_PIECES, self.distinct - 1)

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
            # a label that the data had not is taken for the mean of all
            other = ~np.isin(column, self.labels) / len(self.labels)
            return np.stack([(column == label) + other for label in self.labels[1:]], axis=1)
        if self.freedom < _PIECES:
            return self.line(column) ** np.arange(1, self.freedom + 1)
        # a constant belongs to the nominal model: one spline goes, the rest vanish in the middle
        knots = np.concatenate([np.zeros(3), np.linspace(0.0, 1.0, _PIECES - 1), np.ones(3)])
        design = BSpline(knots, np.eye(_PIECES + 1), 3)(np.append(self.unit(column), 0.5))
        return np.asarray((design[:-1] - design[-1])[:, [0, 1, 3, 4]])


def _make_scaling(between: tuple[float, float] | None = None, **powers: float) -> Change:
    # Multiply each slot by a power of exp g
    def change(state: DragState, g: Floats) -> DragState:
        held = g if between is None else np.clip(g, *between)
        return state.changed(
            **{slot: getattr(state, slot) * np.exp(power * held) for slot, power in powers.items()}
        )

    return change


def _make_shift(*slots: str, by: float = 0.1) -> Change:
    return lambda state, g: state.changed(**{slot: getattr(state, slot) + by * g for slot in slots})


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
    "seen_load": Move(
        "normal_load",
        "F_py exp g, seen by the gauge",
        lambda s, g: s.changed(
            load=s.load * np.exp(g),
            sensed_offset=s.sensed_offset + (s.set_load + s.sensed_offset) * np.expm1(g),
        ),
    ),
    "load_offset": Move("normal_load", "F_py + 0.1 N g", _make_shift("load", "sensed_offset")),
    "climb_load": Move(
        "normal_load",
        "F_py exp g while climbing",
        lambda s, g: s.changed(climb_load=s.climb_load + s.set_load * np.expm1(g)),
    ),
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
_LEVELS = ("second", "third", "fourth", "fifth")
_STEP_SHAPES = 12  # places along the run at which a search looks for a sudden change


def list_smooth_laws(covariates: Sequence[CovariateRange]) -> tuple[Law, ...]:
    """Return every slot over every covariate as a line, a smooth and a jump, along the run a swing.

    What the log implies, such as the passes over a block, moves a few slots alone.
    """
    laws: list[Law] = []
    for where in covariates:
        for name in _MOVED_BY.get(where.name, SLOT_MOVES):
            # pauses are short or long, and a line through two heaps says no more than a jump
            if where.pair or (not where.labels and where.distinct > 2 and where.name != "pause_s"):
                laws.append(_make_covariate_law("trend", name, where))
            if not where.pair:
                laws.append(_make_covariate_law("smooth", name, where))
        if where.labels and where.name != "block":
            laws.append(_make_added_load_law(where))
        if where.labels or where.pair or where.distinct <= 2 * _STEP_SHAPES:
            continue
        run = where.name == "run_order"
        laws += [_make_step_law(name, where) for name in (_STEPPING if run else _JUMPING)]
        for name in _JUMPING if run else ():
            laws += [_make_step_law(name, where, levels) for levels in range(3, len(_LEVELS) + 2)]
            laws.append(_make_periodic_law(name, where))
    return tuple(laws)


def _make_added_load_law(covariate: CovariateRange) -> Law:
    # Each label presses by its own force more than the weights
    names = tuple(f"added_n[{label}]" for label in covariate.labels)

    def add(column: NDArray[np.generic], values: Mapping[str, float]) -> Floats:
        return np.select(
            [np.asarray(column) == label for label in covariate.labels],
            [values[n] for n in names],
            0.0,
        )

    return Law(
        f"added_load_{covariate.name}",
        f"F_py + b, by {covariate.name}",
        tuple(Parameter(name, "N", 0.0, -0.3, 0.6, 0.01) for name in names),
        SizedChange(_make_shift("load", "sensed_offset", by=1.0), add),
        "normal_load",
        covariate.name,
        description=f"the load differs from the weights by {covariate.name}:",
    )


def _make_step_law(name: str, covariate: CovariateRange, levels: int = 2) -> Law:
    # Change a slot where a covariate passes a value: of the radius along the run a chipped tip. Of
    # more than two levels each counts from the first.
    run = covariate.name == "run_order"
    move = SLOT_MOVES[name]
    chip = name == "radius"
    several = levels > 2
    reach = covariate.high - covariate.low
    width = 2e-3 * reach  # a hundredth of the spacing would leave a fit no way to move
    marks = [f"[{one}]" for one in _LEVELS[: levels - 1]] if several else [""]
    at = Parameter(
        "at_trial" if run else "at",
        "1",
        covariate.low + 0.5 * reach,
        covariate.low,
        covariate.high,
        0.02 * reach,
    )
    size = (
        Parameter("radius_step_m", "m", 0.0, -1e-4, 3e-4, 3e-6)
        if chip
        else Parameter("step", "1", 0.0, -3.0, 3.0, 0.1)
    )
    sizes, places = ([replace(one, name=one.name + mark) for mark in marks] for one in (size, at))

    def step(order: NDArray[np.generic], values: Mapping[str, float]) -> Floats:
        past = np.asarray(order, dtype=np.float64)[:, None] - [values[p.name] for p in places]
        rises = np.diff([values[p.name] for p in sizes], prepend=0.0)
        return np.asarray(0.5 * (1.0 + np.tanh(past / (2.0 * width))) @ rises)

    # where one change is looked for, or several to begin with
    shares = (
        np.arange(1, levels)[None] / levels
        if several
        else np.arange(0.5, _STEP_SHAPES)[:, None] / _STEP_SHAPES
    )
    description = (
        f"{name} goes from level to level along the run, by ln above the first and from:"
        if several
        else f"{name} changes at once: by {{}} in ln, "
        f"from {'' if run else 'a ' + covariate.name.replace('_', ' ') + ' of '}{{}} on"
    )
    return Law(
        "tip_chip" if chip else f"step_{name}_{covariate.name}{f'~{levels}' if several else ''}",
        f"{'R + w' if chip else f'{move.form}, g'} from one value of {covariate.name} on",
        tuple(one for pair in zip(sizes, places, strict=True) for one in pair),
        SizedChange(_make_shift("radius", by=1.0) if chip else move.change, step),
        move.slot,
        covariate.name,
        tuple(
            {
                p.name: covariate.low + reach * float(share)
                for p, share in zip(places, row, strict=True)
            }
            for row in shares
        ),
        named=chip or name in _JUMPING,
        rank=2 if chip else 15,
        description="the tip chipped: its radius changed by {}, at {}" if chip else description,
        steps=tuple(p.name for p in places),
    )


def _make_periodic_law(name: str, covariate: CovariateRange) -> Law:
    # Let a slot swing along the run, with any period from a few trials to three quarters of it:
    # what went up and down once need not come back
    move = SLOT_MOVES[name]
    reach = covariate.high - covariate.low
    parts = tuple(Parameter(part, "1", 0.0, -2.0, 2.0, 0.05) for part in ("cosine", "sine"))
    period = Parameter("period_trials", "1", 0.5 * reach, 0.8 * _SHORTEST_PERIOD, 0.75 * reach, 0.5)

    def swing(order: NDArray[np.generic], values: Mapping[str, float]) -> Floats:
        phase = 2.0 * np.pi * np.asarray(order, dtype=np.float64) / values["period_trials"]
        return np.asarray(values["cosine"] * np.cos(phase) + values["sine"] * np.sin(phase))

    # half a turn over the whole run apart, so that a fit begins within its own valley; 250 turns at
    # most, for of thousands of trials the shorter periods would be most of the work
    turns = np.arange(3, min(int(2.0 * reach / _SHORTEST_PERIOD), 500) + 1)
    return Law(
        f"periodic_{name}_{covariate.name}",
        f"{move.form}, g = a cos(2 pi n / P) + b sin(2 pi n / P)",
        (*parts, period),
        SizedChange(move.change, swing),
        move.slot,
        covariate.name,
        tuple({"period_trials": float(2.0 * reach / turn)} for turn in turns),
        rank=12,
        description=f"{name} swings along the run: cosine {{}}, sine {{}}, every {{}} trials",
    )


def _make_covariate_law(kind: str, slot: str, covariate: CovariateRange) -> Law:
    move = SLOT_MOVES[slot]
    trend = kind == "trend"
    labels = covariate.labels if slot in _JUMPING and covariate.name != "block" else ()
    names = ("slope",) if trend else tuple(f"g{i + 1}" for i in range(covariate.freedom))
    names = tuple(f"g[{label}]" for label in labels[1:]) or names
    description = ""
    if labels:
        description = (
            f"{slot} has a level for each {covariate.name}, by ln above that of {labels[0]}:"
        )
    elif trend and covariate.name == "run_order" and slot in _JUMPING:
        description = f"{slot} drifts along the run, by ln"
    basis = covariate.line if trend else covariate.basis
    last: list[NDArray[np.generic] | None] = [None, None]

    def follow(column: NDArray[np.generic], values: Mapping[str, float]) -> Floats:
        # a fit asks for the same column hundreds of times; the reference kept makes its identity
        # safe
        if last[0] is not column:
            last[:] = [column, basis(column)]
        return np.asarray(last[1] @ np.array([values[name] for name in names]))

    return Law(
        f"{kind}_{slot}_{covariate.name}",
        f"{move.form}, g {'a straight line' if trend else 'smooth'} over {covariate.name}",
        tuple(Parameter(name, "1", 0.0, -3.0, 3.0, 0.1) for name in names),
        SizedChange(move.change, follow),
        move.slot,
        covariate.name,
        named=bool(description),
        rank=10 if trend else 20,
        description=description,
    )
