"""Effects of the contact's geometry: what changes radius, height or slope of the edge."""

from collections.abc import Mapping
from functools import partial

import numpy as np

from stepblocks.lawsearch.law import Law, Parameter
from stepblocks.rig.state import DragState, Floats, Labels, indent_contact

_geometry = partial(Law, slot="contact_geometry")

_HERTZ_POWER = 2.0 / 3.0  # of the load, which the depth of a ball on an edge follows


def _add_edge_radius(state: DragState, _: object, law_values: Mapping[str, float]) -> DragState:
    """Round every edge by a radius."""
    return state.shifted(radius=law_values["edge_radius_m"])


def _add_tip_wear(
    state: DragState, run_order: Floats, law_values: Mapping[str, float]
) -> DragState:
    """Let the radius of the tip grow with every trial."""
    growth = law_values["growth_m_per_trial"] * run_order
    return state.shifted(radius=growth)


def _add_edge_wear(
    state: DragState, passes_of_block: Floats, law_values: Mapping[str, float]
) -> DragState:
    """Let the radius of an edge grow with every pass over its block."""
    growth = law_values["growth_m_per_pass"] * passes_of_block
    return state.shifted(radius=growth)


def _change_tip_radius(state: DragState, _: object, law_values: Mapping[str, float]) -> DragState:
    """Let the tip have another radius than stated."""
    return state.shifted(radius=law_values["radius_error_m"])


def _add_tip_flat(state: DragState, _: object, law_values: Mapping[str, float]) -> DragState:
    """Let the ball ride lower by the depth of a flat: every step stands higher by it."""
    return state.shifted(height=law_values["flat_depth_m"])


def _tilt_blocks(state: DragState, _: object, law_values: Mapping[str, float]) -> DragState:
    """Tilt the blocks along the drag."""
    return state.shifted(tilt=law_values["tilt_rad"])


def _indent_contact(
    power: float, state: DragState, _: object, law_values: Mapping[str, float]
) -> DragState:
    """Let the contact give way by a power of the load."""
    return indent_contact(state, law_values["depth_at_1n_m"], power)


def _change_block_height(
    block: str, state: DragState, blocks: Labels, law_values: Mapping[str, float]
) -> DragState:
    """Let one block have another height than stated."""
    is_block = blocks == block
    error = law_values["height_error_m"] * is_block
    return state.shifted(height=error)


def _exchange_block_heights(
    first: str, second: str, state: DragState, blocks: Labels, law_values: Mapping[str, float]
) -> DragState:
    """Add the difference of two blocks to the height of the first, and take it from the second."""
    is_first = (blocks == first).astype(np.float64)
    is_second = blocks == second
    direction = is_first - is_second
    difference = law_values["difference_m"] * direction
    return state.shifted(height=difference)


def _make_indentation_law(variant: str, power: float, rank: int) -> Law:
    """Make the law of an edge that indents the ball after Hertz, or of a yielding holder."""
    return _geometry(
        f"elastic_indentation{variant}",
        f"cos a = (R - H) / (R - d N^p), p = {power:.3g}, N = F_py cos(atan mu) / cos(a + "
        "atan mu) across the edge",
        (Parameter("depth_at_1n_m", "m", 0.0, 0.0, 5e-5, 1e-6),),
        partial(_indent_contact, power),
        covariate="load_n",
        rank=rank,
        description="the contact gives way: depth at 1 N",
    )


def make_height_error_law(block: str) -> Law:
    """Make the law of a block far from its nominal height.

    Small errors are priors of the nominal model.
    """
    return _geometry(
        f"block_height_error~{block}",
        f"H -> H + h on {block}",
        (Parameter("height_error_m", "m", 0.0, -4e-5, 4e-5, 1e-6),),
        partial(_change_block_height, block),
        covariate="block",
        description=f"the height of block {block} differs from the stated one by",
        how_to_decide=f"scan or gauge the block {block}",
        specimens=(block,),
    )


def make_exchange_law(first: str, second: str) -> Law:
    """Make the law of two blocks whose labels are exchanged throughout a session."""
    pair = f"{first} and {second}"
    difference = Parameter("difference_m", "m", 0.0, -1e-3, 1e-3, 1e-6)
    return _geometry(
        f"exchanged_blocks~{first}~{second}",
        f"the heights of {pair} exchanged",
        (difference,),
        partial(_exchange_block_heights, first, second),
        covariate="block",
        rank=-1,
        description=f"the labels of the blocks {pair} are exchanged: their heights differ by",
        how_to_decide=f"scan or gauge the blocks {pair}",
        specimens=(first, second),
    )


GEOMETRY_LAWS: tuple[Law, ...] = (
    _geometry(
        "edge_rounding",
        "a = arccos(1 - H / (R + r))",
        (Parameter("edge_radius_m", "m", 0.0, 0.0, 3e-4, 5e-6),),
        _add_edge_radius,
        description="edges are rounded: r =",
        how_to_decide="scan the edges, or drag the same blocks with another tip",
    ),
    _geometry(
        "tip_wear",
        "R(n) = R + w n",
        (Parameter("growth_m_per_trial", "m", 0.0, 0.0, 5e-6, 3e-8),),
        _add_tip_wear,
        covariate="run_order",
        description="the tip wears: its radius grows per trial by",
        how_to_decide="swap the tip",
    ),
    _geometry(
        "edge_polish",
        "r(n) = r + w n, n passes over the block",
        (Parameter("growth_m_per_pass", "m", 0.0, 0.0, 2e-5, 1e-7),),
        _add_edge_wear,
        covariate="passes_of_block",
        rank=1,
        description="each pass polishes the edge of its block: the radius grows by",
        how_to_decide="scan an edge before and after, or drag a block that nobody has used",
    ),
    _geometry(
        "tip_radius_error",
        "R -> R + w; the same as a rounded edge, which a scan must rule out",
        (Parameter("radius_error_m", "m", 0.0, -1e-4, 3e-4, 5e-6),),
        _change_tip_radius,
        rank=1,
        description="the radius of the tip differs from the stated one by",
        how_to_decide="swap the tip, or measure it",
    ),
    _geometry(
        "tip_flat",
        "a = arccos(1 - (H + d) / R), flat of half width sqrt(2 R d)",
        (Parameter("flat_depth_m", "m", 0.0, 0.0, 3e-5, 1e-6),),
        _add_tip_flat,
        rank=1,
        description="the tip has a flat, of a depth of",
        how_to_decide="swap the tip",
    ),
    _geometry(
        # for every force and energy the same as friction tan(atan mu + t)
        "block_tilt",
        "a -> a + t",
        (Parameter("tilt_rad", "rad", 0.0, -0.3, 0.3, 0.01),),
        _tilt_blocks,
        rank=5,
        description="the blocks are tilted by",
        how_to_decide="turn the blocks round: a tilt changes its sign",
    ),
    _make_indentation_law("", _HERTZ_POWER, rank=0),
    _make_indentation_law("~linear", 1.0, rank=1),
)
