"""The whole waveform as evidence.

The drag in time fitted to a trace, and the trace held against what the fit would draw.

The check is posterior predictive (Gelman, Meng and Stern 1996, Statistica Sinica 6:733): parameters
are drawn from their covariance and noise from the record's, and it asks how often such a record
would miss by as much.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from stepblocks.bench.signal import Array, Estimate, Trace
from stepblocks.bench.signal.features import Measurement
from stepblocks.bench.signal.separable import (
    compute_numeric_jacobian,
    estimate_covariance,
    propagate_std,
)
from stepblocks.contact.operating_point import Tool
from stepblocks.errors import ContactError

if TYPE_CHECKING:
    import pandas as pd

# of a fit: friction [1], stiffness [N/m], frequency [Hz], damping ratio [1], R + r [m], instant of
# the onset [s]
_NAMES = ("friction", "stiffness", "frequency", "damping", "radius", "onset")
_STEP = 0.02 * np.array([5e-3, 100.0, 3.0, 3e-3, 1e-6, 1e-4])  # of differences
# friction, damping and radius lie along one valley: the search is scaled by its slopes, and goes on
# until it has ended
_SEARCH: dict[str, Any] = {
    "x_scale": "jac",
    "diff_step": 1e-4,
    "loss": "soft_l1",
    "f_scale": 5.0,
    "max_nfev": 100,
}
_BEFORE, _AFTER = (
    4e-3,
    18e-3,
)  # [s] of sliding before the ramp and of ring after the peak that are fitted
_RATE = 4.0  # rows of the drag per sample
_DRAWS = 1000
_KNOWN = (
    70.0**2 / 12870.0
)  # degrees of freedom per sample of a noise told by fourth differences: C(8,4)^2 / C(16,8)
_FOLDS = 5
_FIRST = 4e-3  # [s] after the peak in which the first swing lies
_NEAR = 2.0  # times the noise: a fit that misses by less is taken at once
WAVEFORM_COLUMNS = (
    *(
        "waveform_energy_j",
        "waveform_energy_std_j",
        "waveform_friction",
        "waveform_stiffness_n_per_m",
    ),
    *(
        "waveform_frequency_hz",
        "waveform_damping_ratio",
        "waveform_radius_m",
        "waveform_misfit",
        "waveform_p",
    ),
)


@dataclass(frozen=True)
class Waveform:
    """A drag in time fitted to a trace.

    Attributes
    ----------
    values : Array
        Shape (6,), as in `_NAMES`.
    covariance : Array
        Shape (6, 6).
    energy : Estimate
        Of the first swing below sliding, carried back over half a period, on the declared spring
        [J].
    misfit : float
        Rms of the residuals over the noise [1].
    p : float
        How often a record of this drag would miss by as much [1].
    """

    values: Array
    covariance: Array
    energy: Estimate
    misfit: float
    p: float

    @property
    def features(self) -> dict[str, float]:
        """One value for each of `WAVEFORM_COLUMNS`."""
        told = (*self.energy, *map(float, self.values[:5]), self.misfit, self.p)
        return dict(zip(WAVEFORM_COLUMNS, told, strict=True))


def compute_drag_force(
    values: Array, load: float, height: float, speed: float, time: Array
) -> Array:
    """Tangential force of a drag with these values at some instants [N]."""
    from stepblocks.drag.kernels import COLUMNS
    from stepblocks.drag.probe import DragSettings, build_probe
    from stepblocks.drag.simulate import simulate_drag
    from stepblocks.drag.track import build_step_track

    friction, stiffness, frequency, damping, radius, onset = map(float, values)
    tool = Tool(
        stiffness=stiffness,
        frequency=frequency,
        decay_time=1.0 / (2.0 * math.pi * frequency * damping),
    )
    lead, end = 1.2 * _BEFORE, 1.5 * _AFTER
    rate = _RATE * (time.size - 1) / float(time[-1] - time[0])
    settings = DragSettings(
        load, friction, speed, lead=lead * speed, ring_time=end, sample_rate=rate, resolution=10.0
    )
    done = simulate_drag(
        build_step_track(height, radius), build_probe(tool, radius, damping_ratio=damping), settings
    )
    clock = done.rows[:, 0] + onset - lead
    return np.asarray(np.interp(time, clock, done.rows[:, COLUMNS.index("fx_n")]), dtype=float)


def fit_waveform(
    trace: Trace, measured: Measurement, height: float, radius: float, usual: Tool
) -> Waveform | None:
    """Fit a drag in time to a measured trace over a step of known height.

    None where none comes near it.
    """
    from scipy.optimize import least_squares

    approach, after, load, speed = (
        measured.approach,
        measured.aftermath,
        measured.load[0],
        measured.speed,
    )
    time = trace.time - measured.start
    window = (time > approach.onset - _BEFORE) & (time < measured.peak.time + _AFTER)
    time, force = (
        time[window],
        (trace.tangential - approach.hum(trace.time - measured.start))[window],
    )
    noise = measured.noise
    angle = math.atan(measured.peak.force / load) - math.atan(approach.level / load)
    seen = height / (1.0 - math.cos(angle)) if angle > 0.0 else radius
    frequency, decay = after.frequency[0], max(after.decay_time[0], 1e-3)
    damping = min(max(1.0 / (2.0 * math.pi * frequency * decay), 2e-3), 0.2)
    start = np.array(
        [approach.level / load, approach.slope / speed, frequency, damping, seen, approach.onset]
    )
    lower = np.array([1e-3, 0.5 * start[1], 0.7 * start[2], 1e-4, 1.001 * height, start[5] - 5e-3])
    upper = np.array([2.0, 2.0 * start[1], 1.4 * start[2], 0.4, 20.0 * radius, start[5] + 5e-3])

    def miss(values: Array) -> Array:
        try:
            return np.asarray(
                (force - compute_drag_force(values, load, height, speed, time)) / noise
            )
        except ContactError:
            return np.full(time.size, 1e3)

    # the force of a release turns within a sample: what a millisecond misplaces must not outweigh
    # the rest. A ring of many swings has many minima, so the first swing is fitted before the
    # whole, and from what the session says of its tool too
    found: Any = None
    for tool in (np.array([usual.frequency, usual.damping_ratio]), start[2:4]):
        begin = np.clip(np.concatenate([start[:2], tool, start[4:]]), lower, upper)
        for span in (_FIRST, _AFTER):
            near = time < measured.peak.time + span
            found_now = least_squares(
                lambda v, near=near: miss(v)[near], begin, bounds=(lower, upper), **_SEARCH
            )
            begin = found_now.x
        found = found_now if found is None or found_now.cost < found.cost else found
        if math.sqrt(float(np.mean(miss(found.x) ** 2))) < _NEAR:
            break
    values, residuals = np.asarray(found.x), miss(found.x)
    if not np.isfinite(residuals).all() or float(np.median(np.abs(residuals))) > 50.0:
        return None
    slopes = compute_numeric_jacobian(miss, values, _STEP, lower, upper)
    covariance = estimate_covariance(slopes, residuals)

    def amplitude(values: Array) -> Array:
        model = compute_drag_force(values, load, height, speed, time)
        swing = values[0] * load - model[int(np.argmax(model)) :].min()
        return np.array([max(swing, 0.0) * math.exp(math.pi * values[3])])

    size = float(amplitude(values)[0])
    std = propagate_std(
        compute_numeric_jacobian(amplitude, values, _STEP, lower, upper)[0], covariance
    )
    energy = size**2 / (2.0 * measured.spring_constant)
    spread = math.sqrt(4.0 * size**2 * std**2 + 2.0 * std**4) / (2.0 * measured.spring_constant)
    rms = math.sqrt(float(np.mean(residuals**2)))
    return Waveform(
        values,
        covariance,
        (energy, spread),
        rms,
        _compute_predictive_p(slopes, covariance, rms, _KNOWN * trace.time.size),
    )


def _compute_predictive_p(slopes: Array, covariance: Array, rms: float, known: float) -> float:
    """Share of records drawn from posterior and noise, itself estimated, that miss as much.

    To first order in the parameters.
    """
    random = np.random.default_rng(0)
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    moved = slopes @ root @ random.standard_normal((covariance.shape[0], _DRAWS))
    drawn = np.sqrt(np.mean((moved + random.standard_normal(moved.shape)) ** 2, axis=0))
    return float(np.mean(drawn >= rms * np.sqrt(random.chisquare(known, _DRAWS) / known)))


def predict_energies(features: pd.DataFrame, spring_constant: float) -> dict[str, Any]:
    """Compare one drag in time with equation (1) on energies of held-out trials.

    Foretells the E_v of trials, beside equation (1).
    """
    whole = (features["status"] == "ok") & (features["vibration_energy_j"] > 0.0)
    good = features[whole & (features["waveform_misfit"] < _NEAR)]
    if len(good) < 2 * _FOLDS:
        return {"trials": len(features), "fitted": len(good)}
    shown = np.log(good["vibration_energy_j"].to_numpy())
    # a tip that climbs down hardly rings: by what its start left over, which no drag knows
    known = good["vibration_energy_std_j"].to_numpy() < 0.5 * good["vibration_energy_j"].to_numpy()
    known &= (good["regime"] != "climb-down").to_numpy()
    stored = np.log(good["peak_force_n"].to_numpy() ** 2 / (2.0 * spring_constant))
    fold, names = np.arange(len(good)) % _FOLDS, list(WAVEFORM_COLUMNS[3:7])
    drag, formula = np.full(len(good), np.nan), np.full(len(good), np.nan)
    for one in range(_FOLDS):
        others = good[fold != one][names].median().to_numpy()
        formula[fold == one] = stored[fold == one] + np.median(
            (shown - stored)[(fold != one) & known]
        )
        for i in np.flatnonzero((fold == one) & known):
            row = good.iloc[i]
            values = np.array([row["sliding_friction"], *others, 0.0])
            load, height, speed = row["load_n"], row["height_um"] * 1e-6, row["speed_mm_s"] * 1e-3
            rise = (row["peak_force_n"] - row["sliding_friction"] * load) / (others[0] * speed)
            time = np.arange(0.0, rise + _AFTER, 1e-4)
            force = compute_drag_force(values, load, height, speed, time)
            swing = row["sliding_friction"] * load - float(force[int(np.argmax(force)) :].min())
            drag[i] = (
                2.0 * math.log(max(swing, 1e-4))
                + 2.0 * math.pi * others[2]
                - math.log(2.0 * spring_constant)
            )
    used = known & np.isfinite(drag)
    return {
        "trials": len(features),
        "fitted": len(good),
        "explained": float(np.mean(good["waveform_p"] > 0.01)),
        "ln_energy_error_of_drag": float(np.sqrt(np.mean((drag - shown)[used] ** 2))),
        "ln_energy_error_of_equation_1": float(np.sqrt(np.mean((formula - shown)[used] ** 2))),
        **dict(zip(names, map(float, good[names].median()), strict=True)),
    }
