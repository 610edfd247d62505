"""Characteristics of a working edge: height, edge radius, burr, riser, and form of the faces."""

import math
from collections.abc import Callable, Iterator
from dataclasses import astuple, replace

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import (
    UNSTATED,
    UNSTATED_SCALE,
    Component,
    Instrument,
    Measured,
    add_instrument_components,
    average_profiles,
)
from stepblocks.inspect.edge import NO_RISER, Edge, find_position, fit_edge, fit_step
from stepblocks.inspect.edge_arc import (
    LEAST_ON_FLANK,
    RESOLVED,
    Flank,
    compute_edge_profile,
    is_flank_of_surface,
)
from stepblocks.inspect.form import (
    FaceForm,
    compute_flatness,
    compute_parallelism,
    estimate_zone,
    fit_face,
)
from stepblocks.inspect.levelling import (
    LEAST_FACE,
    PAIR,
    Feature,
    find_edges,
    measure_features,
)
from stepblocks.inspect.measure import (
    AS_FOUND,
    LEAST_SHARE,
    Evaluation,
    EvaluationOptions,
    Shown,
    evaluate_each,
    keep_profiles_that_agree,
    list_directions,
    sample_profiles,
)
from stepblocks.inspect.noise import Array, Estimate, compute_change
from stepblocks.inspect.working_edge.burr import find_burr
from stepblocks.scans.scan import HeightMap, ScannedProfile

_MOST_ACROSS = 300  # points of a map along either side through which the form of a face is fitted
_MOST_SLANT_ROWS = 12  # of a map, from which the direction of its edge is found
_TURNED = 0.01  # slope of an edge over a map from which it is turned [1]
# of the radius of an arc, over which it is steeper than 45 degrees; and sampling intervals that a
# radius needs for a fit without them [1]
_STEEP = 1.0 - math.sqrt(0.5)
_LEAST_ARC = 6.0
# sampling intervals in a height with too few points on a flank of 60 deg to tell it from an arc
_COARSE = 2.0 * (LEAST_ON_FLANK + 2.0) * math.tan(math.radians(60.0))
_WORN = 0.25  # of the radius of a stylus, that it may be off: a rectangle [1]
_LEVEL = 0.5e-3  # length of the level faces on either side of an edge that was seen [m]
_WORTH = 0.02  # of the step, from which another feature in its scan is named [1]
_OF_THE_EDGE = {"step_height", "edge_radius", "riser_angle", "riser_straightness"}
_MOST_FACES = 12  # profiles of faces that are kept for their roughness
_SECTION = "a section or replica across the edge would show it"


def measure_edge(
    scan: ScannedProfile | HeightMap, instrument: Instrument, options: EvaluationOptions = AS_FOUND
) -> Evaluation:
    """Measure a step across its edge, along the rows of a map, or its columns if these show it."""
    found, refused = evaluate_each(
        lambda one: _measure_along_rows(one, instrument, options),
        list_directions(scan, options.along),
    )
    if not found:
        raise MetrologyError(refused[0])
    return found[0][1]


