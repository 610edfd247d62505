"""What a designed set is to give: energies, levels, or distances in just noticeable differences."""

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass

from stepblocks.contact.domain import read_number, require_positive
from stepblocks.contact.operating_point import LEVEL_DIFFERENCE, Tool
from stepblocks.errors import PipelineError
from stepblocks.mistakes import shorten_value
from stepblocks.quantities import format_quantity

MOST_TARGETS = 100  # of one set: more blocks than a person compares
_MOST_ENERGY = 1.0  # J; beyond lies a slip of the unit
_LEAST_DIFFERENCE, _MOST_DIFFERENCE = 0.01, 60.0  # of a just noticeable difference [dB]
_WHOLE = 1e-9  # of a distance, by which a range may miss a whole number of them
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_LEVEL = re.compile(rf"\s*({_NUMBER})\s*dB\s*")
_DISTANCE = re.compile(rf"\s*({_NUMBER})\s*(?:JND)?\s*")


@dataclass(frozen=True)
class Target:
    """An energy that one block of a set is to give.

    Attributes
    ----------
    energy : float
        Of the ring [J].
    wanted : str
        As it was asked for, such as ``"20 uJ"`` or ``"30 dB"``.
    """

    energy: float
    wanted: str


@dataclass(frozen=True)
class Spacing:
    """Evenly spaced targets: from the lowest, by two of the other three.

    Attributes
    ----------
    lowest, highest : str, float or None
        Energy [J] or level (``"30 dB"``) of both ends.
    number : int or None
        Of targets.
    apart : str, float or None
        Distance between neighbours in just noticeable differences, such as ``"1 JND"``.
    """

    lowest: str | float | None = None
    highest: str | float | None = None
    number: int | None = None
    apart: str | float | None = None

    @property
    def is_asked_for(self) -> bool:
        """Whether any of it is given."""
        return any(value is not None for value in vars(self).values())


def compute_threshold_energy(tool: Tool) -> float:
    """Return the energy of a just detected ring [J]: the threshold power over the ring."""
    return tool.detection_threshold * tool.ring_duration


def compute_level_db(energy: float, tool: Tool) -> float:
    """Return the level of an energy [J] over the detection threshold [dB]."""
    return 10.0 * math.log10(energy / compute_threshold_energy(tool))


def read_jnd_db(jnd: str | float | None) -> float:
    """Read the just noticeable difference of energy [dB]; None for that of `LEVEL_DIFFERENCE`."""
    if jnd is None:
        return LEVEL_DIFFERENCE
    level = _parse_number_by_pattern(jnd, _LEVEL)
    if level is None:
        level = read_number("jnd", jnd, "ratio")
    if not _LEAST_DIFFERENCE <= level <= _MOST_DIFFERENCE:
        raise PipelineError(
            f"jnd must be {_LEAST_DIFFERENCE:g} to {_MOST_DIFFERENCE:g} dB, got "
            f"{shorten_value(jnd)}"
        )
    return level


def read_targets(
    targets: Iterable[str | float], spacing: Spacing, jnd_db: float, tool: Tool
) -> tuple[Target, ...]:
    """Read the targets of a set: those that are listed, or evenly spaced ones.

    Parameters
    ----------
    targets : iterable of str or float
        Energies [J] or ``"20 uJ"``, or levels over the detection threshold, ``"30 dB"``.
    spacing : Spacing
        Where none are listed.
    jnd_db : float
        Just noticeable difference [dB].
    tool : Tool
        Whose threshold levels refer to.

    Returns
    -------
    tuple of Target
        By rising energy.

    Raises
    ------
    StepblocksError
        If neither or both are given, or one of them cannot be read.
    """
    if isinstance(targets, str | float | int):
        targets = (targets,)
    try:
        listed = list(targets)
    except TypeError as error:
        raise PipelineError(
            f"targets must be a list of energies or levels, got {shorten_value(targets)}"
        ) from error
    if bool(listed) == spacing.is_asked_for:
        raise PipelineError(
            "targets must be listed, or spaced from lowest with two of highest, number and apart: "
            "give one of both"
        )
    if not listed:
        return _make_evenly_spaced_targets(spacing, jnd_db, tool)
    if len(listed) > MOST_TARGETS:
        raise PipelineError(f"targets must be at most {MOST_TARGETS}, got {len(listed)}")
    read = []
    for number, raw in enumerate(listed, start=1):
        read.append(_read_target(f"target {number}", raw, tool))
    return tuple(sorted(read, key=lambda target: target.energy))


