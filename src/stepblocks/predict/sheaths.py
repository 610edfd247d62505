"""What the sheaths of a set do to the ring of its probe, and what a test of it will measure."""

import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stepblocks.contact.domain import require_positive
from stepblocks.contact.operating_point import Tool
from stepblocks.contact.rod import (
    Hold,
    RodRing,
    Sleeve,
    compute_bush_stiffness,
    compute_finger_share,
    compute_modes,
    compute_rod_ring,
    compute_sensed_energy,
)
from stepblocks.declaration.set import StimulusSet
from stepblocks.errors import ContactError, PipelineError
from stepblocks.files.atomic import replace_text
from stepblocks.files.tables import format_csv
from stepblocks.parts.conditions import ProbeSpec
from stepblocks.parts.kinds.sheath import Sheath

_RECORD = 5.0  # time constants: all but 5e-5 of the energy is recorded
_MOST_RELEASES = 10_000
# of the columns of a planned test
_DIGITS = ["g", ".3g", ".3g", ".1f", ".2g", ".4f", ".2g", ".2f", "d", ".4g", "d", "d"]

# How a probe is used: without a sheath, with one beyond the clamp, clamped by the outside of one
BARE, ON_SHANK, HELD = "bare", "on the shank", "held through it"


@dataclass(frozen=True)
class Condition:
    """One way of using the probe, and how it then rings."""

    sheath: str  # identity; empty for the bare probe
    use: str  # how the probe is used
    mass: float  # of the sheath [kg]
    ring: RodRing
    sensed: (
        float  # square of the force at a sensor between rod or sheath and clamp, over the ring [s]
    )
    finger: float  # share of the stored energy that the grasp takes up as vibration [1]


def _predict_condition(probe: ProbeSpec, use: str, sheath: Sheath | None = None) -> Condition:
    worn: Sleeve | Hold | None = sheath.sleeve if sheath else None
    if sheath and use == HELD:
        material = sheath.material
        bore, outer = sheath.bore.nominal, sheath.outer_diameter.nominal
        worn = Hold(
            sheath.length.nominal,
            compute_bush_stiffness(bore, outer, material.modulus.value, material.poisson.value),
            material.loss_factor.value,
        )
    rod = probe.rod()
    ring = compute_rod_ring(rod, worn)
    modes = compute_modes(rod, worn)
    what = (sheath.id, use, sheath.mass) if sheath else ("", use, 0.0)
    return Condition(
        *what, ring, compute_sensed_energy(modes), compute_finger_share(rod, ring.stiffness, modes)
    )


def find_damping(source: str | Path) -> dict[str, float]:
    """Find the share of the bare probe's energy that each sheath lets through to the clamp.

    The shares stand by the names of experiment 1.
    """
    from stepblocks.declaration.read import load_set

    found = predict_conditions(load_set(Path(source)))
    PipelineError.require(
        found, f"damping needs a set with a probe and sheaths, got none [{source}]"
    )
    return {"bare": 1.0} | {
        one.sheath.removeprefix("sheath-"): one.sensed / found[0].sensed
        for one in found
        if one.use == HELD
    }


def predict_conditions(stimuli: StimulusSet) -> list[Condition]:
    """Predict the ring of a set's probe, bare and with each sheath, on the shank or in hand."""
    probe = stimuli.probe
    if probe is None or not stimuli.sheath:
        return []
    return [
        _predict_condition(probe, BARE),
        *(
            _predict_condition(probe, use, one)
            for use in (ON_SHANK, HELD)
            for one in stimuli.sheath
        ),
    ]


def tabulate_rings(stimuli: StimulusSet) -> list[dict[str, str]]:
    """Tabulate the rings of a set's probe."""
    conditions = predict_conditions(stimuli)
    if not conditions:
        return []
    bare = conditions[0].ring
    tool = stimuli.prediction.as_tool()
    last = tool.ring_duration
    spread = tool.frequency_deviation / tool.frequency
    bare_work = bare.stiffness / bare.mean_energy(last)
    return [
        {
            "sheath": one.sheath or "none",
            "use": one.use,
            "mass_g": f"{one.mass * 1e3:.4g}",
            "stiffness_n_mm": f"{ring.stiffness * 1e-3:.4g}",
            "frequency_hz": f"{ring.frequency:.1f}",
            "frequency_deviation_hz": f"{spread * ring.frequency:.1f}",
            "frequency_shift_hz": f"{ring.frequency - bare.frequency:+.1f}",
            "decay_time_ms": f"{ring.decay_time * 1e3:.2f}",
            "decay_shift_ms": f"{(ring.decay_time - bare.decay_time) * 1e3:+.2f}",
            "log_decrement": f"{ring.log_decrement:.4f}",
            "sheath_share_of_strain_energy": f"{ring.sheath_share:.2g}",
            "ring_energy_ratio": f"{bare_work * ring.mean_energy(last) / ring.stiffness:.3f}",
            "sensor_energy_ratio": f"{one.sensed / conditions[0].sensed:.3f}",
            "finger_share": f"{one.finger:.4f}",
        }
        for one, ring in ((one, one.ring) for one in conditions)
    ]


