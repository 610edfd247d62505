"""What a person perceives of a ring: level over threshold, whether two blocks can be told apart, and fair spacings."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from stepblocks.atomic import make_draft_folder, replace_text
from stepblocks.contact import kernels
from stepblocks.contact.counterface import Step
from stepblocks.contact.domain import require_not_negative, require_positive
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import PAPER, OperatingPoint
from stepblocks.contact.rod import compute_finger_share, compute_modes
from stepblocks.declare import load_declared
from stepblocks.errors import ContactError, PipelineError, StepblocksError
from stepblocks.parts.set import StimulusSet
from stepblocks.parts.tolerance import Dimension
from stepblocks.predict.predictions import Prediction, predict_one

if TYPE_CHECKING:
    import pandas as pd

# heights at which the drag is asked from the lowest to the highest block: 2 % of the energy between
# two
_CURVE = 81
# columns of a table of neighbours, which may have no rows
_NEIGHBOURS = ["set", "tip_radius_um", "normal_load_n", "friction", "lower", "higher"]
_NEIGHBOURS += [
    "lower_level_db",
    "higher_level_db",
    "just_noticeable_differences",
    "correct",
    "felt_by",
]


@dataclass(frozen=True)
class Observer:
    """A person, as far as vibration of 250-350 Hz at the fingertip goes."""

    threshold_power: float  # that is just detected [W]
    ring_duration: float  # over which the energy of a ring is spent [s]
    level_difference: float  # just noticeable [dB of power]; 75 % correct in two-alternative choice
    masking: float  # share of a masking vibration's power that adds to the threshold [1]
    reach: float = 1.0  # share of the ring's energy at the tip that arrives at the finger [1]

    def __post_init__(self) -> None:
        for name in ("threshold_power", "ring_duration", "level_difference", "reach"):
            require_positive(name, getattr(self, name))
        require_not_negative("masking", self.masking)


# None of these was measured on a hand-held explorer but the threshold. Threshold and duration: the
# paper. 1.5 dB (Weber fraction 0.41 of energy, 0.19 of amplitude): a median of 0.20 of amplitude
# stands in the abstract of "Vibrotactile difference thresholds: effects of vibration frequency,
# vibration magnitude, contact area, and body location" (thenar, 125 Hz, 10 dB over threshold, 12
# subjects; up to 0.58 elsewhere). Craig (1972, Perception & Psychophysics 11, 150) is remembered,
# not checked, for 1.5 dB. The fraction rises towards threshold, which is ignored, and was not
# measured on a short ring felt through a tool: treat it as a factor of two. Masking: a signal must
# exceed a masker of the same channel by the Weber fraction; an assumption, not a measurement
PAPER_OBSERVER = Observer(
    PAPER.tool.detection_threshold, PAPER.tool.ring_duration, level_difference=1.5, masking=0.41
)


def compute_sensation_level(
    energy: float, observer: Observer = PAPER_OBSERVER, masker_power: float = 0.0
) -> float:
    """Level of a ring over its threshold."""
    require_positive("energy", energy, "J")
    require_not_negative("masker_power", masker_power, "W")
    threshold = observer.threshold_power + observer.masking * masker_power
    return 10.0 * math.log10(energy * observer.reach / observer.ring_duration / threshold)


def compute_discriminability(
    first: float, second: float, observer: Observer = PAPER_OBSERVER
) -> tuple[float, float]:
    """How well two rings can be told apart: just noticeable differences n, of 75 % correct each, and P = Phi(n z(0.75))."""
    from scipy.stats import norm

    levels = compute_sensation_level(first, observer), compute_sensation_level(second, observer)
    steps = abs(levels[0] - levels[1]) / observer.level_difference
    return steps, float(norm.cdf(steps * norm.ppf(0.75)))


def choose_energies(compared: Sequence[Prediction]) -> tuple[list[float], str]:
    """Energies [J] of drags that a person compares, NaN where nothing slips, and who says them: the formula or the drag."""
    # by the drag where one of them differs: a change of model between two blocks would be felt as a
    # difference
    if any(one.differs for one in compared):
        return [math.nan if one.in_time is None else one.in_time.energy for one in compared], "drag"
    return [one.release.vibration_energy for one in compared], "formula"


def find_height_of_energy(energy: float, point: OperatingPoint, edge_radius: float = 0.0) -> float:
    """Height H [m] of the step that rings with `energy` [J], the exact inverse of equations (1) and (2)."""
    require_positive("energy", energy, "J")
    force = math.sqrt(2.0 * point.tool.stiffness * energy / point.tool.conversion)
    angle = math.atan2(force, point.normal_load) - math.atan(point.friction)
    if angle <= 0.0:
        raise ContactError(
            f"energy of {energy:g} J is less than sliding friction alone stores: no step "
            "rings so "
            "little"
        )
    return float((point.ball_radius + edge_radius) * 2.0 * math.sin(0.5 * angle) ** 2)


def find_equally_spaced_heights(
    count: int,
    lowest: float,
    highest: float,
    point: OperatingPoint,
    edge_radius: float = 0.0,
    observer: Observer = PAPER_OBSERVER,
) -> tuple[NDArray[np.float64], float, str]:
    """Heights of a set whose blocks are equally spaced in predicted sensation, their spacing, and by whom it is said."""
    # sensation is taken to grow with the logarithm of the energy (Fechner), as a constant Weber
    # fraction implies
    if count < 2 or not 0.0 < lowest < highest:
        raise ContactError(
            f"a set needs at least 2 blocks of increasing height, got {count}, {lowest:g}, "
            f"{highest:g}"
        )
    for height in (lowest, highest):
        release = Step(height, edge_radius).release(point)
        if release.status is not Status.RELEASES:
            limit = kernels.compute_locking_height(point.ball_radius + edge_radius, point.friction)
            takes = f"it locks from {limit:g} m on"
            if release.status.is_beyond_limit:
                takes = f"it would take {release.pull_force:.3g} N"
            raise ContactError(f"a step of {height:g} m is {release.status}; {takes}")
    curve = np.geomspace(lowest, highest, _CURVE)
    asked = [predict_one(Step(float(height), edge_radius), point) for height in curve]
    curve_energies, by = choose_energies(asked)
    if by == "formula":
        energies = np.geomspace(curve_energies[0], curve_energies[-1], count)
        heights = np.array(
            [find_height_of_energy(float(energy), point, edge_radius) for energy in energies]
        )
        return (
            heights,
            compute_discriminability(float(energies[0]), float(energies[1]), observer)[0],
            by,
        )
    rings = np.maximum.accumulate(curve_energies)
    if not rings[0] > 0.0:
        least = curve[np.argmax(rings > 0.0)] if rings[-1] > 0.0 else math.nan
        raise ContactError(
            f"a step of {lowest * 1e6:g} um does not ring in time under "
            f"{point.normal_load:g} "
            "N: "
            "the tip walks over it; "
            f"the lowest that rings is {least * 1e6:.3g} um"
        )
    levels = np.linspace(math.log(rings[0]), math.log(rings[-1]), count)
    rising = np.concatenate([[True], np.diff(rings) > 0.0])
    heights = np.exp(np.interp(levels, np.log(rings[rising]), np.log(curve[rising])))
    first, second = math.exp(levels[0]), math.exp(levels[1])
    return heights, compute_discriminability(first, second, observer)[0], by


def make_observer(stimuli: StimulusSet) -> Observer:
    """Return the person of a set: its threshold and ring duration, else the paper's; at the finger where it declares the probe."""
    tool, probe = stimuli.prediction.tool, stimuli.probe
    person = replace(
        PAPER_OBSERVER, threshold_power=tool.detection_threshold, ring_duration=tool.ring_duration
    )
    if probe is None:
        return person
    share = compute_finger_share(
        probe.rod(), probe.stiffness.value, compute_modes(probe.rod()), duration=tool.ring_duration
    )
    return replace(person, reach=share / tool.conversion)


