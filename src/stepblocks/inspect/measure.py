"""Measure the opening of a margin, or the radius of a probe tip, with its uncertainty budget."""

from dataclasses import dataclass, replace

import numpy as np

from stepblocks.inspect.attempts import evaluate_each, evaluate_if_possible, list_results
from stepblocks.inspect.budget import (
    Bound,
    Component,
    Instrument,
    Measured,
    ScalePowers,
    Source,
    average_profiles,
    list_tilt_components,
)
from stepblocks.inspect.evaluation import AS_FOUND, Evaluation, EvaluationOptions, Shown
from stepblocks.inspect.margin_gap import Margin, fit_margin
from stepblocks.inspect.noise import Estimate
from stepblocks.inspect.notes import Note, NoteKind
from stepblocks.inspect.profiles import Crossings, keep_profiles_that_agree, sample_profiles
from stepblocks.inspect.tip import Cap, fit_cap
from stepblocks.scans.scan import HeightMap, ScannedProfile

_CONVENTION_OF_MARGIN = (
    "shoulders by two planes with a common slope; edges at half the depth of the gap"
)
_NARROWER = 0.7  # of the cap of a tip, over which its radius is fitted again [1]
# of the radius: a cap of 0.7 of the angle knows its radius by a quarter as well
_NOISE_OF_NARROWER = 3.0
_VERTICAL = ScalePowers(vertical=1.0, lateral=0.0)
_LATERAL = ScalePowers(vertical=0.0, lateral=1.0)
# of a cap, height h over width a, R is a^2 / 2h: twice the lateral error, once the vertical
_CAP_POWERS = ScalePowers(vertical=1.0, lateral=2.0)


@dataclass(frozen=True)
class _Discrepancy:
    """A size of a margin over its profiles."""

    sizes: list[Estimate]  # m
    sampled: float  # its share in what lies between samples [1]
    powers: ScalePowers


@dataclass(frozen=True)
class _Lean:
    """How the shoulders of a margin lean."""

    slope: float  # of both shoulders [1]
    depth_of_walls: float  # from the edges of the opening to where it is taken [m]


