"""Which builder makes which stimulus."""

from __future__ import annotations

from stepblocks.cad import kernel
from stepblocks.parts.margins.block_shape import margin_block
from stepblocks.parts.margins.crown_shape import crown_on_tooth
from stepblocks.parts.margins.declaration import CrownOnTooth, MarginBlock
from stepblocks.parts.set import Stimulus
from stepblocks.parts.sheath.declaration import Sheath
from stepblocks.parts.sheath.shape import sheath
from stepblocks.parts.step_block.declaration import StepBlock
from stepblocks.parts.step_block.shape import step_block
from stepblocks.parts.tips.declaration import HookTip, StraightTip
from stepblocks.parts.tips.shape import hook_tip, straight_tip


def build_solids(stimulus: Stimulus) -> list[tuple[str, kernel.Body]]:
    """Build the solids of any stimulus.

    Parameters
    ----------
    stimulus : Stimulus
        What is asked for.

    Returns
    -------
    list of (str, kernel.Body)
        Its named solids, in the frame that the stimulus documents.
    """
    match stimulus:
        case StepBlock():
            return step_block(stimulus)
        case MarginBlock():
            return margin_block(stimulus)
        case CrownOnTooth():
            return crown_on_tooth(stimulus)
        case StraightTip():
            return straight_tip(stimulus)
        case HookTip():
            return hook_tip(stimulus)
        case Sheath():
            return sheath(stimulus)