def compare_neighbours(stimuli: StimulusSet, predictions: Iterable[Prediction]) -> pd.DataFrame:
    """Tell how well each block is told from the next higher one, under each tip, friction and load."""
    import pandas as pd

    blocks, observer = {block.id for block in stimuli.step_block}, make_observer(stimuli)
    felt = [p for p in predictions if p.stimulus in blocks and p.release.status is Status.RELEASES]

    def condition(p: Prediction) -> tuple[float, float, float]:
        return p.point.ball_radius, p.point.friction, p.point.normal_load

    rows = []
    felt.sort(key=lambda p: (*condition(p), p.face.far_side))
    for (tip, friction, load), group in groupby(felt, condition):
        compared = list(group)
        energies, by = choose_energies(compared)
        ringing = [
            (one.stimulus, energy)
            for one, energy in zip(compared, energies, strict=True)
            if energy > 0.0
        ]
        for (lower, low), (higher, high) in pairwise(ringing):
            levels = (compute_sensation_level(energy, observer) for energy in (low, high))
            told = compute_discriminability(low, high, observer)
            rows.append(
                (stimuli.name, tip * 1e6, load, friction, lower, higher, *levels, *told, by)
            )
    return pd.DataFrame(rows, columns=_NEIGHBOURS)


def write_equally_spaced_set(
    source: Path, count: int, target: Path
) -> tuple[list[float], float, str]:
    """Write a set whose step blocks are equally spaced in predicted sensation, between the lowest and the highest of another."""
    stimuli = load_declared(source)
    if not stimuli.step_block:
        raise PipelineError(
            f"a set that is equally felt needs step blocks to lie between, got none [{source}]"
        )
    if not 2 <= count <= 100:
        raise PipelineError(f"--equally-felt must lie between 2 and 100 blocks, got {count}")
    if target.resolve() == source.resolve() or target.suffix != ".toml":
        raise PipelineError(f"-o must name a new file *.toml, got {target}")
    first = stimuli.step_block[0]
    given = [block.height.nominal for block in stimuli.step_block]
    point = stimuli.prediction.first_point()
    heights, spacing, by = find_equally_spaced_heights(
        count, min(given), max(given), point, first.edge_radius.nominal, make_observer(stimuli)
    )
    rounded = [round(float(height) * 1e6, 2) for height in heights]
    text = _replace_heights(source.read_text(encoding="utf-8"), target.stem, rounded, first.height)
    try:
        with make_draft_folder(target) as folder:
            draft = folder / target.name
            replace_text(draft, text)
            load_declared(draft)
            draft.replace(target)
    except StepblocksError as error:
        raise PipelineError(f"the set cannot be written: {error}") from error
    except OSError as error:
        raise PipelineError(f"the set cannot be written: {error.strerror} [{target}]") from error
    return [value * 1e-6 for value in rounded], spacing, by


