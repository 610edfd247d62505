"""The shipped stimulus files, read once by each process: they are frozen, and many tests ask."""

from functools import cache
from pathlib import Path

from stepblocks.declaration.read import load_set
from stepblocks.declaration.select import find_stimulus_files

STIMULI = Path(__file__).resolve().parents[2] / "stimuli"


@cache
def load_shipped(name):
    """Read the shipped file of a name."""
    return load_set(STIMULI / f"{name}.toml")


def load_all_shipped():
    """Read all shipped files, in the order of their names."""
    return [load_shipped(path.stem) for path in find_stimulus_files([STIMULI])]


def list_shipped_parts():
    """List the parts of all shipped files by their names."""
    parts = {}
    for stimuli in load_all_shipped():
        for part in stimuli.stimuli:
            parts[part.id] = part
    return parts