def tabulate_decay_test(stimuli: StimulusSet) -> list[dict[str, str]]:
    """Tabulate what the damping rig will measure of a set's probe."""
    rig = stimuli.damping_rig
    if rig is None:
        return []
    asked = rig.displacement.value, rig.noise.value, rig.sample_rate.value, rig.uncertainty.value
    tests = [
        (one, plan_decay_test(one.ring.as_tool(), *asked)) for one in predict_conditions(stimuli)
    ]
    return [
        {"sheath": one.sheath or "none", "use": one.use}
        | {
            name: f"{value:{digits}}"
            for (name, value), digits in zip(test.items(), _DIGITS, strict=True)
        }
        | {"releases_to_tell_from_bare": _count_releases_needed(tests[0][1], test)}
        for one, test in tests
    ]


def _count_releases_needed(bare: dict[str, float], test: dict[str, float]) -> str:
    difference = abs(test["log_decrement"] - bare["log_decrement"])
    if test is bare or difference == 0.0:
        return ""
    spread = math.hypot(bare["log_decrement_std"], test["log_decrement_std"])
    return f"{math.ceil((3.0 * spread / difference) ** 2)}"


def plan_decay_test(
    tool: Tool, displacement: float, noise: float, rate: float, wanted: float
) -> dict[str, float]:
    """Predict what a test of a tool's ring will measure, and how well.

    `wanted` is the relative uncertainty of the logarithmic decrement.
    """
    for name, value in (
        ("displacement", displacement),
        ("noise", noise),
        ("rate", rate),
        ("wanted", wanted),
    ):
        require_positive(name, value)
    frequency, decay_time = tool.frequency, tool.decay_time
    ContactError.require(
        rate >= 4.0 * frequency,
        f"rate must be at least four samples per period ({4.0 * frequency:.4g} Hz), got "
        f"{rate:g} Hz",
    )
    ContactError.require(
        displacement > 3.0 * noise,
        f"displacement must exceed three times the noise ({3e6 * noise:g} um), got "
        f"{displacement * 1e6:g} um",
    )
    count = max(math.ceil(_RECORD * decay_time * rate), 8)
    decrement = 1.0 / (decay_time * frequency)
    # the Cramer-Rao bound of a damped sine: least standard uncertainties of its angular frequency
    # and decay rate [1/s]
    time = np.arange(count) / rate
    envelope = np.exp(-time / decay_time)
    phase = math.tau * frequency * time
    cosine, sine = envelope * np.cos(phase), envelope * np.sin(phase)
    scaled = time / decay_time  # so that all columns are of order one
    slopes = np.column_stack([cosine, -sine, -scaled * sine, -scaled * cosine]) * displacement
    least = np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes) * noise**2)[2:]) / decay_time
    frequency_std, rate_std = float(least[0]) / math.tau, float(least[1])
    decrement_std = math.hypot(rate_std / frequency, decrement * frequency_std / frequency)
    releases = max(math.ceil((decrement_std / (wanted * decrement)) ** 2), 1)
    ContactError.require(
        releases <= _MOST_RELEASES,
        f"an uncertainty of {wanted:g} would take {releases} releases, more than {_MOST_RELEASES}",
    )
    return {
        "displacement_um": displacement * 1e6,
        "holding_force_n": tool.stiffness * displacement,
        "peak_acceleration_m_s2": (math.tau * frequency) ** 2 * displacement,
        "frequency_hz": frequency,
        "frequency_std_hz": frequency_std,
        "log_decrement": decrement,
        "log_decrement_std": decrement_std,
        "decay_time_ms": decay_time * 1e3,
        "periods_above_noise": math.floor(
            decay_time * math.log(displacement / (3.0 * noise)) * frequency
        ),
        "record_ms": count / rate * 1e3,
        "samples": count,
        "releases": releases,
    }


def write_sheath_files(stimuli: StimulusSet, folder: Path) -> list[Path]:
    """Write rings, damping test and resolved probe of a set with sheaths."""
    rings = tabulate_rings(stimuli)
    if not rings or stimuli.probe is None or stimuli.damping_rig is None:
        return []
    rod = stimuli.probe.rod()
    content = {
        "schema": 1,
        "probe": stimuli.probe.record(),
        "follows": {
            "free_length_m": rod.length,
            "tip_mass_kg": rod.end_mass,
            "loss_factor": rod.loss_factor,
        },
        "damping_rig": stimuli.damping_rig.record(),
    }
    texts = {
        "rings.csv": format_csv(rings),
        "damping-test.csv": format_csv(tabulate_decay_test(stimuli)),
        "probe.json": json.dumps(content, indent=2, allow_nan=False) + "\n",
    }
    for name, text in texts.items():
        replace_text(folder / name, text)
    return [folder / name for name in texts]