def _read_target(name: str, raw: str | float, tool: Tool) -> Target:
    """Read an energy, or a level over the detection threshold."""
    level = _parse_number_by_pattern(raw, _LEVEL)
    if level is not None:
        energy = compute_threshold_energy(tool) * 10.0 ** (0.1 * min(level, 1e3))
        wanted = f"{level:g} dB"
    else:
        energy = read_number(name, raw, "energy")
        require_positive(name, energy, "J")
        wanted = format_quantity(energy, "energy")
    if not 0.0 < energy <= _MOST_ENERGY:
        raise PipelineError(
            f"{name} must be an energy of at most {_MOST_ENERGY:g} J, got {shorten_value(raw)}"
        )
    return Target(energy, wanted)


def _parse_number_by_pattern(raw: object, pattern: re.Pattern[str]) -> float | None:
    """Read the number of a text of this pattern; None where it is none."""
    if not isinstance(raw, str) or len(raw) >= 64:
        return None
    match = pattern.fullmatch(raw)
    if match is None:
        return None
    return float(match[1])


def _make_evenly_spaced_targets(spacing: Spacing, jnd_db: float, tool: Tool) -> tuple[Target, ...]:
    """Space targets evenly in level."""
    if spacing.lowest is None:
        raise PipelineError("lowest must be given for evenly spaced targets, got none")
    lowest = compute_level_db(_read_target("lowest", spacing.lowest, tool).energy, tool)
    step, number = _find_level_step_and_count(spacing, lowest, jnd_db, tool)
    if number > MOST_TARGETS:
        raise PipelineError(f"targets must be at most {MOST_TARGETS}, got {number}")
    targets = []
    for index in range(number):
        energy = compute_threshold_energy(tool) * 10.0 ** (0.1 * (lowest + index * step))
        if energy > _MOST_ENERGY:
            raise PipelineError(
                f"targets must be energies of at most {_MOST_ENERGY:g} J, target {index + 1} is "
                f"{energy:.3g} J"
            )
        targets.append(Target(energy, format_quantity(energy, "energy")))
    return tuple(targets)


def _find_level_step_and_count(
    spacing: Spacing, lowest_db: float, jnd_db: float, tool: Tool
) -> tuple[float, int]:
    """Find the step [dB] and the number of evenly spaced targets from the lowest level [dB]."""
    given = [spacing.highest, spacing.number, spacing.apart]
    if sum(value is not None for value in given) != 2:
        raise PipelineError("two of highest, number and apart must be given beside lowest")
    number = spacing.number
    if number is not None:
        _check_target_count(number)
    if spacing.highest is None:
        assert number is not None
        return _read_jnd_distance(spacing.apart) * jnd_db, number
    highest = compute_level_db(_read_target("highest", spacing.highest, tool).energy, tool)
    if not highest > lowest_db:
        raise PipelineError(
            f"highest must lie above lowest, got {shorten_value(spacing.highest)} and "
            f"{shorten_value(spacing.lowest)}"
        )
    if number is not None:
        return (highest - lowest_db) / (number - 1), number
    step = _read_jnd_distance(spacing.apart) * jnd_db
    return step, min(math.floor((highest - lowest_db) / step + _WHOLE), MOST_TARGETS) + 1


def _check_target_count(number: object) -> None:
    """Refuse a number of targets that is not whole or out of range."""
    is_whole = isinstance(number, int) and not isinstance(number, bool)
    if not is_whole or not 2 <= number <= MOST_TARGETS:  # type: ignore[operator]
        raise PipelineError(
            f"number must be a whole number from 2 to {MOST_TARGETS}, got {shorten_value(number)}"
        )


def _read_jnd_distance(apart: str | float | None) -> float:
    """Read the distance of neighbouring targets in just noticeable differences [1]."""
    distance = _parse_number_by_pattern(apart, _DISTANCE)
    if distance is None:
        distance = read_number("apart", apart, "ratio")
    if not 0.01 <= distance <= 1000.0:
        raise PipelineError(f"apart must be 0.01 to 1000 JND, got {shorten_value(apart)}")
    return distance
