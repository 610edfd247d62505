"""What tip, edge and step may be other than stated: radius, height, tilt, wear, and how far they give way."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from stepblocks.contact.state import DragState
from stepblocks.law import Law, Parameter

_geometry = partial(Law, slot="contact_geometry")

LAWS = (
    _geometry(
        "edge_rounding",
        "a = arccos(1 - H / (R + r))",
        (Parameter("edge_radius_m", "m", 0.0, 0.0, 3e-4, 5e-6),),
        lambda state, _, v: state.changed(radius=state.radius + v["edge_radius_m"]),
        said="edges are rounded: r =",
        settled="scan the edges, or drag the same blocks with another tip",
    ),
    _geometry(
        "tip_wear",
        "R(n) = R + w n",
        (Parameter("growth_m_per_trial", "m", 0.0, 0.0, 5e-6, 3e-8),),
        lambda state, order, v: state.changed(radius=state.radius + v["growth_m_per_trial"] * order),
        covariate="run_order",
        said="the tip wears: its radius grows per trial by",
        settled="swap the tip",
    ),
    _geometry(
        "tip_radius_error",
        "R -> R + w; the same as a rounded edge, which a scan must rule out",
        (Parameter("radius_error_m", "m", 0.0, -1e-4, 3e-4, 5e-6),),
        lambda state, _, v: state.changed(radius=state.radius + v["radius_error_m"]),
        rank=1,
        said="the tip is larger than stated by",
        settled="swap the tip, or measure it",
    ),
    _geometry(
        "tip_flat",  # the ball rides lower by the depth of the flat, and every step stands higher by it
        "a = arccos(1 - (H + d) / R), flat of half width sqrt(2 R d)",
        (Parameter("flat_depth_m", "m", 0.0, 0.0, 3e-5, 1e-6),),
        lambda state, _, v: state.changed(height=state.height + v["flat_depth_m"]),
        rank=1,
        said="the tip has a flat, of a depth of",
        settled="swap the tip",
    ),
    _geometry(
        "block_tilt",  # along the drag: the same as friction tan(atan mu + t), for every force and energy
        "a -> a + t",
        (Parameter("tilt_rad", "rad", 0.0, -0.3, 0.3, 0.01),),
        lambda state, _, v: state.changed(tilt=state.tilt + v["tilt_rad"]),
        rank=5,
        said="the blocks are tilted by",
        settled="turn the blocks round: a tilt changes its sign",
    ),
    _geometry(
        "elastic_indentation",  # after Hertz
        "H -> H - d (F_py / 1 N)^(2/3)",
        (Parameter("depth_at_1n_m", "m", 0.0, -5e-6, 5e-5, 1e-6),),
        lambda state, _, v: state.changed(height=state.height - v["depth_at_1n_m"] * state.load ** (2.0 / 3.0)),
        covariate="load_n",
        said="the contact gives way: depth at 1 N",
    ),
)


def height_error(block: str) -> Law:
    """Return the effect of a block far from its nominal height; small errors are priors of the nominal model."""

    def apply(state: DragState, blocks: Any, values: Mapping[str, float]) -> DragState:
        return state.changed(height=state.height + values["height_error_m"] * (blocks == block))

    parameters = (Parameter("height_error_m", "m", 0.0, -4e-5, 4e-5, 1e-6),)
    return _geometry(f"block_height_error~{block}", f"H -> H + h on {block}", parameters, apply, covariate="block")
