"""How the probe of a set rings, bare and with a sheath on its shank."""

from __future__ import annotations

import math

from stepblocks.contact.rod.cantilever import Rod, RodRing, Sleeve, ring_of, rod_for
from stepblocks.parts.probe import ProbeSpec
from stepblocks.parts.set import PredictionGrid, Stimulus, StimulusSet
from stepblocks.parts.sheath.declaration import Sheath


def rod_of(probe: ProbeSpec) -> Rod:
    """Return the rod that a probe is taken for."""
    return rod_for(
        probe.stiffness.value,
        probe.frequency.value,
        probe.decay_time.value,
        probe.shank_diameter.value,
        probe.modulus.value,
        probe.density.value,
    )


def ring_with(probe: ProbeSpec, sheath: Sheath) -> RodRing:
    """Predict the ring with a sheath on the shank."""
    bore, outer, length = sheath.bore.nominal, sheath.outer_diameter.nominal, sheath.length.nominal
    bending = sheath.material.modulus * math.pi * (outer**4 - bore**4) / 64.0
    sleeve = Sleeve(sheath.position.nominal, length, bending, sheath.mass / length, sheath.material.loss_factor)
    return ring_of(rod_of(probe), [sleeve])


def sheathed_ring(stimuli: StimulusSet, stimulus: Stimulus) -> RodRing | None:
    """Return how the probe of a set rings with this part on its shank; None where the part is no sheath or there is no probe."""
    if not isinstance(stimulus, Sheath) or stimuli.probe is None:
        return None
    return ring_with(stimuli.probe, stimulus)


def grid_with(stimuli: StimulusSet, stimulus: Stimulus) -> PredictionGrid:
    """Return the grid of a set; under a sheath with the stiffness of the probe that wears it."""
    grid, ring = stimuli.prediction, sheathed_ring(stimuli, stimulus)
    if ring is None:
        return grid
    tool = grid.tool.model_copy(update={"stiffness": ring.stiffness})
    return grid.model_copy(update={"tool": tool})