def _measure_along_rows(
    scan: ScannedProfile | HeightMap, instrument: Instrument, options: EvaluationOptions
) -> Evaluation:
    rows, notes = sample_profiles(scan, options)
    if isinstance(scan, HeightMap):  # faces and burr, too, are those of the part that is asked for
        asked = (scan.x >= rows[0].position[0]) & (scan.x <= rows[0].position[-1])
        scan = replace(scan, height=np.where(asked, scan.height, np.nan))
    slant = _find_slant(rows)
    turn = 1.0 / math.hypot(1.0, slant)
    if slant != 0.0:  # the profile across the edge is shorter than the row
        rows = [replace(row, position=row.position * turn) for row in rows]
        notes.append(f"edge turned by {math.degrees(math.atan(slant)):.3g} deg; measured across it")
    found, refused = evaluate_each(
        lambda row: fit_edge(row.position, row.height, options.exclusion),
        rows,
        LEAST_SHARE * len(rows),
    )
    crossed = np.array(
        [(one.height.value, one.position, one.exclusion) for _, one in found]
    ).reshape(-1, 3, 1)
    results = keep_profiles_that_agree(found, crossed.swapaxes(0, 1), rows, refused, notes)
    edges = [edge for _, edge in results]
    flanks = [one.flank for one in edges if one.flank is not None]
    flanks = flanks if 2 * len(flanks) > len(edges) else []
    origin = "change with twice the exclusion, rectangular"
    form = Component("form", _estimate_form(results), how=origin)
    heights = [one.height for one in edges]
    values = {
        "step_height": average_profiles("step height", heights, instrument, [form]),
        "edge_radius": _average_radius(
            results, isinstance(scan, HeightMap), instrument, options, notes
        ),
    }
    missing = dict.fromkeys(
        ("riser_angle", "riser_straightness"),
        f"the riser is upright as far as it is seen from above; {_SECTION}",
    )
    surface = None
    if flanks:
        riser, reason = _measure_riser(results, flanks, instrument, options, notes)
        values |= riser
        missing = {} if riser else dict.fromkeys(missing, reason)
        surface = _extend_by_level_faces(*results[0]) if riser else None
    first, edge = results[0]
    if beside := _find_other_features(first, edge):
        notes.append(
            "the scan also shows "
            + ", ".join(
                f"{one.height.value * 1e6:+.3g} um at {one.begin * 1e6:.4g} um" for one in beside
            )
        )
    for one in beside:  # a flank is followed by another at once
        near = abs(one.begin - edge.middle) < 2.0 * edge.exclusion + LEAST_FACE * first.spacing
        rise = edge.height.value if edge.rising else -edge.height.value
        MetrologyError.require(
            not (near and abs(one.height.value + rise) < PAIR * abs(rise)),
            f"edge must have a face of {LEAST_FACE} points on either side, got a notch or ridge",
        )
    # a second step bends the planes: only the part between such steps is levelled
    steps = [one.begin for one in beside if not np.isfinite(one.end)]
    if steps and options.begin is None and options.end is None:
        before = max([at for at in steps if at < edge.middle], default=first.position[0])
        behind = min([at for at in steps if at > edge.middle], default=first.position[-1])
        narrow = _measure_along_rows(
            scan, instrument, replace(options, begin=before / turn, end=behind / turn)
        ).values
        values |= {key: one for key, one in narrow.items() if key in values and key in _OF_THE_EDGE}
        notes[-1] += "; height and radius are those of the part between such steps"
    across, level = _measure_across(scan, results, turn)
    values |= _measure_burr(across, level, results, instrument, notes, missing)
    covered = dict[str, tuple[float, float]]()
    if isinstance(scan, HeightMap):
        faces, covered = _measure_faces(scan, across, edge, instrument, notes)
        values |= faces
    if rejected := sum(one.rejected for one in edges):
        notes.append(f"{rejected} points missing or left out as spikes")
    if not steps and any(one.radius.value < RESOLVED * first.spacing for one in edges):
        notes.append(
            "edge sharper than the sampling resolves; radius below "
            f"{max(one.radius_limit for one in edges) * 1e6:.2g} um at 95 %"
        )
    return Evaluation(
        values,
        f"two planes with a common slope, {edge.exclusion * 1e6:.4g} um excluded on either side "
        f"of the edge; radius by arc{' of the corner beside its flank' if flanks else ''}",
        tuple(notes),
        _build_shown(first, edge, bool(flanks)),
        arc=surface is None,
        missing=missing,
        covered=covered,
        surface=surface,
        faces=tuple(_extract_faces(results)),
    )


def _find_other_features(row: ScannedProfile, edge: Edge) -> list[Feature]:
    # Find the steps, ridges and grooves that a profile shows beside the edge that is evaluated.
    u, level = edge.measure_across(row.position, row.height)
    rest = np.where(np.abs(u) > edge.exclusion, level - edge.height.value * (u > 0.0), np.nan)
    found = evaluate_each(
        lambda x: measure_features(x, rest, find_edges(x, rest), None, None).features,
        [row.position],
    )[0]
    return [
        one
        for _, features in found
        for one in features
        if abs(one.height.value) > _WORTH * edge.height.value
        # else what the edge left open: the flank of that begins before what was left out
        and abs(one.begin - edge.middle) > edge.exclusion + one.flanks
    ]


