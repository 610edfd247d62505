"""Radius of a working edge over its profiles, less that of the stylus."""

import math
from dataclasses import replace

import numpy as np

from stepblocks.inspect.attempts import evaluate_each
from stepblocks.inspect.budget import (
    UNSTATED,
    Bound,
    Component,
    Instrument,
    Measured,
    ScalePowers,
    Source,
    average_profiles,
)
from stepblocks.inspect.edge import NO_RISER, fit_edge
from stepblocks.inspect.edge_arc import RESOLVED
from stepblocks.inspect.edge_flank import LEAST_ON_FLANK
from stepblocks.inspect.noise import (
    Estimate,
    Refit,
    average_stds,
    average_values,
    estimate_refit_std,
)
from stepblocks.inspect.notes import Note, NoteKind
from stepblocks.inspect.working_edge.crossing import CrossedEdge, CrossedEdges

# of the radius of an arc, over which it is steeper than 45 degrees
_STEEP = 1.0 - math.sqrt(0.5)
_LEAST_ARC = 6.0  # sampling intervals that a radius needs for a fit without these
_MOST_REFITTED = 10  # profiles whose arcs are fitted again
# a fit of few points is no normal law: twice what noise changes is none
_NOISE_OF_FEW_POINTS = 2.0
# sampling intervals in a height with too few points on a flank of 60 deg to tell it from an arc
_COARSE = 2.0 * (LEAST_ON_FLANK + 2.0) * math.tan(math.radians(60.0))
_WORN = 0.25  # of the radius of a stylus, that it may be off: a rectangle [1]
_RADIUS_POWERS = ScalePowers(vertical=1.0, lateral=1.0)


def average_radius(
    crossed: CrossedEdges, instrument: Instrument, stylus_radius: float | None, notes: list[Note]
) -> Measured:
    """Average the edge radius over profiles, with what is left open of it.

    Parameters
    ----------
    crossed : CrossedEdges
    instrument : Instrument
    stylus_radius : float or None
        m, 0 of an optical instrument; None where it is not stated: the radius is then a bound.
    notes : list of Note
        Takes what is said of the stylus.

    Returns
    -------
    Measured
    """
    tip = stylus_radius or 0.0
    corners = _list_usual_radii(crossed)
    components = [
        Component(Source.FORM, _estimate_arc_form_std(crossed), how="change without its steep half")
    ]
    single = average_stds(corners)
    if crossed.is_map or _is_edge_unresolved(crossed, corners):
        components.append(_make_sampling_component(crossed, single))
        single = 0.0
    stylus = _make_stylus_component(stylus_radius)
    if stylus is not None:
        components.append(stylus)
    without_tip = []
    for corner in corners:
        without_tip.append(Estimate(corner.value - tip, single, corner.dof))
    measured = average_profiles("edge radius", without_tip, instrument, components, _RADIUS_POWERS)
    if measured.value + measured.compute_expanded_uncertainty() < 0.0:
        seen = measured.value + tip
        notes.append(NoteKind.STYLUS_TOO_LARGE.make_note(radius=tip * 1e6, seen=seen * 1e6))
        return replace(measured, value=seen, bound=Bound.AT_MOST)
    bound = Bound.NONE
    if stylus_radius is None:
        bound = Bound.AT_MOST
    if tip > 0.0:
        note = NoteKind.STYLUS_TAKEN_OFF
        if _may_show_stylus_cone(crossed, measured.value + tip):
            note = NoteKind.STYLUS_TAKEN_OFF_BOUND
            bound = Bound.AT_MOST
        notes.append(note.make_note(radius=tip * 1e6))
    return replace(measured, value=max(measured.value, 0.0), bound=bound)


def _list_usual_radii(crossed: CrossedEdges) -> list[Estimate]:
    """Return the radii of the profiles that show what most of them do, an arc or a flank."""
    shows_mostly_flanks = crossed.shows_mostly_flanks
    corners = []
    for edge in crossed.edges:
        has_flank = edge.flank is not None
        if has_flank == shows_mostly_flanks:
            corners.append(edge.radius)
    return corners


def _is_edge_unresolved(crossed: CrossedEdges, radii: list[Estimate]) -> bool:
    """Tell whether the edge is sharper than the sampling resolves."""
    return average_values(radii) < RESOLVED * crossed.spacing and not crossed.shows_mostly_flanks


def _make_sampling_component(crossed: CrossedEdges, single_std: float) -> Component:
    """Make the component of what lies between samples; `single_std` is the std of one profile [m].

    It lies anywhere there, alike in all rows unless the edge wanders over the samples: then a pixel
    and the noise of a row are not both at their ends.
    """
    how = "what lies between two samples, rectangular"
    if not crossed.is_map:
        return Component(Source.SAMPLING, math.hypot(single_std, 0.0), how=how, bounded=True)
    how = f"noise of one row, and one interval, which a pixel averages; {how}"
    pixel = crossed.spacing / math.sqrt(12.0)
    between = math.hypot(single_std, pixel)
    if float(np.std(crossed.edge_positions)) > pixel:
        between = max(single_std, pixel)
    return Component(Source.SAMPLING, between, how=how, bounded=True)


def _make_stylus_component(radius: float | None) -> Component | None:
    """Make the component of a stylus of a radius [m]; None of an optical instrument."""
    if radius is None:
        how = f"{UNSTATED}: the radius is at most this"
        return Component(Source.STYLUS_RADIUS, math.nan, how=how, assumed=True)
    if radius <= 0.0:
        return None
    std = _WORN * radius / math.sqrt(3.0)
    return Component(Source.STYLUS_RADIUS, std, how="a quarter of it, rectangular", bounded=True)


def _may_show_stylus_cone(crossed: CrossedEdges, seen_radius: float) -> bool:
    """Tell whether the radius that is seen [m] may be that of the cone of the stylus.

    It may where too few points lie on the riser.
    """
    highest = min(_COARSE * crossed.spacing, seen_radius / NO_RISER)
    return not crossed.shows_mostly_flanks and crossed.first_crossing.edge.height.value < highest


def _estimate_arc_form_std(crossed: CrossedEdges) -> float:
    """Return the change of the mean radius when the steeper half of the arcs is left out [m]."""
    arcs = []
    for crossing in crossed.crossings:
        is_long = crossing.edge.radius.value > _LEAST_ARC * crossing.row.spacing
        if crossing.edge.flank is None and is_long:
            arcs.append(crossing)
    chosen = arcs[:: max(len(arcs) // _MOST_REFITTED, 1)]
    refits = []
    for success in evaluate_each(_fit_radius_without_steep_half, chosen).evaluated:
        refits.append(Refit(success.item.edge.radius, success.result))
    return estimate_refit_std(refits, _NOISE_OF_FEW_POINTS)


def _fit_radius_without_steep_half(crossing: CrossedEdge) -> Estimate:
    """Return the radius of an arc without its steeper half [m]."""
    row = crossing.row
    edge = crossing.edge
    beyond = (row.position - edge.position) * edge.sign
    crown = (beyond <= 0.0) | (beyond >= _STEEP * edge.radius.value)
    heights = np.where(crown, row.height, np.nan)
    return fit_edge(row.position, heights, edge.exclusion).radius
