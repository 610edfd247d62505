"""STEP files of shipped stimuli, for tests that read and falsify them."""

from pathlib import Path

from stepblocks.artefacts.step.write import write_step_ap242
from stepblocks.declaration.read import load_set
from stepblocks.declaration.select import find_stimulus_files
from stepblocks.parts.shapes import build_solids

ROOT = Path(__file__).parents[2]
STIMULI = {
    one.id: one for path in find_stimulus_files(ROOT / "stimuli") for one in load_set(path).stimuli
}


def written(identity, folder):
    stimulus = STIMULI[identity]
    path = folder / f"{identity}.step"
    write_step_ap242(path, stimulus, build_solids(stimulus))
    return path
