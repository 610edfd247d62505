"""STEP files of shipped stimuli, for tests that read and falsify them."""

from oracles.shipped import list_shipped_parts
from stepblocks.artefacts.step.write import write_step_ap242
from stepblocks.parts.shapes import build_solids

STIMULI = list_shipped_parts()


def written(identity, folder):
    stimulus = STIMULI[identity]
    path = folder / f"{identity}.step"
    write_step_ap242(path, stimulus, build_solids(stimulus))
    return path
