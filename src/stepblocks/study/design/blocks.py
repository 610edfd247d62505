"""The blocks of a study: which they are, their codes, and where they are felt."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np

from stepblocks.contact.counterface import Counterface, Step
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import PAPER, Limits, OperatingPoint
from stepblocks.declaration.read import load_set
from stepblocks.declaration.select import matches_pattern
from stepblocks.declaration.set import StimulusSet
from stepblocks.errors import PipelineError, QuantityError, StudyError
from stepblocks.predict.perception import choose_compared_energies
from stepblocks.predict.predictions import predict_single_drag
from stepblocks.quantities import read_array
from stepblocks.study.columns import Row

Declared: TypeAlias = str | Path | StimulusSet  # a stimulus file, or the set of one

# no vowels, with which a code reads as a word, nor Y; no G, Q, S, which a hand writes like others;
# their number, 17, is prime
_ALPHABET = "BCDFHJKLMNPRTVWXZ"
MAX_CODES = len(_ALPHABET) ** 2  # blocks that one study can tell apart
PRACTICE = "P-"  # begins a code of practice, which says what was right: no trial shows it


@dataclass(frozen=True)
class Item:
    """A block that is judged.

    Attributes
    ----------
    identity, engraved : str
        Of the stimulus, and as it stands on the block.
    height : float
        Of its step [m].

    Raises
    ------
    StudyError
        If the height is not positive and finite.
    """

    identity: str
    engraved: str
    height: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.height) and self.height > 0.0):
            raise StudyError(
                f"height must be positive and finite, got {self.height:g} m [block {self.identity}]"
            )

    def make_loader_columns(self) -> dict[str, str]:
        """Return its stimulus, engraving and height as columns for whoever loads the blocks."""
        return {
            "stimulus": self.identity,
            "engraved": self.engraved,
            "height_um": f"{self.height * 1e6:.9g}",
        }


@dataclass(frozen=True)
class Codes:
    """The codes of one participant, each with its block.

    Attributes
    ----------
    judged : mapping of Item
        Codes that trials show.
    practised : mapping of Item
        Codes of practice.
    """

    judged: Mapping[str, Item]
    practised: Mapping[str, Item]

    def get_items_by_code(self) -> dict[str, Item]:
        """Return the blocks of all codes."""
        return {**self.judged, **self.practised}


def assign_codes(
    items: Sequence[Item], generator: np.random.Generator, practised: Sequence[Item] = ()
) -> Codes:
    """Give every block a code of two random letters and a check letter, and one for practice.

    Raises
    ------
    StudyError
        If there are more blocks than codes.
    """
    needed = len(items) + len(practised)
    if needed > MAX_CODES:
        raise StudyError(
            f"a participant must need at most {MAX_CODES} codes, with those of practice, got "
            f"{needed}: choose fewer blocks"
        )
    numbers = generator.permutation(MAX_CODES).tolist()
    judged_numbers = numbers[: len(items)]
    practice_numbers = numbers[len(items) : needed]
    judged = map(_format_code, judged_numbers)
    practice = [PRACTICE + _format_code(number) for number in practice_numbers]
    return Codes(dict(zip(judged, items, strict=True)), dict(zip(practice, practised, strict=True)))


def _format_code(number: int) -> str:
    """Write a number below `MAX_CODES` as two letters and a check letter."""
    size = len(_ALPHABET)
    first, second = divmod(number, size)
    check = -(2 * first + 3 * second) % size
    return _ALPHABET[first] + _ALPHABET[second] + _ALPHABET[check]


@dataclass(frozen=True)
class Blocks:
    """The blocks of a study and where they are felt.

    Attributes
    ----------
    items : tuple of Item
        The blocks.
    faces : mapping of Counterface
        By identity.
    point : OperatingPoint
        The first of the set's grid under which every block rings, as far as nothing else is given.
    """

    items: tuple[Item, ...]
    faces: Mapping[str, Counterface]
    point: OperatingPoint

    def predict_energies(self) -> dict[str, float]:
        """Predict the energy of vibration [J] of each block.

        Raises
        ------
        PipelineError
            If a block does not release the probe, or is walked over.
        """
        predicted = _predict_vibration_energies(self.faces.values(), self.point)
        energies = dict(zip(self.faces, predicted, strict=True))
        for name, face in self.faces.items():
            if not energies[name] > 0.0:
                raise PipelineError(
                    "every block must release the probe to be felt by its vibration; "
                    f"{name} is {self._describe_silence_cause(face)} "
                    f"at friction {self.point.friction:g}"
                )
        return energies

    def _describe_silence_cause(self, face: Counterface) -> str:
        """Return why a block does not vibrate."""
        status = face.release(self.point).status
        if status is Status.RELEASES:
            return "walked over in time"
        return status.value


def _predict_vibration_energies(faces: Iterable[Counterface], point: OperatingPoint) -> list[float]:
    """Return the energy of vibration that each block gives [J]."""
    energies, _ = choose_compared_energies([predict_single_drag(face, point) for face in faces])
    return list(energies)


def choose_blocks(
    source: Declared | Sequence[float],
    operating_values: Mapping[str, float] = MappingProxyType({}),
    name_pattern: str | None = None,
) -> Blocks:
    """Choose the blocks of a study: those of a stimulus set, or sharp steps of some heights.

    Parameters
    ----------
    source : str, Path, StimulusSet or sequence of float
        Stimulus file, its set, or heights [m].
    operating_values : mapping of float
        Where the blocks are felt: ``ball_radius`` [m], ``normal_load`` [N], ``friction`` [1].
    name_pattern : str, optional
        Pattern of the blocks that take part.

    Raises
    ------
    PipelineError
        If the set has no such step blocks.
    """
    if isinstance(source, StimulusSet):
        return _choose_declared_blocks(source, operating_values, name_pattern)
    if isinstance(source, str | Path):
        return _choose_declared_blocks(load_set(Path(source)), operating_values, name_pattern)
    return _make_sharp_blocks(source, operating_values)


def _make_sharp_blocks(heights: Sequence[float], operating_values: Mapping[str, float]) -> Blocks:
    """Return sharp steps of some heights [m], felt as in the paper unless told otherwise."""
    try:
        lengths = np.atleast_1d(read_array(heights, "length")).tolist()
    except (QuantityError, TypeError, ValueError) as error:
        raise PipelineError(f"heights {error}") from error
    items = {}
    faces = {}
    for height in lengths:
        name = f"step-{height * 1e6:03.6g}"
        items[name] = Item(name, name.upper(), height)
        faces[name] = Step(height)
    # heights alone state no limits, and are asked for what the equations say
    changes: dict[str, Any] = {"tool": replace(PAPER.tool, limits=Limits()), **operating_values}
    return Blocks(tuple(items.values()), faces, replace(PAPER, **changes))


def _choose_declared_blocks(
    stimuli: StimulusSet, operating_values: Mapping[str, float], name_pattern: str | None
) -> Blocks:
    """Return the step blocks of a set whose names match a pattern; without one, all."""
    blocks = []
    for block in stimuli.step_block:
        if name_pattern is None or matches_pattern(name_pattern, stimuli.name, block.id):
            blocks.append(block)
    if not blocks:
        chosen = ""
        if name_pattern:
            chosen = f" that match {name_pattern!r}"
        raise PipelineError(f"a study needs step blocks; the set {stimuli.name} has none{chosen}")
    items = []
    faces = {}
    for block in blocks:
        items.append(Item(block.id, block.id.upper(), block.height.nominal))
        faces[block.id] = block.counterface()
    return Blocks(tuple(items), faces, _choose_operating_point(stimuli, operating_values))


def _choose_operating_point(
    stimuli: StimulusSet, operating_values: Mapping[str, float]
) -> OperatingPoint:
    """Return where the blocks of a set are felt.

    Of the loads of its grid the first under which every block rings, and higher ones more.
    """
    loads: Sequence[float] = stimuli.prediction.normal_loads
    if "normal_load" in operating_values:
        loads = [operating_values["normal_load"]]
    points = []
    for load in loads:
        where = {**operating_values, "normal_load": load}
        points.append(stimuli.prediction.make_first_operating_point(**where))
    rising = sorted(stimuli.step_block, key=lambda block: block.height.nominal)
    faces = [block.counterface() for block in rising]
    for point in points[:-1]:
        if (np.diff([0.0, *_predict_vibration_energies(faces, point)]) > 0.0).all():
            return point
    return points[-1]


def find_designed_blocks(
    design: Sequence[Row], source: Declared | None, operating_values: Mapping[str, float]
) -> Blocks:
    """Find the blocks of a design in a stimulus file or set; without one they are sharp steps.

    `operating_values` is that of `choose_blocks`.

    Raises
    ------
    StudyError
        If the file lacks a block of the design.
    """
    heights = _collect_heights_by_block(design)
    if source is None:
        blocks = choose_blocks(sorted(set(heights.values())), operating_values)
        return replace(blocks, faces={name: Step(height) for name, height in heights.items()})
    blocks = choose_blocks(source, operating_values)
    lacking = sorted(set(heights) - set(blocks.faces))
    if lacking:
        raise StudyError(
            "the blocks of the design must be in the stimulus file, got no "
            f"{', '.join(lacking)} [{source}]"
        )
    faces = {}
    for name, face in blocks.faces.items():
        if name in heights:
            faces[name] = face
    return replace(blocks, faces=faces)


def _collect_heights_by_block(design: Sequence[Row]) -> dict[str, float]:
    """Return the height [m] of each block and standard of a design."""
    heights = {}
    for row in design:
        heights[row["stimulus"]] = float(row["height_um"]) / 1e6
        if row["standard"]:
            heights[row["standard"]] = float(row["standard_height_um"]) / 1e6
    return heights
