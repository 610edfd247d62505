"""The probe that carries a sheath, and the rig that measures its ring."""

from __future__ import annotations

from stepblocks.parts.body import Part
from stepblocks.parts.sourced import (
    SourcedDensity,
    SourcedFrequency,
    SourcedLength,
    SourcedModulus,
    SourcedRatio,
    SourcedStiffness,
    SourcedTime,
)


class ProbeSpec(Part):
    """The probe as a clamped rod with a mass at its tip; its free length follows from the stiffness, the mass from the frequency."""

    stiffness: SourcedStiffness  # Of the tip along the drag [N/m]
    frequency: SourcedFrequency  # At which it rings [Hz]
    decay_time: SourcedTime  # In which its amplitude falls to 1/e [s]
    shank_diameter: SourcedLength  # Diameter of the rod [m]
    modulus: SourcedModulus  # Young's modulus of the rod [Pa]
    density: SourcedDensity  # Of the rod [kg/m^3]


class DampingRig(Part):
    """The rig that moves a tip by a fixed distance and lets it go."""

    displacement: SourcedLength  # That distance [m]
    noise: SourcedLength  # Standard deviation of one sample of the displacement [m]
    sample_rate: SourcedFrequency  # Samples per second [Hz]
    uncertainty: SourcedRatio  # Relative standard uncertainty with which the logarithmic decrement is wanted [1]
