"""One block whose height is far from its nominal value; small errors are part of the nominal model's priors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from stepblocks.contact.effects.law import Law
from stepblocks.contact.forward import Constant
from stepblocks.contact.state import DragState


def law_for(block: str) -> Law:
    """Return the effect of a height error of one block."""

    def apply(state: DragState, blocks: NDArray[Any], values: Mapping[str, float]) -> DragState:
        return state.changed(height=state.height + values["height_error_m"] * (blocks == block))

    return Law(
        id=f"block_height_error~{block}",
        slot="contact_geometry",
        covariate="block",
        form=f"H -> H + h on {block}",
        parameters=(Constant("height_error_m", "m", 0.0, -4e-5, 4e-5, 1e-6),),
        amplitudes=("height_error_m",),
        apply=apply,
    )
