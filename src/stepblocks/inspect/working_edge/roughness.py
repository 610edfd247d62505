"""Roughness Ra of a working face (ISO 21920-2).

ISO 21920-3 takes the settings from its limit.
"""

from dataclasses import dataclass, replace

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.inspect.attempts import evaluate_each
from stepblocks.inspect.budget import Component, Instrument, Source, make_measured_with_instrument
from stepblocks.inspect.evaluation import Evaluation
from stepblocks.inspect.filtering import compute_mean_line
from stepblocks.inspect.noise import Estimate, average_stds, average_values, find_outliers
from stepblocks.scans.scan import ScannedProfile


@dataclass(frozen=True)
class _Settings:
    """Default settings of ISO 21920-3 for limits of Ra up to a size; all in m."""

    most: float  # limit up to which they hold
    cutoff: float  # of which an evaluation takes five
    fine: float  # nesting index of the S filter
    largest_step: float  # sampling interval


_SETTINGS = (
    _Settings(0.02e-6, 0.08e-3, 2.5e-6, 0.5e-6),
    _Settings(0.1e-6, 0.25e-3, 2.5e-6, 0.5e-6),
    _Settings(2e-6, 0.8e-3, 2.5e-6, 0.5e-6),
    _Settings(10e-6, 2.5e-3, 8e-6, 1.5e-6),
    _Settings(np.inf, 8e-3, 25e-6, 5e-6),
)
_LIMIT_ROUNDING = 1.0001  # of a limit, that is no other limit [1]
_STEP_ROUNDING = 1.001  # of a sampling interval, that is no other interval [1]
_SECTIONS = 5


def measure_ra(face: ScannedProfile, ra_limit: float) -> Estimate:
    """Return Ra of one levelled profile of a face by the settings for its limit [both m].

    The scatter over five sections stands beside it.

    Raises
    ------
    MetrologyError
        If the profile is too coarse or too short for the settings.
    """
    settings = _choose_ra_settings(ra_limit)
    spacing = face.spacing
    if spacing > settings.largest_step * _STEP_ROUNDING:
        raise MetrologyError(
            f"Ra: sampling interval must not exceed {settings.largest_step * 1e6:g} um "
            f"(ISO 21920-3), got {spacing * 1e6:.3g} um"
        )
    length = (_SECTIONS + 1) * settings.cutoff  # with half a cut-off at either end
    extent = face.position[-1] - face.position[0]
    if extent < length - 2.0 * spacing:
        raise MetrologyError(
            f"Ra: profile of a face must be {length * 1e3:g} mm long "
            f"(five cut-offs and the ends), got {extent * 1e3:.3g} mm"
        )
    known = np.isfinite(face.height)
    line = np.polynomial.Polynomial.fit(face.position[known], face.height[known], 1)
    levelled = face.height - line(face.position)
    known &= ~find_outliers(np.where(known, levelled, 0.0), known)
    smooth = compute_mean_line(levelled, known, spacing, settings.fine)
    waviness = compute_mean_line(smooth, np.ones_like(known), spacing, settings.cutoff)
    rough = smooth - waviness
    cut = round(0.5 * settings.cutoff / spacing)
    sections = np.array_split(np.abs(rough[cut:-cut]), _SECTIONS)
    means = np.array([float(section.mean()) for section in sections])
    std = float(means.std(ddof=1) / np.sqrt(_SECTIONS))
    return Estimate(float(means.mean()), std, _SECTIONS - 1.0)


def _choose_ra_settings(ra_limit: float) -> _Settings:
    """Return the settings for a limit of Ra [m]."""
    for settings in _SETTINGS:
        if ra_limit <= _LIMIT_ROUNDING * settings.most:
            return settings
    raise MetrologyError(f"limit of Ra must be a number, got {ra_limit}")


def add_roughness(evaluation: Evaluation, ra_limit: float, instrument: Instrument) -> Evaluation:
    """Add Ra of the rougher of the two working faces, or why it was not measured.

    `ra_limit` is that of the part [m]; the first half of the faces of an evaluation are profiles of
    the lower one.
    """
    half = len(evaluation.faces) // 2
    rougher: list[Estimate] = []
    for profiles in (evaluation.faces[:half], evaluation.faces[half:]):
        attempts = evaluate_each(lambda face: measure_ra(face, ra_limit), profiles)
        if not attempts.results:
            missing = {**evaluation.missing, "roughness": attempts.refusals[0]}
            return replace(evaluation, missing=missing)
        if not rougher or average_values(attempts.results) > average_values(rougher):
            rougher = attempts.results
    # sections of neighbouring profiles are not independent: their scatter is not divided again
    std = average_stds(rougher)
    scatter = Component(Source.SCATTER, std, rougher[0].dof, "over five sections of a profile")
    measured = make_measured_with_instrument("Ra", average_values(rougher), [scatter], instrument)
    return replace(evaluation, values={**evaluation.values, "roughness": measured})
