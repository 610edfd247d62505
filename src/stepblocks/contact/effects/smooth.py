"""Any slot as a smooth function of any covariate: the way in for an effect that nobody foresaw."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from stepblocks.contact.effects.law import Law
from stepblocks.contact.forward import Constant
from stepblocks.contact.state import DragState, Floats

_PIECES = 4


@dataclass(frozen=True)
class CovariateRange:
    """Where a covariate lay in the data: numbers from `low` to `high`, or labels; `log` where it spans a decade."""

    name: str  # Column, or a model quantity
    low: float = 0.0  # Range of its numbers; unused for labels
    high: float = 1.0
    log: bool = False  # Whether it is laid out by its logarithm
    labels: tuple[str, ...] = ()  # Its labels; empty for numbers
    distinct: int = 100  # How many different numbers it takes

    def unit(self, column: NDArray[Any]) -> Floats:
        """Lay numbers out from 0 to 1; beyond the range they stay at its end."""
        numbers = np.asarray(column, dtype=np.float64)
        low, high = self.low, self.high
        if self.log:
            numbers, low, high = np.log(np.maximum(numbers, 1e-12)), float(np.log(low)), float(np.log(high))
        return np.asarray(np.clip((numbers - low) / (high - low), 0.0, 1.0))

    def basis(self, column: NDArray[Any]) -> Floats:
        """Columns of the smooth, each zero in the middle of the range: cubic B-splines, or one per label."""
        if self.labels:
            return np.stack([np.asarray(column == label, dtype=np.float64) for label in self.labels[1:]], axis=1)
        size = min(_PIECES, self.distinct - 1)
        if size < _PIECES:
            x = 2.0 * self.unit(column) - 1.0
            return np.stack([x ** (i + 1) for i in range(size)], axis=1)
        unit = self.unit(column)
        powers = np.stack([np.ones_like(unit), unit, unit**2, unit**3], axis=1)
        lower, upper = _spline_pieces()
        return np.where((unit < 0.5)[:, None], powers @ lower, powers @ upper)


@lru_cache(maxsize=1)
def _spline_pieces() -> tuple[Floats, Floats]:
    """Polynomials of the cubic B-splines on both halves of 0 to 1; a basis is wanted thousands of times."""
    knots = np.concatenate([np.zeros(3), np.linspace(0.0, 1.0, _PIECES - 1), np.ones(3)])
    middle = BSpline.design_matrix(np.array([0.5]), knots, 3).toarray()
    pieces = []
    for start in (0.0, 0.5):
        x = start + np.linspace(0.0, 0.49, 4)
        design = BSpline.design_matrix(x, knots, 3).toarray()
        # a constant belongs to the nominal model: one spline goes, the rest vanish in the middle
        pieces.append(np.linalg.solve(np.vander(x, 4, increasing=True), (design - middle)[:, [0, 1, 3, 4]]))
    return pieces[0], pieces[1]


Move = Callable[[DragState, Floats], DragState]

# How a smooth g enters each slot; several ways where the bench may show a slot in several ways
SLOT_MOVES: dict[str, tuple[str, Move]] = {
    "radius": ("contact_geometry", lambda s, g: s.changed(radius=s.radius * np.exp(np.clip(g, -1.0, 1.5)))),
    "height": ("contact_geometry", lambda s, g: s.changed(height=s.height + 1e-5 * g)),
    "friction": ("friction", lambda s, g: s.changed(friction=s.friction * np.exp(np.clip(g, -4.0, 2.0)))),
    "load": ("normal_load", lambda s, g: s.changed(load=s.load * np.exp(g))),
    "seen_load": (
        "normal_load",
        lambda s, g: s.changed(
            load=s.load * np.exp(g), sensed_offset=s.sensed_offset + (s.set_load + s.sensed_offset) * np.expm1(g)
        ),
    ),
    "climb_load": ("normal_load", lambda s, g: s.changed(climb_load=s.climb_load + s.set_load * np.expm1(g))),
    "stiffness": (
        "stiffness",
        lambda s, g: s.changed(stiffness=s.stiffness * np.exp(g), ring_stiffness=s.ring_stiffness * np.exp(g)),
    ),
    "weighed_stiffness": (
        "stiffness",
        lambda s, g: s.changed(
            stiffness=s.stiffness * np.exp(g),
            ring_stiffness=s.ring_stiffness * np.exp(g),
            conversion=s.conversion * np.exp(-g),
        ),
    ),
    "ramp_stiffness": ("stiffness", lambda s, g: s.changed(stiffness=s.stiffness * np.exp(g))),
    "conversion": ("conversion", lambda s, g: s.changed(conversion=s.conversion * np.exp(g))),
    "drag": ("drag", lambda s, g: s.changed(drag=s.drag + 0.1 * g)),
    "climb_drag": ("drag", lambda s, g: s.changed(climb_drag=s.climb_drag + 0.1 * g)),
    "gain": ("sensor", lambda s, g: s.changed(gain=s.gain * np.exp(g))),
}

_FORMS = {
    "radius": "(R + r) exp g",
    "height": "H + 10 um g",
    "friction": "mu exp g",
    "load": "F_py exp g, unseen by the gauge",
    "seen_load": "F_py exp g, seen by the gauge",
    "climb_load": "F_py exp g while climbing",
    "stiffness": "k exp g",
    "weighed_stiffness": "k exp g, energies weighed with it",
    "ramp_stiffness": "k exp g, ring unchanged",
    "conversion": "C_v exp g",
    "drag": "F_x + 0.1 N g",
    "climb_drag": "F_px + 0.1 N g",
    "gain": "gauge gain exp g",
}


def _law(move: str, where: CovariateRange, kind: str, names: tuple[str, ...], basis: Any, start: float = 0.0) -> Law:
    slot, change = SLOT_MOVES[move]

    last: list[Any] = [None, None]

    def apply(state: DragState, column: NDArray[Any], values: Mapping[str, float]) -> DragState:
        # a fit asks for the same column hundreds of times; the reference kept makes its identity safe
        if last[0] is not column:
            last[:] = [column, basis(column)]
        weights = np.array([values[name] for name in names])
        return change(state, last[1] @ weights)

    return Law(
        id=f"{kind}_{move}_{where.name}",
        slot=slot,
        covariate=where.name,
        form=f"{_FORMS[move]}, g {'a straight line' if kind == 'trend' else 'smooth'} over {where.name}",
        parameters=tuple(Constant(name, "1", start, -3.0, 3.0, 0.1) for name in names),
        amplitudes=names,
        apply=apply,
        named=False,
        rank=10 if kind == "trend" else 20,
    )


def smooth_law(move: str, where: CovariateRange) -> Law:
    """Return a smooth of a slot over a covariate."""
    count = len(where.labels) - 1 if where.labels else min(_PIECES, where.distinct - 1)
    return _law(move, where, "smooth", tuple(f"g{i + 1}" for i in range(count)), where.basis)


def trend_law(move: str, where: CovariateRange) -> Law:
    """Return a straight line of a slot over the laid-out covariate; one parameter, from -g to g over the range."""

    def line(column: NDArray[Any]) -> Floats:
        return (2.0 * where.unit(column) - 1.0)[:, None]

    return _law(move, where, "trend", ("slope",), line)
