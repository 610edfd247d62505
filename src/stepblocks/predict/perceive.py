"""What a person perceives of a set: how well neighbouring blocks are told apart, and a set that is equally spaced in sensation."""

from __future__ import annotations

import re
from collections.abc import Iterable
from itertools import groupby, pairwise
from pathlib import Path

import pandas as pd

from stepblocks.atomic import replace_text
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.declare import load_declared
from stepblocks.errors import PipelineError, StepblocksError
from stepblocks.parts.set import StimulusSet
from stepblocks.parts.tolerance import Dimension
from stepblocks.predict.perception import (
    PAPER_OBSERVER,
    Observer,
    discriminability,
    equally_felt_heights,
    sensation_level,
)
from stepblocks.predict.predictions import Prediction, tool_of


def observer_of(stimuli: StimulusSet) -> Observer:
    """Return the person of a set: its threshold and ring duration, else the paper's figures."""
    tool = stimuli.prediction.tool
    return Observer(
        tool.detection_threshold, tool.ring_duration, PAPER_OBSERVER.level_difference, PAPER_OBSERVER.masking
    )


def neighbours(stimuli: StimulusSet, predictions: Iterable[Prediction]) -> pd.DataFrame:
    """Tell how well each block is told from the next higher one, under each tip, friction and load."""
    blocks, observer = {block.id for block in stimuli.step_block}, observer_of(stimuli)
    felt = [p for p in predictions if p.stimulus in blocks and p.release.status is Status.RELEASES]

    def condition(p: Prediction) -> tuple[float, float, float]:
        return p.tip_radius, p.friction, p.normal_load

    rows = []
    for (tip, friction, load), group in groupby(sorted(felt, key=lambda p: (*condition(p), p.step_height)), condition):
        for low, high in pairwise(p for p in group if p.release.vibration_energy > 0.0):
            energies = low.release.vibration_energy, high.release.vibration_energy
            steps, correct = discriminability(*energies, observer)
            levels = [sensation_level(energy, observer) for energy in energies]
            rows.append((stimuli.name, tip * 1e6, load, friction, low.stimulus, high.stimulus, *levels, steps, correct))
    names = [
        "set",
        "tip_radius_um",
        "normal_load_n",
        "friction",
        "lower",
        "higher",
        "lower_level_db",
        "higher_level_db",
        "just_noticeable_differences",
        "correct",
    ]
    return pd.DataFrame(rows, columns=names)


def write_equally_felt(source: Path, count: int, target: Path) -> tuple[list[float], float]:
    """Write a set whose step blocks are equally spaced in predicted sensation, between the lowest and the highest of another."""
    stimuli = load_declared(source)
    if not stimuli.step_block:
        raise PipelineError(f"a set that is equally felt needs step blocks to lie between, got none [{source}]")
    if not 2 <= count <= 100:
        raise PipelineError(f"--equally-felt must lie between 2 and 100 blocks, got {count}")
    if target.resolve() == source.resolve() or target.suffix != ".toml":
        raise PipelineError(f"-o must name a new file *.toml, got {target}")
    grid, first = stimuli.prediction, stimuli.step_block[0]
    given = [block.height.nominal for block in stimuli.step_block]
    point = OperatingPoint(grid.tip_radii[0], grid.normal_loads[0], grid.frictions[0], tool_of(grid))
    heights, spacing = equally_felt_heights(
        count, min(given), max(given), point, first.edge_radius.nominal, observer_of(stimuli)
    )
    rounded = [round(float(height) * 1e6, 2) for height in heights]
    text = _with_heights(source.read_text(encoding="utf-8"), target.stem, rounded, first.height)
    beside = target.parent / f".{target.stem}.part" / target.name
    try:
        beside.parent.mkdir(parents=True, exist_ok=True)
        replace_text(beside, text)
        load_declared(beside)
        beside.replace(target)
    except StepblocksError as error:
        raise PipelineError(f"the set cannot be written: {error}") from error
    except OSError as error:
        raise PipelineError(f"the set cannot be written: {error.strerror} [{target}]") from error
    finally:
        beside.unlink(missing_ok=True)
        if beside.parent.is_dir():
            beside.parent.rmdir()
    return [value * 1e-6 for value in rounded], spacing


def _with_heights(text: str, name: str, heights_um: list[float], height: Dimension) -> str:
    """Keep the first stanza of a set's step blocks, give it a series of heights, and leave the other stanzas out."""
    text = re.sub(r'(?m)^set\s*=\s*".*"$', f'set = "{name}"', text, count=1)
    stanzas = list(re.finditer(r"(?ms)^\[\[step_block\]\]\n.*?(?=^\[(?!step_block\.)|\Z)", text))
    kept = stanzas[0].group(0)
    values = ", ".join(f'"{value:g} um"' for value in heights_um)
    up, down = (f"{deviation * 1e6:.9g} um" for deviation in (height.upper, -height.lower))
    tolerance = "by energy" if height.by_energy else f"+{up} / -{down}"
    series = f'height = {{ values = [{values}], tolerance = "{tolerance}" }}'
    kept = re.sub(r"(?m)^height\s*=.*\n?", "", kept).replace("[[step_block]]\n", f"[[step_block]]\n{series}\n", 1)
    kept = re.sub(r"(?m)^id\s*=.*$", 'id = "felt-{height_um:03}"', kept, count=1)
    for stanza in reversed(stanzas):
        text = text[: stanza.start()] + text[stanza.end() :]
    return text.rstrip() + "\n\n# Equally spaced in predicted sensation.\n" + kept.rstrip() + "\n"
