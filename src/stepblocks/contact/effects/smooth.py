"""Any slot as a smooth function of any covariate: the way in for an effect that nobody foresaw."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.state import DragState, Floats
from stepblocks.law import Law, Parameter

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
    pair: tuple[CovariateRange, ...] = ()

    @property
    def freedom(self) -> int:
        """Columns of its smooth."""
        return len(self.labels) - 1 if self.labels else min(_PIECES, self.distinct - 1)

    def unit(self, column: NDArray[Any]) -> Floats:
        """Lay numbers out from 0 to 1; beyond the range they stay at its end."""
        numbers = np.asarray(column, dtype=np.float64)
        low, high = self.low, self.high
        if self.log:
            numbers, low, high = (
                np.log(np.maximum(numbers, 1e-12)),
                float(np.log(low)),
                float(np.log(high)),
            )
        return np.asarray(np.clip((numbers - low) / (high - low), 0.0, 1.0))

    def line(self, column: NDArray[Any]) -> Floats:
        """Return the one column of a straight line, from -1 to 1 over the range.

        Of a pair the product of two.
        """
        if self.pair:
            first, second = self.pair
            return first.line(column[:, 0]) * second.line(column[:, 1])
        return (2.0 * self.unit(column) - 1.0)[:, None]

    def basis(self, column: NDArray[Any]) -> Floats:
        """Columns of the smooth, each zero in the middle of the range.

        Cubic B-splines, or one per label.
        """
        from scipy.interpolate import BSpline

        if self.labels:
            return np.stack(
                [np.asarray(column == label, dtype=np.float64) for label in self.labels[1:]], axis=1
            )
        if self.freedom < _PIECES:
            return self.line(column) ** np.arange(1, self.freedom + 1)
        # a constant belongs to the nominal model: one spline goes, the rest vanish in the middle
        unit, knots = (
            self.unit(column),
            np.concatenate([np.zeros(3), np.linspace(0.0, 1.0, _PIECES - 1), np.ones(3)]),
        )
        design = BSpline.design_matrix(np.append(unit, 0.5), knots, 3).toarray()
        return np.asarray((design[:-1] - design[-1])[:, [0, 1, 3, 4]])


def _scale_slots(*slots: str, between: tuple[float, float] | None = None) -> Change:
    def change(state: DragState, g: Floats) -> DragState:
        factor = np.exp(g if between is None else np.clip(g, *between))
        return state.changed(**{slot: getattr(state, slot) * factor for slot in slots})

    return change


def _move_slots(*slots: str, by: float = 0.1) -> Change:
    return lambda state, g: state.changed(**{slot: getattr(state, slot) + by * g for slot in slots})


def _scale_seen_load(state: DragState, g: Floats) -> DragState:
    seen = (state.set_load + state.sensed_offset) * np.expm1(g)
    return state.changed(load=state.load * np.exp(g), sensed_offset=state.sensed_offset + seen)


def _scale_weighed_stiffness(state: DragState, g: Floats) -> DragState:
    stiffer = _scale_slots("stiffness", "ring_stiffness")(state, g)
    return stiffer.changed(conversion=state.conversion * np.exp(-g))


class Move(NamedTuple):
    """How a smooth g enters a slot."""

    slot: str
    form: str
    change: Change


# several ways where the bench may show a slot in several ways
SLOT_MOVES = {
    "radius": Move(
        "contact_geometry", "(R + r) exp g", _scale_slots("radius", between=(-1.0, 1.5))
    ),
    "height": Move("contact_geometry", "H + 10 um g", _move_slots("height", by=1e-5)),
    "friction": Move("friction", "mu exp g", _scale_slots("friction", between=(-4.0, 2.0))),
    "load": Move("normal_load", "F_py exp g, unseen by the gauge", _scale_slots("load")),
    "seen_load": Move("normal_load", "F_py exp g, seen by the gauge", _scale_seen_load),
    "load_offset": Move("normal_load", "F_py + 0.1 N g", _move_slots("load", "sensed_offset")),
    "climb_load": Move(
        "normal_load",
        "F_py exp g while climbing",
        lambda s, g: s.changed(climb_load=s.climb_load + s.set_load * np.expm1(g)),
    ),
    "stiffness": Move("stiffness", "k exp g", _scale_slots("stiffness", "ring_stiffness")),
    "weighed_stiffness": Move(
        "stiffness", "k exp g, energies weighed with it", _scale_weighed_stiffness
    ),
    "ramp_stiffness": Move("stiffness", "k exp g, ring unchanged", _scale_slots("stiffness")),
    "conversion": Move("conversion", "C_v exp g", _scale_slots("conversion")),
    "drag": Move("drag", "F_x + 0.1 N g", _move_slots("drag")),
    "climb_drag": Move("drag", "F_px + 0.1 N g", _move_slots("climb_drag")),
    "gain": Move("sensor", "gauge gain exp g", _scale_slots("gain")),
}


_STEPPING = ("radius", "friction", "conversion", "seen_load", "gain")
_BY_BLOCK = ("radius", "friction", "conversion")  # what a batch of blocks may have of its own
_STEP_SHAPES = 12  # places along the run at which a search looks for a sudden change


def list_smooth_laws(covariates: Sequence[CovariateRange]) -> tuple[Law, ...]:
    """Return every slot over every covariate, as a straight line, a smooth.

    And along the run as a step.
    """
    laws: list[Law] = []
    for where in covariates:
        for name in _BY_BLOCK if where.name == "block" else SLOT_MOVES:
            if where.pair or (not where.labels and where.distinct > 2):
                laws.append(_smooth_law("trend", name, where))
            if not where.pair:
                laws.append(_smooth_law("smooth", name, where))
        if where.labels and where.name != "block":
            laws.append(_offset_law(where))
        if where.name == "run_order" and where.distinct > 4 * _STEP_SHAPES // 2:
            laws += [_step_law(name, where) for name in _STEPPING]
    return tuple(laws)


def _offset_law(where: CovariateRange) -> Law:
    """Each label presses by its own force more than the weights."""
    names = tuple(f"added_n[{label}]" for label in where.labels)

    def apply(state: DragState, column: NDArray[Any], values: Mapping[str, float]) -> DragState:
        added = np.select(
            [np.asarray(column) == label for label in where.labels], [values[n] for n in names], 0.0
        )
        return state.changed(load=state.load + added, sensed_offset=state.sensed_offset + added)

    parameters = tuple(Parameter(name, "N", 0.0, -0.3, 0.6, 0.01) for name in names)
    form = f"F_py + b, by {where.name}"
    said = f"the load differs from the weights by {where.name}:"
    return Law(
        f"added_load_{where.name}", form, parameters, apply, "normal_load", where.name, said=said
    )


def _step_law(name: str, where: CovariateRange) -> Law:
    """Change a slot at one trial.

    Of the radius a chipped tip, of others nothing that has a name.
    """
    move, chip = SLOT_MOVES[name], name == "radius"
    reach = where.high - where.low
    width = 2e-3 * reach  # a hundredth of the spacing would leave a fit no way to move
    at = Parameter("at_trial", "1", where.low + 0.5 * reach, where.low, where.high, 0.02 * reach)
    size = (
        Parameter("radius_step_m", "m", 0.0, -1e-4, 3e-4, 3e-6)
        if chip
        else Parameter("step", "1", 0.0, -3.0, 3.0, 0.1)
    )

    def apply(state: DragState, order: NDArray[Any], values: Mapping[str, float]) -> DragState:
        after = 0.5 * (
            1.0
            + np.tanh((np.asarray(order, dtype=np.float64) - values["at_trial"]) / (2.0 * width))
        )
        g = values[size.name] * after
        return state.changed(radius=state.radius + g) if chip else move.change(state, g)

    shapes = tuple(
        {"at_trial": where.low + reach * (i + 0.5) / _STEP_SHAPES} for i in range(_STEP_SHAPES)
    )
    form = "R + w from one trial on" if chip else f"{move.form}, g from one trial on"
    return Law(
        "tip_chip" if chip else f"step_{name}_{where.name}",
        form,
        (size, at),
        apply,
        move.slot,
        where.name,
        shapes,
        named=chip,
        rank=2 if chip else 15,
        said="the tip chipped: its radius changed by, at trial" if chip else "",
    )


def _smooth_law(kind: str, name: str, where: CovariateRange) -> Law:
    move, trend = SLOT_MOVES[name], kind == "trend"
    names = ("slope",) if trend else tuple(f"g{i + 1}" for i in range(where.freedom))
    basis = where.line if trend else where.basis
    last: list[Any] = [None, None]

    def apply(state: DragState, column: NDArray[Any], values: Mapping[str, float]) -> DragState:
        # a fit asks for the same column hundreds of times; the reference kept makes its identity
        # safe
        if last[0] is not column:
            last[:] = [column, basis(column)]
        return move.change(state, last[1] @ np.array([values[name] for name in names]))

    return Law(
        f"{kind}_{name}_{where.name}",
        f"{move.form}, g {'a straight line' if trend else 'smooth'} over {where.name}",
        tuple(Parameter(name, "1", 0.0, -3.0, 3.0, 0.1) for name in names),
        apply,
        move.slot,
        where.name,
        named=False,
        rank=10 if trend else 20,
    )
