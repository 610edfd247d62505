"""What the sheaths of a set do to the ring of its probe, and what a test of it will measure."""

import json
import math
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import numpy as np

from stepblocks.contact.domain import require_positive
from stepblocks.contact.operating_point import Tool
from stepblocks.contact.rod import (
    Hold,
    RodRing,
    Sleeve,
    compute_bush_stiffness,
    compute_energy_share_in_hand,
    compute_modes,
    compute_rod_ring,
    integrate_squared_clamp_force,
)
from stepblocks.declaration.set import StimulusSet
from stepblocks.errors import ContactError, PipelineError
from stepblocks.files.atomic import replace_text
from stepblocks.files.tables import format_csv
from stepblocks.parts.conditions import ProbeSpec
from stepblocks.parts.kinds.sheath import Sheath

_RECORD = 5.0  # time constants: all but 5e-5 of the energy is recorded
_LEAST_SAMPLES = 8  # of a record, for a fit of four parameters
_LEAST_RATE = 4.0  # samples per period
_LEAST_SIGNAL = 3.0  # displacement over the noise [1]
_SURE = 3.0  # standard uncertainties between two decrements that are told apart
_MOST_RELEASES = 10_000
# columns of a planned test, and how each is written
_TEST_DIGITS = {
    "displacement_um": "g",
    "holding_force_n": ".3g",
    "peak_acceleration_m_s2": ".3g",
    "frequency_hz": ".1f",
    "frequency_std_hz": ".2g",
    "log_decrement": ".4f",
    "log_decrement_std": ".2g",
    "decay_time_ms": ".2f",
    "periods_above_noise": "d",
    "record_ms": ".4g",
    "samples": "d",
    "releases": "d",
}


class Use(StrEnum):
    """How a probe is used."""

    BARE = "bare"
    ON_SHANK = "on the shank"  # with a sheath beyond the clamp
    HELD = "held through it"  # clamped by the outside of a sheath


@dataclass(frozen=True)
class Condition:
    """One way of using the probe, and how it then rings."""

    sheath: str  # identity; empty for the bare probe
    use: Use
    mass: float  # of the sheath [kg]
    ring: RodRing
    # square of the force at a sensor between rod or sheath and clamp, over the ring [N^2 s]
    sensed: float
    finger: float  # share of the stored energy that the grasp takes up as vibration [1]


def predict_probe_conditions(stimuli: StimulusSet) -> list[Condition]:
    """Predict the ring of a set's probe, bare and with each sheath, on the shank or in hand."""
    probe = stimuli.probe
    if probe is None or not stimuli.sheath:
        return []
    conditions = [_predict_probe_condition(probe, Use.BARE)]
    for use in (Use.ON_SHANK, Use.HELD):
        for sheath in stimuli.sheath:
            conditions.append(_predict_probe_condition(probe, use, sheath))
    return conditions


def _predict_probe_condition(probe: ProbeSpec, use: Use, sheath: Sheath | None = None) -> Condition:
    """Predict the ring of a probe in one use, with a sheath or bare."""
    name, mass, worn = "", 0.0, None
    if sheath is not None:
        name, mass, worn = sheath.id, sheath.mass, _convert_sheath_to_support(sheath, use)
    rod = probe.make_rod()
    ring = compute_rod_ring(rod, worn)
    modes = compute_modes(rod, worn)
    return Condition(
        sheath=name,
        use=use,
        mass=mass,
        ring=ring,
        sensed=integrate_squared_clamp_force(modes),
        finger=compute_energy_share_in_hand(rod, ring.stiffness, modes),
    )


def _convert_sheath_to_support(sheath: Sheath, use: Use) -> Sleeve | Hold | None:
    """Convert a sheath to what the rod meets: a sleeve on its shank, or the bush that holds it."""
    if use is not Use.HELD:
        return sheath.sleeve
    material = sheath.material
    stiffness = compute_bush_stiffness(
        sheath.bore.nominal,
        sheath.outer_diameter.nominal,
        material.modulus.value,
        material.poisson.value,
    )
    return Hold(sheath.length.nominal, stiffness, material.loss_factor.value)