def measure_margin(
    scan: ScannedProfile | HeightMap, instrument: Instrument, options: EvaluationOptions = AS_FOUND
) -> Evaluation:
    """Measure opening and rise of a margin, and the absolute discrepancy.

    Raises
    ------
    MetrologyError
        If the profiles show no gap between two shoulders, or do not agree on it.
    """
    sampled = sample_profiles(scan, options)
    attempts = evaluate_each(lambda row: fit_margin(row.position, row.height), sampled.rows)
    opening_of_profiles = [margin.opening.value for margin in attempts.results]
    openings = np.array(opening_of_profiles).reshape(-1, 1)
    crossings = Crossings(openings, 0.0 * openings, 0.0 * openings)
    kept = keep_profiles_that_agree(attempts, crossings, sampled.rows, sampled.notes)
    margins = list_results(kept)
    sampling = float(np.mean([margin.sampling for margin in margins]))
    lean = _estimate_lean(margins)
    values = {}
    for key, discrepancy in _collect_discrepancies(margins).items():
        values[key] = _average_discrepancy(key, discrepancy, sampling, lean, instrument)
    gap = values["vertical_discrepancy"]
    if options.stylus_radius != 0.0:
        # a stylus falls into a gap late and leaves it early
        gap = replace(gap, bound=Bound.AT_LEAST)
    values["marginal_gap"] = replace(gap, name="marginal gap")
    first = kept[0].item
    left_shoulder = np.nanmedian(first.height[: len(first.height) // 4])
    return Evaluation(
        values=values,
        convention=_CONVENTION_OF_MARGIN,
        notes=tuple(sampled.notes),
        shown=Shown(first.position, first.height - left_shoulder),
    )


def _estimate_lean(margins: list[Margin]) -> _Lean:
    """Estimate how margins lean; an opening is taken at half the depth of the gap."""
    slopes = []
    depths = []
    for margin in margins:
        slopes.append(margin.slope)
        depths.append(abs(margin.rise.value) + 0.5 * margin.depth)
    return _Lean(float(np.median(slopes)), float(np.median(depths)))


def _collect_discrepancies(margins: list[Margin]) -> dict[str, _Discrepancy]:
    """Return the sizes of margins by key."""
    openings, rises, absolutes, shares = [], [], [], []
    for margin in margins:
        openings.append(margin.opening)
        rises.append(margin.rise)
        absolutes.append(margin.absolute_discrepancy)
        shares.append(margin.opening.value / margin.absolute_discrepancy.value)
    share = float(np.mean(shares))
    of_both_scales = ScalePowers(vertical=1.0 - share**2, lateral=share**2)
    return {
        "vertical_discrepancy": _Discrepancy(openings, 1.0, _LATERAL),
        "horizontal_discrepancy": _Discrepancy(rises, 0.0, _VERTICAL),
        "absolute_discrepancy": _Discrepancy(absolutes, share, of_both_scales),
    }


def _average_discrepancy(
    key: str, discrepancy: _Discrepancy, sampling: float, lean: _Lean, instrument: Instrument
) -> Measured:
    """Average a size over the profiles; `sampling` is what samples leave open of an opening [m]."""
    mean_size = float(np.mean([estimate.value for estimate in discrepancy.sizes]))
    depth_of_walls = discrepancy.sampled * lean.depth_of_walls
    components = list_tilt_components(mean_size, lean.slope, depth_of_walls)
    if discrepancy.sampled > 0.0:
        how = "one interval at either edge, rectangular; the same in every profile"
        components.append(Component(Source.SAMPLING, discrepancy.sampled * sampling, how=how))
    name = key.replace("_", " ")
    return average_profiles(name, discrepancy.sizes, instrument, components, discrepancy.powers)


def measure_tip(
    scan: ScannedProfile | HeightMap,
    instrument: Instrument,
    options: EvaluationOptions = AS_FOUND,
    nominal_radius: float = 0.0,
) -> Evaluation:
    """Radius of a probe tip of about `nominal_radius` [m].

    The scan is a height map that looks along the axis of the tip, or a profile over it.

    Raises
    ------
    MetrologyError
        If the scan shows no cap of a ball of about this radius.
    """
    notes: list[Note] = []
    through = "sphere through the cap"
    if isinstance(scan, ScannedProfile):
        sampled = sample_profiles(scan, options)
        notes = sampled.notes
        scan = sampled.rows[0]
        through = "circle through the cap of the profile"
    cap = fit_cap(scan, nominal_radius)
    form = _estimate_form_uncertainty_of_radius(scan, nominal_radius, cap)
    radius = cap.radius
    if options.stylus_radius:
        radius = replace(radius, value=radius.value - options.stylus_radius)
        notes.append(NoteKind.STYLUS_TAKEN_OFF_BALL.make_note(radius=options.stylus_radius * 1e6))
    measured = average_profiles("ball radius", [radius], instrument, [form], _CAP_POWERS)
    if options.stylus_radius is None:
        # a stylus of any radius makes the ball look larger by it
        measured = replace(measured, bound=Bound.AT_MOST)
    angle = np.degrees(cap.cap_angle)
    notes.append(NoteKind.FORM_OF_BALL.make_note(form=cap.form * 1e6, angle=angle))
    if cap.rejected:
        notes.append(NoteKind.SPIKES_LEFT_OUT.make_note(left_out=cap.rejected, points=cap.points))
    if measured.bound is Bound.AT_MOST:
        notes.append(NoteKind.STYLUS_OF_BALL_UNKNOWN.make_note())
    lowest = float(np.nanmin(cap.drawn.height))
    return Evaluation(
        values={"ball_radius": measured},
        convention=f"least-squares {through}, in heights",
        notes=tuple(notes),
        shown=Shown(
            cap.drawn.position, cap.drawn.height - lowest, fitted=cap.drawn.fitted - lowest
        ),
    )


def _estimate_form_uncertainty_of_radius(
    scan: ScannedProfile | HeightMap, nominal: float, cap: Cap
) -> Component:
    """Return what the form of a ball leaves open of its radius: the change over a narrower cap."""
    reach = float(np.sin(cap.cap_angle))  # of what the points cover, as a part of the radius
    narrower = evaluate_if_possible(lambda part: fit_cap(scan, nominal, part), _NARROWER * reach)
    change = 0.0
    if narrower is not None:
        change = abs(narrower.radius.value - cap.radius.value)
    beyond_noise = max(change**2 - (_NOISE_OF_NARROWER * cap.radius.std) ** 2, 0.0)
    return Component(
        Source.FORM,
        float(np.sqrt(beyond_noise / 3.0)),
        how="change over a cap of seven tenths of it, less its noise, rectangular",
    )
