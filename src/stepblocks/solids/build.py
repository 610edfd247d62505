"""Which builder makes which stimulus."""

from __future__ import annotations

from stepblocks.solids import kernel
from stepblocks.solids.crown_on_tooth import crown_on_tooth
from stepblocks.solids.margin_block import margin_block
from stepblocks.solids.probe_tip import hook_tip, straight_tip
from stepblocks.solids.sheath import sheath
from stepblocks.solids.step_block import step_block
from stepblocks.stimulus.block import StepBlock
from stepblocks.stimulus.margin import CrownOnTooth, MarginBlock
from stepblocks.stimulus.set import Stimulus
from stepblocks.stimulus.sheath import Sheath
from stepblocks.stimulus.tip import HookTip, StraightTip

__all__ = ["build_solids"]


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