def compute_transmitted_energy_shares(set_path: str | Path) -> dict[str, float]:
    """Compute the share of the bare probe's energy that each sheath lets through to the clamp.

    The shares stand by the names of experiment 1.
    """
    from stepblocks.declaration.read import load_set

    conditions = predict_probe_conditions(load_set(Path(set_path)))
    if not conditions:
        raise PipelineError(f"damping needs a set with a probe and sheaths, got none [{set_path}]")
    bare = conditions[0]
    shares = {"bare": 1.0}
    for condition in conditions:
        if condition.use is Use.HELD:
            shares[condition.sheath.removeprefix("sheath-")] = condition.sensed / bare.sensed
    return shares


def make_ring_rows(stimuli: StimulusSet) -> list[dict[str, str]]:
    """Tabulate the rings of a set's probe."""
    conditions = predict_probe_conditions(stimuli)
    if not conditions:
        return []
    bare = conditions[0]
    tool = stimuli.prediction.as_tool()
    return [_make_ring_row(condition, bare, tool) for condition in conditions]


def _make_ring_row(condition: Condition, bare: Condition, tool: Tool) -> dict[str, str]:
    """Tabulate a ring beside that of the bare probe, as a row."""
    ring = condition.ring
    duration = tool.ring_duration
    spread = tool.frequency_deviation / tool.frequency
    frequency_shift = ring.frequency - bare.ring.frequency
    decay_shift = ring.decay_time - bare.ring.decay_time
    frequency_deviation = spread * ring.frequency
    bare_work = bare.ring.stiffness / bare.ring.compute_mean_energy(duration)
    energy_ratio = bare_work * ring.compute_mean_energy(duration) / ring.stiffness
    sensor_ratio = condition.sensed / bare.sensed
    return {
        "sheath": condition.sheath or "none",
        "use": condition.use.value,
        "mass_g": f"{condition.mass * 1e3:.4g}",
        "stiffness_n_mm": f"{ring.stiffness * 1e-3:.4g}",
        "frequency_hz": f"{ring.frequency:.1f}",
        "frequency_deviation_hz": f"{frequency_deviation:.1f}",
        "frequency_shift_hz": f"{frequency_shift:+.1f}",
        "decay_time_ms": f"{ring.decay_time * 1e3:.2f}",
        "decay_shift_ms": f"{decay_shift * 1e3:+.2f}",
        "log_decrement": f"{ring.log_decrement:.4f}",
        "sheath_share_of_strain_energy": f"{ring.sheath_share:.2g}",
        "ring_energy_ratio": f"{energy_ratio:.3f}",
        "sensor_energy_ratio": f"{sensor_ratio:.3f}",
        "finger_share": f"{condition.finger:.4f}",
    }


def make_decay_test_rows(stimuli: StimulusSet) -> list[dict[str, str]]:
    """Tabulate what the damping rig will measure of a set's probe."""
    rig = stimuli.damping_rig
    if rig is None:
        return []
    rows: list[dict[str, str]] = []
    bare: dict[str, float] | None = None
    for condition in predict_probe_conditions(stimuli):
        test = plan_decay_test(
            condition.ring.as_tool(),
            rig.displacement.value,
            rig.noise.value,
            rig.sample_rate.value,
            rig.uncertainty.value,
        )
        row = {"sheath": condition.sheath or "none", "use": condition.use.value}
        for name, digits in _TEST_DIGITS.items():
            row[name] = f"{test[name]:{digits}}"
        row["releases_to_tell_from_bare"] = ""
        if bare is not None:
            row["releases_to_tell_from_bare"] = _format_release_count(bare, test)
        bare = bare or test
        rows.append(row)
    return rows


def _format_release_count(bare: dict[str, float], test: dict[str, float]) -> str:
    """Format how many releases tell a decrement from the bare probe's; empty if equal."""
    difference = abs(test["log_decrement"] - bare["log_decrement"])
    if difference == 0.0:
        return ""
    spread = math.hypot(bare["log_decrement_std"], test["log_decrement_std"])
    return f"{math.ceil((_SURE * spread / difference) ** 2)}"


