"""The probe that carries a sheath, and the rig that measures its ring."""

from __future__ import annotations

from stepblocks.stimulus.body import Part
from stepblocks.stimulus.sourced import (
    SourcedDensity,
    SourcedFrequency,
    SourcedLength,
    SourcedModulus,
    SourcedRatio,
    SourcedStiffness,
    SourcedTime,
)

__all__ = ["DampingRig", "ProbeSpec"]


class ProbeSpec(Part):
    """The probe as a clamped rod with a mass at its tip; its free length follows from the stiffness, the mass from the frequency.

    Attributes
    ----------
    stiffness : Sourced
        Of the tip along the drag [N/m].
    frequency : Sourced
        At which it rings [Hz].
    decay_time : Sourced
        In which its amplitude falls to 1/e [s].
    shank_diameter : Sourced
        Diameter of the rod [m].
    modulus : Sourced
        Young's modulus of the rod [Pa].
    density : Sourced
        Of the rod [kg/m^3].
    """

    stiffness: SourcedStiffness
    frequency: SourcedFrequency
    decay_time: SourcedTime
    shank_diameter: SourcedLength
    modulus: SourcedModulus
    density: SourcedDensity


class DampingRig(Part):
    """The rig that moves a tip by a fixed distance and lets it go.

    Attributes
    ----------
    displacement : Sourced
        That distance [m].
    noise : Sourced
        Standard deviation of one sample of the displacement [m].
    sample_rate : Sourced
        Samples per second [Hz].
    uncertainty : Sourced
        Relative standard uncertainty with which the logarithmic decrement is wanted [1].
    """

    displacement: SourcedLength
    noise: SourcedLength
    sample_rate: SourcedFrequency
    uncertainty: SourcedRatio
