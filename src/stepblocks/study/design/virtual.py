"""What can change from trial to trial of virtual blocks."""

from collections.abc import Sequence

from stepblocks.errors import StudyError
from stepblocks.quantities import parse_quantity

VIBRATION = "vibration"
VIBRATION_OFF, VIBRATION_ON = "vibration-off", "vibration-on"
BLOCK = "block"
REAL, VIRTUAL = "real", "simulated"

# Factors whose levels are words, and factors whose levels are quantities, with their dimension
WORDS = {VIBRATION: (VIBRATION_OFF, VIBRATION_ON), BLOCK: (REAL, VIRTUAL)}
DIMENSIONS = {"amplitude": "ratio", "frequency": "frequency", "decay": "time", "load": "force"}
VIRTUAL_FACTORS = (*WORDS, *DIMENSIONS)


def check_virtual_factor(name: str, levels: Sequence[str]) -> None:
    """Reject a factor of virtual blocks that the program cannot change, or levels of no meaning."""
    if name not in VIRTUAL_FACTORS:
        raise StudyError(
            "a factor of virtual blocks within participants must be one of "
            f"{', '.join(VIRTUAL_FACTORS)}, got {name!r}"
        )
    for level in levels:
        _check_virtual_level(name, level)


def _check_virtual_level(factor: str, level: str) -> None:
    """Reject an unknown word, and a quantity that is not positive."""
    if factor in WORDS:
        if level not in WORDS[factor]:
            raise StudyError(f"{factor} must be one of {', '.join(WORDS[factor])}, got {level!r}")
    elif not parse_quantity(level, DIMENSIONS[factor]) > 0.0:
        raise StudyError(f"{factor} must be positive, got {level!r}")