def _find_slant(rows: list[ScannedProfile]) -> float:
    # Return how far the edge of a map moves along x per distance along y [1]; 0 where it does not.
    found = evaluate_each(
        lambda row: find_position(row.position, row.height),
        rows[:: max(len(rows) // _MOST_SLANT_ROWS, 1)],
    )[0]
    # of a ridge or groove the walls are as high: only those on one side are one edge
    walls = [
        [(row.offset, position) for row, (position, rises) in found if rises is rising]
        for rising in (True, False)
    ]
    places = np.array(max(walls, key=len))
    if len(places) < 3:
        return 0.0
    lag = len(places) // 2
    ahead, behind = places[lag:], places[: len(places) - lag]
    slant = float(np.median((ahead[:, 1] - behind[:, 1]) / (ahead[:, 0] - behind[:, 0])))
    return slant if abs(slant) > _TURNED else 0.0


def _average_radius(
    results: list[tuple[ScannedProfile, Edge]],
    is_map: bool,
    instrument: Instrument,
    options: EvaluationOptions,
    notes: list[str],
) -> Measured:
    # Average the edge radius over profiles, with what sampling, pixels and stylus leave open of it.
    edges = [edge for _, edge in results]
    spacing = results[0][0].spacing
    sloped = 2 * sum(one.flank is not None for one in edges) > len(edges)
    corners = [one.radius for one in edges if (one.flank is not None) == sloped]
    others = [Component("form", _estimate_arc_form(results), how="change without its steep half")]
    tip = options.stylus_radius or 0.0
    single = float(np.mean([one.std for one in corners]))
    sharp = float(np.mean([one.value for one in corners])) < RESOLVED * spacing and not sloped
    if is_map or sharp:
        # what lies between two samples lies anywhere there, alike in all rows unless the edge
        # wanders over the samples: then a pixel and the noise of a row are not both at their ends
        pixel = spacing / math.sqrt(12.0) if is_map else 0.0
        wanders = is_map and float(np.std([one.middle for one in edges])) > pixel
        between = max(single, pixel) if wanders else math.hypot(single, pixel)
        averaged = "noise of one row, and one interval, which a pixel averages; " if is_map else ""
        origin = f"{averaged}what lies between two samples, rectangular"
        others.append(Component("sampling", between, how=origin, bounded=True))
        single = 0.0
    corners = [Estimate(one.value - tip, single, one.dof) for one in corners]
    if options.stylus_radius is None:
        others.append(
            Component("stylus radius", math.nan, how=f"{UNSTATED}: the radius is at most this")
        )
    elif tip > 0.0:
        others.append(
            Component(
                "stylus radius",
                _WORN * tip / math.sqrt(3.0),
                how="a quarter of it, rectangular",
                bounded=True,
            )
        )
    found = average_profiles("edge radius", corners, instrument, others, axes=(1.0, 1.0))
    stylus = f"the stylus radius of {tip * 1e6:.3g} um is"
    if found.value + found.expanded() < 0.0:
        seen = replace(found, value=found.value + tip, bound="at most")
        notes.append(
            f"{stylus} not taken off the edge radius: the edge shows {seen.value * 1e6:.2g} um, "
            "sharper than such a stylus can; check what is stated"
        )
        return seen
    bounded = options.stylus_radius is None
    if tip > 0.0:
        notes.append(f"{stylus} taken off the edge radius")
        most = min(_COARSE * spacing, (found.value + tip) / NO_RISER)
        if not sloped and edges[0].height.value < most:
            bounded = True
            notes[-1] += ", at most this: too few points lie on the riser to tell it from the cone"
    return replace(found, value=max(found.value, 0.0), bound="at most" if bounded else "")


def _estimate_arc_form(results: list[tuple[ScannedProfile, Edge]]) -> float:
    # Return the change of the mean radius when the steeper half of the arcs is left out [m].
    arcs = [
        (row, edge)
        for row, edge in results
        if edge.flank is None and edge.radius.value > _LEAST_ARC * row.spacing
    ]

    def fit_crown(one: tuple[ScannedProfile, Edge]) -> Estimate:
        row, edge = one
        beyond = (row.position - edge.position) * (1.0 if edge.rising else -1.0)
        crown = (beyond <= 0.0) | (beyond >= _STEEP * edge.radius.value)
        return fit_edge(row.position, np.where(crown, row.height, np.nan), edge.exclusion).radius

    crowns = evaluate_each(fit_crown, arcs[:: max(len(arcs) // 10, 1)])[0]
    # a fit of few points is no normal law: twice what noise changes is none
    return compute_change([(edge.radius, crown) for (_, edge), crown in crowns], 2.0)


def _measure_riser(
    results: list[tuple[ScannedProfile, Edge]],
    flanks: list[Flank],
    instrument: Instrument,
    options: EvaluationOptions,
    notes: list[str],
) -> tuple[dict[str, Measured], str]:
    # Return angle and straightness of a riser that slopes; why not, where the stylus may show it
    # so.
    angle = float(np.mean([one.angle for one in flanks]))
    off = float(np.mean([one.angle_std for one in flanks]))
    slope = f"{math.degrees(angle):.1f} +-{math.degrees(2.0 * off):.1f} deg"
    notes.append(
        f"the edge is no arc: its flank slopes by {slope}, its radius is that of the corner"
    )
    if not is_flank_of_surface(angle, off, options.stylus_cone):
        unstated = ", which is not stated," if options.stylus_cone is None else ""
        cone = f"cone of the stylus{unstated}"
        notes[-1] += f", and the flank may be steeper: the {cone} shows none steeper"
        return {}, f"the {cone} shows no riser steeper than {slope}; {_SECTION}"
    scales = [
        UNSTATED_SCALE if one is None else one
        for one in (instrument.calibration_std, instrument.lateral_std)
    ]
    relative = 0.5 * math.sin(2.0 * angle) * math.hypot(*scales)
    parts = (
        Component(
            "noise",
            math.hypot(off, np.std([one.angle for one in flanks])),
            how="covariance of the fit of the flank",
        ),
        Component("calibration", relative, how="of both scales"),
    )
    values = {"riser_angle": Measured("angle of the riser", angle, parts)}
    value, std, _ = np.array(
        [
            astuple(edge.measure_riser(row.position, row.height, angle))
            for row, edge in results
            if edge.flank is not None
        ]
    ).T
    noise = Component(
        "noise",
        # neighbouring profiles may err together: their scatter is not divided
        math.hypot(std.mean(), value.std()),
        how="covariance of the form, and scatter over the profiles",
    )
    values["riser_straightness"] = add_instrument_components(
        "straightness of the riser", float(value.mean()), [noise], instrument
    )
    return values, ""


def _extend_by_level_faces(row: ScannedProfile, edge: Edge) -> ScannedProfile:
    # Return the edge as it was scanned between level faces, so that the length of a scan says
    # nothing.
    u, level = edge.measure_across(row.position, row.height)
    used = (np.abs(u) < edge.exclusion) & np.isfinite(level) & ~edge.dropped
    order = np.argsort(u[used])
    known = np.concatenate([[-edge.exclusion], u[used][order], [edge.exclusion]])
    heights = np.concatenate([[0.0], level[used][order], [edge.height.value]])
    count = round(_LEVEL / row.spacing)
    position = np.arange(-count, count, dtype=np.float64) * row.spacing
    return ScannedProfile(position, np.interp(position, known, heights), row.source)


def _measure_across(
    scan: ScannedProfile | HeightMap, results: list[tuple[ScannedProfile, Edge]], turn: float
) -> tuple[Array, Array]:
    # Return distances from the edge and heights over the lower face [m], shape (ny, nx), of the
    # whole scan.
    if isinstance(scan, ScannedProfile):
        row, edge = results[0]
        u, level = edge.measure_across(row.position, row.height)
        return u[np.newaxis], level[np.newaxis]
    y = np.array([row.offset for row, _ in results])
    sign = 1.0 if results[0][1].rising else -1.0
    lines = [
        np.polyval(np.polyfit(y, values, 1), scan.y)
        if np.ptp(y) > 0.0
        else np.full(len(scan.y), values[0])
        for values in ([edge.middle for _, edge in results], [edge.offset for _, edge in results])
    ]
    x = scan.x * turn
    tilt = float(np.median([edge.tilt for _, edge in results]))
    return (
        sign * (x - lines[0][:, np.newaxis]),
        scan.height - lines[1][:, np.newaxis] - tilt * x,
    )


def _measure_burr(
    across: Array,
    level: Array,
    results: list[tuple[ScannedProfile, Edge]],
    instrument: Instrument,
    notes: list[str],
    missing: dict[str, str],
) -> dict[str, Measured]:
    found = find_burr(
        across, level, *np.median([(one.height.value, one.exclusion) for _, one in results], axis=0)
    )
    if found is None:
        missing["burr"] = (
            "a scan that reaches 0.2 mm beyond the edge on the upper face would show it"
        )
        return {}
    if found.spikes:
        plural = "s" * (found.spikes > 1)
        notes.append(
            f"{found.spikes} single isolated point{plural} near the edge left out as "
            f"spike{plural}, up to {found.highest_spike * 1e6:.3g} um over the face"
        )
    own = [
        Component("noise", found.height.std, how="valleys of the face and the lower face"),
        Component("peak", found.noise, how="half of what noise alone shows"),
        Component("sampling", found.sampling, how="a peak between two points, rectangular"),
    ]
    return {"burr": add_instrument_components("burr", found.height.value, own, instrument)}


def _extract_faces(results: list[tuple[ScannedProfile, Edge]]) -> Iterator[ScannedProfile]:
    # Yield the two faces of some profiles, levelled, those of the lower face first.
    some = results[:: max(len(results) // _MOST_FACES, 1)]
    for side in (-1.0, 1.0):
        for row, edge in some:
            u, level = edge.measure_across(row.position, row.height)
            inside = side * u > edge.exclusion
            yield ScannedProfile(row.position[inside], level[inside], row.source)


def _build_shown(first: ScannedProfile, edge: Edge, sloped: bool) -> Shown:
    x = first.position
    before, behind = edge.middle - edge.exclusion, edge.middle + edge.exclusion
    windows = (float(x[0]), before, "face"), (behind, float(x[-1]), "face")
    level = first.height - edge.tilt * x
    lower = (x < before) if edge.rising else (x > behind)
    sign = 1.0 if edge.rising else -1.0
    corner = 0.0 if sloped else max(edge.radius.value, 0.0)
    return Shown(
        x,
        level - np.nanmedian(level[lower]),
        windows,
        compute_edge_profile(sign * x, sign * edge.position, edge.height.value, corner),
        edge.dropped,
    )


def _estimate_form(results: list[tuple[ScannedProfile, Edge]]) -> float:
    # Return the change of the mean height when twice as much is excluded [m].
    some = results[:: max(len(results) // 10, 1)]
    wider = evaluate_each(
        lambda one: fit_step(one[0].position, one[0].height, 2.0 * one[1].exclusion), some
    )[0]
    return compute_change([(edge.height, wide) for (_, edge), wide in wider], 1.0)


def _measure_faces(
    scan: HeightMap,
    across: Array,
    edge: Edge,
    instrument: Instrument,
    notes: list[str],
) -> tuple[dict[str, Measured], dict[str, tuple[float, float]]]:
    # Return flatness and parallelism of the faces of a map, how they lie in it, and how far they
    # were scanned.
    # a form of degree three needs no more
    thin = tuple(slice(None, None, max(size // _MOST_ACROSS, 1)) for size in scan.height.shape)
    x, y = scan.x[thin[1]], scan.y[thin[0]]
    height, side = scan.height[thin], across[thin]
    known = np.isfinite(height)
    lower, upper = side < -edge.exclusion, side > edge.exclusion
    low, high = (fit_face(x, y, height, face) for face in (lower, upper))
    asked: dict[str, tuple[str, Callable[..., float], tuple[FaceForm, ...]]] = {
        "flatness_lower": ("flatness, lower face", compute_flatness, (low,)),
        "flatness_upper": ("flatness, upper face", compute_flatness, (high,)),
        "parallelism": ("parallelism, upper face to A", compute_parallelism, (high, low)),
    }
    zones = [
        (name, zone(*[face.points for face in faces]) * 1e6) for name, zone, faces in asked.values()
    ]
    notes.append(
        "flatness and parallelism are those of the form, polynomials of degree "
        f"{max(low.degree, high.degree)}, over what was scanned; zones of all points, noise "
        f"included: {', '.join(f'{name} {size:.3g} um' for name, size in zones)}"
    )
    values = {}
    for key, (name, zone, faces) in asked.items():
        form = estimate_zone(zone, *faces)
        noise = Component("noise", form.std, form.dof, "draws from the covariance of the form")
        values[key] = add_instrument_components(name, form.value, [noise], instrument)
    seen = {
        name: (float(np.ptp(side[face & known])), float(y[-1]))
        for name, face in (("flatness_lower", lower), ("flatness_upper", upper))
    }
    seen["parallelism"] = min(seen.values())
    return values, seen
