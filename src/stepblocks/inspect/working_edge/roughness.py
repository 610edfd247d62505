"""Roughness Ra of a working face (ISO 21920-2).

ISO 21920-3 takes the settings from its limit.
"""

from dataclasses import replace

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import Component, Instrument, add_instrument_components
from stepblocks.inspect.measure import Evaluation, evaluate_each
from stepblocks.inspect.noise import Array, Estimate, find_outliers
from stepblocks.scans.scan import ScannedProfile

# ISO 21920-3, defaults by the upper limit of Ra: limit up to, cut-off, nesting index of the S
# filter,
# largest sampling interval [all m]; an evaluation takes five cut-offs
_SETTINGS = (
    (0.02e-6, 0.08e-3, 2.5e-6, 0.5e-6),
    (0.1e-6, 0.25e-3, 2.5e-6, 0.5e-6),
    (2e-6, 0.8e-3, 2.5e-6, 0.5e-6),
    (10e-6, 2.5e-3, 8e-6, 1.5e-6),
    (np.inf, 8e-3, 25e-6, 5e-6),
)
_SECTIONS = 5
# of the Gaussian filter of ISO 16610-21 [1]
_ALPHA = 0.4697186393498257


def measure_ra(face: ScannedProfile, limit: float) -> Estimate:
    """Return Ra of one levelled profile of a face [m] by the settings for its limit.

    The scatter over five sections stands beside it.
    """
    cutoff, fine, largest = next(rest for most, *rest in _SETTINGS if limit <= 1.0001 * most)
    length = (_SECTIONS + 1) * cutoff  # with half a cut-off at either end
    spacing = face.spacing
    MetrologyError.require(
        spacing <= largest * 1.001,
        f"Ra: sampling interval must not exceed {largest * 1e6:g} um (ISO 21920-3), got "
        f"{spacing * 1e6:.3g} um",
    )
    extent = face.position[-1] - face.position[0]
    MetrologyError.require(
        extent >= length - 2.0 * spacing,
        f"Ra: profile of a face must be {length * 1e3:g} mm long "
        f"(five cut-offs and the ends), got {extent * 1e3:.3g} mm",
    )
    known = np.isfinite(face.height)
    line = np.polynomial.Polynomial.fit(face.position[known], face.height[known], 1)
    rest = face.height - line(face.position)
    known &= ~find_outliers(np.where(known, rest, 0.0), known)
    rough = _compute_mean_line(rest, known, spacing, fine)
    rough = rough - _compute_mean_line(rough, np.ones_like(known), spacing, cutoff)
    cut = round(0.5 * cutoff / spacing)
    sections = np.array_split(np.abs(rough[cut:-cut]), _SECTIONS)
    each = np.array([float(section.mean()) for section in sections])
    return Estimate(
        float(each.mean()), float(each.std(ddof=1) / np.sqrt(_SECTIONS)), _SECTIONS - 1.0
    )


def _compute_mean_line(height: Array, known: Array, spacing: float, cutoff: float) -> Array:
    # Return the mean line of the Gaussian filter of ISO 16610-21; missing points have no weight.
    from scipy.ndimage import convolve1d

    reach = max(int(np.ceil(cutoff / spacing)), 1)
    kernel = np.exp(-np.pi * (np.arange(-reach, reach + 1) * spacing / (_ALPHA * cutoff)) ** 2)
    total = convolve1d(np.where(known, height, 0.0), kernel, mode="constant")
    weight = convolve1d(known.astype(np.float64), kernel, mode="constant")
    return np.asarray(total / np.maximum(weight, 1e-12))


def add_roughness(evaluation: Evaluation, limit: float, instrument: Instrument) -> Evaluation:
    """Add Ra of the rougher of the two working faces, or why it was not measured."""
    half = len(evaluation.faces) // 2
    faces = []
    for part in (evaluation.faces[:half], evaluation.faces[half:]):
        found, refused = evaluate_each(lambda face: measure_ra(face, limit), part)
        if not found:
            return replace(evaluation, missing={**evaluation.missing, "roughness": refused[0]})
        faces.append([one for _, one in found])
    worst = max(faces, key=lambda own: np.mean([one.value for one in own]))
    # sections of neighbouring profiles are not independent: their scatter is not divided again
    std = float(np.mean([one.std for one in worst]))
    measured = add_instrument_components(
        "Ra",
        float(np.mean([one.value for one in worst])),
        [Component("scatter", std, worst[0].dof, "over five sections of a profile")],
        instrument,
    )
    return replace(evaluation, values={**evaluation.values, "roughness": measured})