def plan_decay_test(
    tool: Tool, displacement: float, noise: float, sample_rate: float, wanted_uncertainty: float
) -> dict[str, float]:
    """Predict what a test of a tool's ring will measure, and how well.

    `wanted_uncertainty` is the relative uncertainty of the logarithmic decrement.
    """
    require_positive("displacement", displacement)
    require_positive("noise", noise)
    require_positive("rate", sample_rate)
    require_positive("wanted", wanted_uncertainty)
    frequency, decay_time = tool.frequency, tool.decay_time
    least_rate = _LEAST_RATE * frequency
    if sample_rate < least_rate:
        raise ContactError(
            f"rate must be at least four samples per period ({least_rate:.4g} Hz), "
            f"got {sample_rate:g} Hz"
        )
    if displacement <= _LEAST_SIGNAL * noise:
        raise ContactError(
            f"displacement must exceed three times the noise ({3e6 * noise:g} um), got "
            f"{displacement * 1e6:g} um"
        )
    count = max(math.ceil(_RECORD * decay_time * sample_rate), _LEAST_SAMPLES)
    decrement = 1.0 / (decay_time * frequency)
    frequency_std, decay_rate_std = _compute_ring_uncertainty_bounds(
        tool, displacement, noise, sample_rate, count
    )
    decrement_std = math.hypot(decay_rate_std / frequency, decrement * frequency_std / frequency)
    releases = max(math.ceil((decrement_std / (wanted_uncertainty * decrement)) ** 2), 1)
    if releases > _MOST_RELEASES:
        raise ContactError(
            f"an uncertainty of {wanted_uncertainty:g} would take {releases} releases, more than "
            f"{_MOST_RELEASES}"
        )
    time_above_noise = decay_time * math.log(displacement / (_LEAST_SIGNAL * noise))
    return {
        "displacement_um": displacement * 1e6,
        "holding_force_n": tool.stiffness * displacement,
        "peak_acceleration_m_s2": (math.tau * frequency) ** 2 * displacement,
        "frequency_hz": frequency,
        "frequency_std_hz": frequency_std,
        "log_decrement": decrement,
        "log_decrement_std": decrement_std,
        "decay_time_ms": decay_time * 1e3,
        "periods_above_noise": math.floor(time_above_noise * frequency),
        "record_ms": count / sample_rate * 1e3,
        "samples": count,
        "releases": releases,
    }


def _compute_ring_uncertainty_bounds(
    tool: Tool, displacement: float, noise: float, sample_rate: float, sample_count: int
) -> tuple[float, float]:
    """Return least standard uncertainties of frequency [Hz] and decay rate [1/s] of a sine.

    They are the Cramer-Rao bound of one record with white noise.
    """
    decay_time = tool.decay_time
    time = np.arange(sample_count) / sample_rate
    envelope = np.exp(-time / decay_time)
    phase = math.tau * tool.frequency * time
    cosine = envelope * np.cos(phase)
    sine = envelope * np.sin(phase)
    scaled = time / decay_time  # so that all columns are of order one
    slopes = np.column_stack([cosine, -sine, -scaled * sine, -scaled * cosine]) * displacement
    covariance = np.linalg.inv(slopes.T @ slopes) * noise**2
    angular_frequency_std, decay_rate_std = np.sqrt(np.diag(covariance)[2:]) / decay_time
    return float(angular_frequency_std) / math.tau, float(decay_rate_std)


def write_sheath_files(stimuli: StimulusSet, folder: Path) -> list[Path]:
    """Write rings, damping test and resolved probe of a set with sheaths."""
    rings = make_ring_rows(stimuli)
    if not rings or stimuli.probe is None or stimuli.damping_rig is None:
        return []
    rod = stimuli.probe.make_rod()
    probe = {
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
        "damping-test.csv": format_csv(make_decay_test_rows(stimuli)),
        "probe.json": json.dumps(probe, indent=2, allow_nan=False) + "\n",
    }
    paths = []
    for name, text in texts.items():
        path = folder / name
        replace_text(path, text)
        paths.append(path)
    return paths
