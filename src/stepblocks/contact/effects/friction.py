"""How friction may follow the load, the speed, the place, or the trials made before."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from stepblocks.contact.state import DragState, Floats
from stepblocks.law import Law, Parameter

_friction = partial(Law, slot="friction")
_by_speed = partial(_friction, covariate="speed_mm_s", said="friction falls with speed: excess at rest and speed")


def _stribeck(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    excess = values["excess"] * np.exp(-state.speed / values["stribeck_speed_m_per_s"])
    return state.changed(friction=state.friction * (1.0 + excess))


def _logarithmic(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    factor = 1.0 + values["slope"] * np.log(state.speed / 6e-3)
    return state.changed(friction=state.friction * np.maximum(factor, 0.02))


def _running_in(state: DragState, order: Floats, values: Mapping[str, float]) -> DragState:
    excess = values["excess"] * np.exp(-order / values["settling_trials"])
    return state.changed(friction=state.friction * np.maximum(1.0 + excess, 0.02))


LAWS = (
    _friction(
        "load_dependent_friction",  # an elastic contact after Hertz has p = 1/3
        "mu (F_py / 0.6 N)^-p",
        (Parameter("exponent", "1", 0.0, -3.0, 3.0, 0.05),),
        lambda state, _, v: state.changed(friction=state.friction * (state.load / 0.6) ** -v["exponent"]),
        covariate="load_n",
        said="friction falls with load: exponent",
    ),
    _friction(
        "edge_friction",  # an edge is ground, coated or worn otherwise than the faces
        "e mu while the tip climbs, mu on the faces",
        (Parameter("edge_over_face", "1", 1.0, 0.1, 4.0, 0.03),),
        lambda state, _, v: state.changed(edge_factor=state.edge_factor * v["edge_over_face"]),
        said="friction on the edge over that on the faces is",
        settled="turn the blocks round, and drag a block with a fresh edge",
    ),
    _by_speed(
        "stribeck_friction",  # falls from rest to sliding
        "mu (1 + s exp(-v / v_s))",
        (
            Parameter("excess", "1", 0.0, -0.95, 10.0, 0.05),
            Parameter("stribeck_speed_m_per_s", "m/s", 5e-3, 5e-4, 1e-1, 1e-3),
        ),
        _stribeck,
        shapes=tuple({"stribeck_speed_m_per_s": v} for v in (1.5e-3, 4e-3, 9e-3, 2.5e-2)),
    ),
    _by_speed(
        "stribeck_friction~logarithmic",  # the law of dry contacts
        "mu (1 + s ln(v / 6 mm/s))",
        (Parameter("slope", "1", 0.0, -2.0, 2.0, 0.03),),
        _logarithmic,
        rank=1,
    ),
    _friction(
        "running_in",
        "mu (1 + s exp(-n / n0))",
        (Parameter("excess", "1", 0.0, -0.95, 20.0, 0.05), Parameter("settling_trials", "1", 50.0, 3.0, 1000.0, 10.0)),
        _running_in,
        covariate="run_order",
        shapes=tuple({"settling_trials": n} for n in (15.0, 40.0, 100.0, 400.0)),
        said="friction runs in: excess at first and trials to settle",
    ),
)