def _replace_heights(text: str, name: str, heights_um: list[float], height: Dimension) -> str:
    """Keep the first stanza of a set's step blocks, give it a series of heights, and leave the other stanzas out."""
    text = re.sub(r'(?m)^set\s*=\s*".*"$', f'set = "{name}"', text, count=1)
    stanzas = list(re.finditer(r"(?ms)^\[\[step_block\]\]\n.*?(?=^\[(?!step_block\.)|\Z)", text))
    kept = stanzas[0].group(0)
    values = ", ".join(f'"{value:g} um"' for value in heights_um)
    up, down = (f"{deviation * 1e6:.9g} um" for deviation in (height.upper, -height.lower))
    tolerance = "by energy" if height.by_energy else f"+{up} / -{down}"
    series = f'height = {{ values = [{values}], tolerance = "{tolerance}" }}'
    kept = re.sub(r"(?m)^height\s*=.*\n?", "", kept).replace(
        "[[step_block]]\n", f"[[step_block]]\n{series}\n", 1
    )
    kept = re.sub(r"(?m)^id\s*=.*$", 'id = "felt-{height_um:03}"', kept, count=1)
    for stanza in reversed(stanzas):
        text = text[: stanza.start()] + text[stanza.end() :]
    return text.rstrip() + "\n\n# Equally spaced in predicted sensation.\n" + kept.rstrip() + "\n"
