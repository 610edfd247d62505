"""Friction that depends on speed: Stribeck's fall from rest to sliding, and the logarithmic law of dry contacts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from stepblocks.contact.effects.law import Law
from stepblocks.contact.forward import Constant
from stepblocks.contact.state import DragState


def _stribeck(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    excess = values["excess"] * np.exp(-state.speed / values["stribeck_speed_m_per_s"])
    return state.changed(friction=state.friction * (1.0 + excess))


def _logarithmic(state: DragState, _: Any, values: Mapping[str, float]) -> DragState:
    factor = 1.0 + values["slope"] * np.log(state.speed / 6e-3)
    return state.changed(friction=state.friction * np.maximum(factor, 0.02))


LAWS = (
    Law(
        id="stribeck_friction",
        slot="friction",
        covariate="speed_mm_s",
        form="mu (1 + s exp(-v / v_s))",
        parameters=(
            Constant("excess", "1", 0.0, -0.95, 10.0, 0.05),
            Constant("stribeck_speed_m_per_s", "m/s", 5e-3, 5e-4, 1e-1, 1e-3),
        ),
        amplitudes=("excess",),
        apply=_stribeck,
        shapes=tuple({"stribeck_speed_m_per_s": v} for v in (1.5e-3, 4e-3, 9e-3, 2.5e-2)),
    ),
    Law(
        id="stribeck_friction~logarithmic",
        slot="friction",
        covariate="speed_mm_s",
        form="mu (1 + s ln(v / 6 mm/s))",
        parameters=(Constant("slope", "1", 0.0, -2.0, 2.0, 0.03),),
        amplitudes=("slope",),
        apply=_logarithmic,
        rank=1,
    ),
)
