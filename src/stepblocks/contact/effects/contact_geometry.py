"""What tip, edge and step may be other than stated: radius, height, tilt, and how far they give way."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from stepblocks.contact.effects.law import Law, Parameter
from stepblocks.contact.state import DragState, Floats

SLOT = "contact_geometry"


def _creeping(state: DragState, time: Floats, values: Mapping[str, float]) -> DragState:
    given = values["creep_depth_m"] * np.log1p(time / values["creep_time_s"])
    return state.changed(height=np.maximum(state.height - given, 0.05 * state.height))


LAWS = (
    Law(
        "edge_rounding",
        SLOT,
        "none",
        "a = arccos(1 - H / (R + r))",
        (Parameter("edge_radius_m", "m", 0.0, 0.0, 3e-4, 5e-6),),
        lambda state, _, v: state.changed(radius=state.radius + v["edge_radius_m"]),
    ),
    Law(
        "tip_wear",
        SLOT,
        "run_order",
        "R(n) = R + w n",
        (Parameter("growth_m_per_trial", "m", 0.0, 0.0, 5e-6, 3e-8),),
        lambda state, order, v: state.changed(radius=state.radius + v["growth_m_per_trial"] * order),
    ),
    Law(
        "tip_radius_error",
        SLOT,
        "none",
        "R -> R + w; the same as a rounded edge, which a scan must rule out",
        (Parameter("radius_error_m", "m", 0.0, -1e-4, 3e-4, 5e-6),),
        lambda state, _, v: state.changed(radius=state.radius + v["radius_error_m"]),
        rank=1,
    ),
    Law(
        "tip_flat",  # the ball rides lower by the depth of the flat, and every step stands higher by it
        SLOT,
        "none",
        "a = arccos(1 - (H + d) / R), flat of half width sqrt(2 R d)",
        (Parameter("flat_depth_m", "m", 0.0, 0.0, 3e-5, 1e-6),),
        lambda state, _, v: state.changed(height=state.height + v["flat_depth_m"]),
        rank=1,
    ),
    Law(
        "block_tilt",  # along the drag: the same as friction tan(atan mu + t), for every force and energy
        SLOT,
        "none",
        "a -> a + t",
        (Parameter("tilt_rad", "rad", 0.0, -0.3, 0.3, 0.01),),
        lambda state, _, v: state.changed(tilt=state.tilt + v["tilt_rad"]),
        rank=5,
    ),
    Law(
        "elastic_indentation",  # after Hertz
        SLOT,
        "load_n",
        "H -> H - d (F_py / 1 N)^(2/3)",
        (Parameter("depth_at_1n_m", "m", 0.0, -5e-6, 5e-5, 1e-6),),
        lambda state, _, v: state.changed(height=state.height - v["depth_at_1n_m"] * state.load ** (2.0 / 3.0)),
    ),
    Law(
        "contact_creep",
        SLOT,
        "loading_time_s",
        "H -> H - c ln(1 + t / t0), t the time from the first load on the edge to release",
        (
            Parameter("creep_depth_m", "m", 0.0, -1e-5, 2e-5, 3e-7),
            Parameter("creep_time_s", "s", 20e-3, 1e-3, 1.0, 5e-3),
        ),
        _creeping,
        shapes=tuple({"creep_time_s": t} for t in (5e-3, 20e-3, 80e-3)),
    ),
)


def height_error(block: str) -> Law:
    """Return the effect of a block far from its nominal height; small errors are priors of the nominal model."""

    def apply(state: DragState, blocks: Any, values: Mapping[str, float]) -> DragState:
        return state.changed(height=state.height + values["height_error_m"] * (blocks == block))

    return Law(
        f"block_height_error~{block}",
        SLOT,
        "block",
        f"H -> H + h on {block}",
        (Parameter("height_error_m", "m", 0.0, -4e-5, 4e-5, 1e-6),),
        apply,
    )
