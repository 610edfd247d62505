"""What the sheaths of a set do to the ring of its probe, and what a test of it will measure."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path

from stepblocks.atomic import replace_text
from stepblocks.contact.rod import DecayTest, Hold, RodRing, bush_stiffness, plan_decay_test, ring_of
from stepblocks.contact.transfer import finger_share, modes_of, sensed
from stepblocks.errors import PipelineError
from stepblocks.parts.conditions import ProbeSpec
from stepblocks.parts.kinds.sheath import Sheath
from stepblocks.parts.set import StimulusSet
from stepblocks.tables import csv_text

# How a probe is used: without a sheath, with one beyond the clamp, clamped by the outside of one
BARE, ON_SHANK, HELD = "bare", "on the shank", "held through it"


@dataclass(frozen=True)
class Condition:
    """One way of using the probe, and how it then rings."""

    sheath: str  # identity; empty for the bare probe
    use: str  # how the probe is used
    mass: float  # of the sheath [kg]
    ring: RodRing
    sensed: float  # square of the force at a sensor between rod or sheath and clamp, over the ring [s]
    finger: float  # share of the stored energy that the grasp takes up as vibration [1]


def _condition(probe: ProbeSpec, use: str, sheath: Sheath | None = None) -> Condition:
    sleeves = [sheath.sleeve] if sheath and use == ON_SHANK and sheath.sleeve else []
    hold = None
    if sheath and not sleeves:
        material, bore, outer = sheath.material, sheath.bore.nominal, sheath.outer_diameter.nominal
        bedding = bush_stiffness(bore, outer, material.modulus.value, material.poisson.value)
        hold = Hold(sheath.length.nominal, bedding, material.loss_factor.value)
    rod = probe.rod()
    ring, modes = ring_of(rod, sleeves, hold), modes_of(rod, sleeves, hold)
    what = (sheath.id, use, sheath.mass) if sheath else ("", use, 0.0)
    return Condition(*what, ring, sensed(modes), finger_share(rod, ring.stiffness, modes))


def damping_of(source: str | Path) -> dict[str, float]:
    """Share of the bare probe's energy that sheaths let through to a sensor at the clamp, by the names of experiment 1."""
    from stepblocks.declare import load_set

    found = conditions_of(load_set(Path(source)))
    if not found:
        raise PipelineError(f"damping needs a set with a probe and sheaths, got none [{source}]")
    held = {one.sheath.removeprefix("sheath-"): one.sensed / found[0].sensed for one in found if one.use == HELD}
    return {"bare": 1.0, **held}


def conditions_of(stimuli: StimulusSet) -> list[Condition]:
    """Predict the ring of a set's probe, bare and with each sheath, on the shank and as what the probe is held by."""
    probe = stimuli.probe
    if probe is None or not stimuli.sheath:
        return []
    worn = [_condition(probe, use, one) for use in (ON_SHANK, HELD) for one in stimuli.sheath]
    return [_condition(probe, BARE), *worn]


def ring_rows(stimuli: StimulusSet) -> list[dict[str, str]]:
    """Tabulate the rings of a set's probe."""
    conditions = conditions_of(stimuli)
    if not conditions:
        return []
    bare, tool = conditions[0].ring, stimuli.prediction.as_tool()
    last = tool.ring_duration
    return [
        {
            "sheath": one.sheath or "none",
            "use": one.use,
            "mass_g": f"{one.mass * 1e3:.4g}",
            "stiffness_n_mm": f"{ring.stiffness * 1e-3:.4g}",
            "frequency_hz": f"{ring.frequency:.1f}",
            "frequency_deviation_hz": f"{tool.frequency_deviation * ring.frequency / tool.frequency:.1f}",
            "frequency_shift_hz": f"{ring.frequency - bare.frequency:+.1f}",
            "decay_time_ms": f"{ring.decay_time * 1e3:.2f}",
            "decay_shift_ms": f"{(ring.decay_time - bare.decay_time) * 1e3:+.2f}",
            "log_decrement": f"{ring.log_decrement:.4f}",
            "sheath_share_of_strain_energy": f"{ring.sheath_share:.2g}",
            "ring_energy_ratio": f"{bare.stiffness / ring.stiffness * ring.mean_energy(last) / bare.mean_energy(last):.3f}",
            "sensor_energy_ratio": f"{one.sensed / conditions[0].sensed:.3f}",
            "finger_share": f"{one.finger:.4f}",
        }
        for one, ring in ((one, one.ring) for one in conditions)
    ]


def decay_test_rows(stimuli: StimulusSet) -> list[dict[str, str]]:
    """Tabulate what the damping rig will measure of a set's probe."""
    rig = stimuli.damping_rig
    if rig is None:
        return []
    asked = rig.displacement.value, rig.noise.value, rig.sample_rate.value, rig.uncertainty.value
    tests = [(one, plan_decay_test(one.ring.as_tool(), *asked)) for one in conditions_of(stimuli)]
    return [
        {
            "sheath": one.sheath or "none",
            "use": one.use,
            "displacement_um": f"{asked[0] * 1e6:g}",
            "holding_force_n": f"{test.force:.3g}",
            "peak_acceleration_m_s2": f"{test.peak_acceleration:.3g}",
            "frequency_hz": f"{one.ring.frequency:.1f}",
            "frequency_std_hz": f"{test.frequency_std:.2g}",
            "log_decrement": f"{test.log_decrement:.4f}",
            "log_decrement_std": f"{test.log_decrement_std:.2g}",
            "decay_time_ms": f"{one.ring.decay_time * 1e3:.2f}",
            "periods_above_noise": f"{test.periods_above_noise}",
            "record_ms": f"{test.record_time * 1e3:.4g}",
            "samples": f"{test.samples}",
            "releases": f"{test.releases}",
            "releases_to_tell_from_bare": _releases_to_tell(tests[0][1], test),
        }
        for one, test in tests
    ]


def _releases_to_tell(bare: DecayTest, test: DecayTest) -> str:
    difference = abs(test.log_decrement - bare.log_decrement)
    if test is bare or difference == 0.0:
        return ""
    return f"{math.ceil((3.0 * math.hypot(bare.log_decrement_std, test.log_decrement_std) / difference) ** 2)}"


def write_sheath_files(stimuli: StimulusSet, folder: Path) -> list[Path]:
    """Write rings, damping test and resolved probe of a set with sheaths."""
    rings = ring_rows(stimuli)
    if not rings or stimuli.probe is None or stimuli.damping_rig is None:
        return []
    rod = stimuli.probe.rod()
    told = {
        "probe": stimuli.probe.record(),
        "follows": {"free_length_m": rod.length, "tip_mass_kg": rod.end_mass, "loss_factor": rod.loss_factor},
        "damping_rig": stimuli.damping_rig.record(),
    }
    texts = {
        "rings.csv": csv_text(rings),
        "damping-test.csv": csv_text(decay_test_rows(stimuli)),
        "probe.json": json.dumps(told, indent=2, allow_nan=False) + "\n",
    }
    for name, text in texts.items():
        replace_text(folder / name, text)
    return [folder / name for name in texts]
