"""NanoFocus (NMS)."""

from typing import TYPE_CHECKING

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.scans.formats.surface_topography import SurfaceTopographyReader
from stepblocks.scans.scan import Array

if TYPE_CHECKING:
    from SurfaceTopography.IO.Reader import ChannelInfo

_MOST_COUNT = 65534.0  # the largest number that is a height; the next one is a missing point
# The file states its spacing in nanometres; SurfaceTopography takes it for millimetres
_TOO_LARGE = 1e6
# Spacing of a microscope: below it the number was no length in nanometres [m]
_LEAST_SPACING = 5e-9


class NanoFocusReader(SurfaceTopographyReader):
    """A map of 16-bit numbers between two stated ends."""

    def __init__(self) -> None:
        super().__init__("nms", (".nms",))

    def blank_missing_heights(self, stored: Array, channel: "ChannelInfo") -> None:
        """Remove what lies more than half a count above the upper end."""
        ends = channel.info["raw_metadata"]
        lowest = ends["zmin"]
        highest = ends["zmax"]
        half_a_count = 0.5 / _MOST_COUNT
        stored[stored > (highest - lowest) * (1.0 + half_a_count) + lowest] = np.nan

    def correct_spacing(self, spacing: Array, place: str) -> Array:
        """Interpret the stated spacing as nanometres, as the format's public files write it."""
        corrected = spacing / _TOO_LARGE
        if (corrected < _LEAST_SPACING).any():
            raise MetrologyError(
                f"spacing of an NMS file must be at least {_LEAST_SPACING * 1e9:g} nm, got "
                f"{corrected.min() * 1e9:.4g} nm [{place}]"
            )
        return corrected
