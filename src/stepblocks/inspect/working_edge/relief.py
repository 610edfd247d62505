"""Relief at the root of a riser: it is measured, and taken out of the lower face."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.inspect.attempts import evaluate_each
from stepblocks.inspect.budget import (
    Bound,
    Instrument,
    Measured,
    ScalePowers,
    average_profiles,
)
from stepblocks.inspect.edge import find_largest_edge, fit_step_height
from stepblocks.inspect.evaluation import EvaluationOptions
from stepblocks.inspect.found_edges import FoundEdge, find_edges
from stepblocks.inspect.layout import DeclaredRelief
from stepblocks.inspect.levelling import LEAST_FACE
from stepblocks.inspect.noise import LEAST_SCATTER, Array, Estimate, Mask
from stepblocks.inspect.notes import Note, NoteKind, NotMeasuredReason
from stepblocks.inspect.profiles import LEAST_SHARE, sample_profiles
from stepblocks.scans.scan import HeightMap, ScannedProfile

_MOST_ROWS = 40  # of a map, in which the relief is looked for
_PLAUSIBLE = 0.5  # part of the declared size by which a relief may be off to be taken for it [1]
_BESIDE_RISER = 0.15  # part of the width beside the riser that shows the floor no more [1]
_WALL = 0.25  # part of the width kept out on either side of the wall [1]
_FACE = 0.3e-3  # of the lower face beside the relief, by which its depth is measured, at least [m]
_FACE_WIDTHS = 3.0  # widths of the relief that it is long, at least [1]
_FOOT = 20.0  # sampling intervals at the foot of the riser where the lower face goes on [1]
_MARGIN = 3.0  # sampling intervals beside the wall that are left out with the relief [1]
_SPIKE = 6.0  # usual deviations from which a point is none of the face [1]
_WIDTH_POWERS = ScalePowers(vertical=0.0, lateral=1.0)


@dataclass(frozen=True)
class CoveredRelief:
    """A scan without its relief, and what the relief measures.

    Attributes
    ----------
    scan : ScannedProfile or HeightMap
        The lower face goes on over the relief as it is beside it, mirrored at the wall.
    filled : array of bool or None
        Points over the relief, of the shape of its heights.
    values : dict of Measured
        Width and depth of the relief, by key.
    missing : dict of str
        Why one of them was not measured, by key.
    notes : list of Note
        That the relief was taken out.
    """

    scan: ScannedProfile | HeightMap
    filled: Mask | None = None
    values: dict[str, Measured] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)
    notes: list[Note] = field(default_factory=list)

    def remove_filled_points(self, scan: HeightMap) -> HeightMap:
        """Return the map without what was not measured: the face over the relief."""
        if self.filled is None:
            return scan
        return replace(scan, height=np.where(self.filled, np.nan, scan.height))


@dataclass(frozen=True)
class _ReliefOfRow:
    """A relief as one profile shows it [m]."""

    row: ScannedProfile
    riser: FoundEdge
    wall: float  # where its half depth is crossed, along the profile
    depth: Estimate
    rise: float  # of the upper face over the floor

    @property
    def width(self) -> float:
        """Width along the profile [m]."""
        return abs(self.wall - self.riser.position)


@dataclass(frozen=True)
class _Places:
    """Where riser and wall lie on each profile of a scan: lines over its rows."""

    riser: np.polynomial.Polynomial
    wall: np.polynomial.Polynomial
    sign: float  # 1 where the riser rises along the profile, else -1


@dataclass(frozen=True)
class _ReliefPoints:
    """Points of a profile in its relief, and heights of the lower face over them."""

    inside: Mask  # shape (n,)
    heights: Array  # shape (points inside,) [m]


def measure_and_cover_relief(
    scan: ScannedProfile | HeightMap, instrument: Instrument, options: EvaluationOptions
) -> CoveredRelief:
    """Measure the relief that the declaration has at the root, and cover it.

    A scan that does not show it, or of a part without one, stays as it is.
    """
    if options.layout is None or options.layout.relief is None:
        return CoveredRelief(scan)
    declared = options.layout.relief
    rows = sample_profiles(scan, options).rows
    chosen = rows[:: max(len(rows) // _MOST_ROWS, 1)]
    found = evaluate_each(lambda row: _find_relief_of_row(row, declared), chosen).results
    if len(found) < LEAST_SHARE * len(chosen):
        reason = NotMeasuredReason.RELIEF_NOT_SEEN.format_message()
        return CoveredRelief(scan, missing=dict.fromkeys(("relief_width", "relief_depth"), reason))
    places = _fit_riser_and_wall_lines(found)
    depths = [relief.depth for relief in found]
    depth = average_profiles("depth of the relief", depths, instrument)
    without_relief, filled = _fill_relief_of_scan(scan, places, declared)
    covered = CoveredRelief(
        scan=without_relief,
        filled=filled,
        values={"relief_depth": depth},
        notes=[NoteKind.RELIEF_LEFT_OUT.make_note(width=_compute_median_width(found) * 1e6)],
    )
    if options.stylus_radius == 0.0 and options.stylus_cone == 0.0:
        covered.values["relief_width"] = _average_relief_width(found, places, instrument)
        return covered
    least = _average_least_relief_width(found, places, instrument)
    if least is None:
        covered.missing["relief_width"] = NotMeasuredReason.WALLS_OF_RELIEF.format_message()
    else:
        covered.values["relief_width"] = least
    return covered


def _find_relief_of_row(row: ScannedProfile, declared: DeclaredRelief) -> _ReliefOfRow:
    """Find the relief of a profile: that beside the edge that rises highest over its floor.

    Raises
    ------
    MetrologyError
        If no edge has a relief about as wide and as deep as declared.
    """
    edges = find_edges(row.position, row.height)
    found = evaluate_each(partial(_find_relief_beside, row, declared), edges).results
    if not found:
        raise MetrologyError(f"relief must lie beside one of the edges, got {len(edges)} without")
    return max(found, key=lambda relief: relief.rise)


def _find_relief_beside(
    row: ScannedProfile, declared: DeclaredRelief, riser: FoundEdge
) -> _ReliefOfRow:
    """Find a relief on the lower side of an edge.

    Raises
    ------
    MetrologyError
        If there is none about as wide and as deep as declared.
    """
    sign = 1.0 if riser.rise > 0.0 else -1.0
    across = sign * (row.position - riser.position)
    width = declared.width
    farthest = (1.0 + _PLAUSIBLE) * width + max(_FACE, _FACE_WIDTHS * width)
    beside_riser = _BESIDE_RISER * width
    beside = (across > -farthest) & (across < -beside_riser)
    floor = beside & (across > -0.5 * width)
    upper = (across > beside_riser) & (across < 0.5 * width)
    for part, name in ((beside, "face"), (floor, "floor"), (upper, "upper face")):
        points = int((part & np.isfinite(row.height)).sum())
        if points < LEAST_FACE:
            raise MetrologyError(f"{name} of a relief must show {LEAST_FACE} points, got {points}")
    position = row.position[beside]
    height = row.height[beside]
    wall = find_largest_edge(position, height)
    depth = fit_step_height(position, height, _WALL * width)
    wide = sign * (riser.position - wall.position)
    is_there = wall.rising is not (riser.rise > 0.0) and abs(wide - width) <= _PLAUSIBLE * width
    if not is_there or abs(depth.value - declared.depth) > _PLAUSIBLE * declared.depth:
        raise MetrologyError(
            f"relief must be about as declared, got {wide * 1e6:.3g} um by "
            f"{depth.value * 1e6:.3g} um"
        )
    rise = float(np.nanmedian(row.height[upper]) - np.nanmedian(row.height[floor]))
    return _ReliefOfRow(row, riser, wall.position, depth, rise)


def _fit_riser_and_wall_lines(found: Sequence[_ReliefOfRow]) -> _Places:
    """Fit lines to the places of riser and wall over the rows of a map."""
    offsets, risers, walls = [], [], []
    rising = 0
    for relief in found:
        offsets.append(relief.row.offset)
        risers.append(relief.riser.position)
        walls.append(relief.wall)
        if relief.riser.rise > 0.0:
            rising += 1
    degree = 0
    if max(offsets) > min(offsets):
        degree = 1
    sign = -1.0
    if 2 * rising > len(found):
        sign = 1.0
    y = np.array(offsets)
    return _Places(
        riser=np.polynomial.Polynomial.fit(y, np.array(risers), degree),
        wall=np.polynomial.Polynomial.fit(y, np.array(walls), degree),
        sign=sign,
    )


def _compute_median_width(found: Sequence[_ReliefOfRow]) -> float:
    """Return the median width along the profiles [m]."""
    return float(np.median([relief.width for relief in found]))


def _average_relief_width(
    found: Sequence[_ReliefOfRow], places: _Places, instrument: Instrument
) -> Measured:
    """Average the width over the profiles, across the edge of a map that is turned."""
    slant = float(places.riser.deriv()(0.0))
    turn = 1.0 / np.hypot(1.0, slant)
    std = found[0].row.spacing / np.sqrt(6.0)  # one interval at either end, rectangular
    widths = []
    for relief in found:
        widths.append(Estimate(relief.width * turn, std * turn))
    return average_profiles("width of the relief", widths, instrument, scale_powers=_WIDTH_POWERS)


def _average_least_relief_width(
    found: Sequence[_ReliefOfRow], places: _Places, instrument: Instrument
) -> Measured | None:
    """Average the least width that the traces of a stylus prove; None where they show none.

    A trace is the surface dilated by the stylus (ISO 16610-40), and nowhere below it: where it
    lies below half the depth, the relief is at least as deep. So it is at least so wide.
    """
    slant = float(places.riser.deriv()(0.0))
    turn = 1.0 / np.hypot(1.0, slant)
    std = found[0].row.spacing / np.sqrt(6.0)  # one interval at either end, rectangular
    widths = []
    for relief in found:
        width = _measure_width_at_half_depth(relief)
        if width > 0.0:
            widths.append(Estimate(width * turn, std * turn))
    if len(widths) < LEAST_SHARE * len(found):
        return None
    measured = average_profiles(
        "width of the relief", widths, instrument, scale_powers=_WIDTH_POWERS
    )
    return replace(measured, bound=Bound.AT_LEAST)


def _measure_width_at_half_depth(relief: _ReliefOfRow) -> float:
    """Return how far a profile lies below half the depth of its relief [m]; 0 if never."""
    position = relief.row.position
    height = relief.row.height
    sign = 1.0 if relief.riser.rise > 0.0 else -1.0
    across = sign * (position - relief.riser.position)
    width = relief.width
    face = (across < -(1.0 + _WALL) * width) & (across > -width - max(_FACE, _FACE_WIDTHS * width))
    face &= np.isfinite(height)
    if face.sum() < LEAST_FACE:
        return 0.0
    lower = _fit_robust_face_line(position[face], height[face])(position)
    is_below = height < lower - 0.5 * relief.depth.value  # nowhere where nothing was measured
    middle = int(np.argmin(np.abs(across + 0.5 * width)))
    if not is_below[middle]:
        return 0.0
    # from the middle on, so that a spike elsewhere adds nothing
    not_below = np.flatnonzero(~is_below)
    first = int(not_below[not_below < middle].max(initial=-1)) + 1
    last = int(not_below[not_below > middle].min(initial=len(is_below))) - 1
    return abs(float(position[last] - position[first]))


def _find_relief_points(
    position: Array, height: Array, offset: float, places: _Places, declared: DeclaredRelief
) -> _ReliefPoints | None:
    """Find the points of a profile in the relief; None where too little of the face is beside it.

    All that lies lower than the lower face, from the wall to the riser, is relief.
    """
    riser = float(places.riser(offset))
    spacing = float(np.median(np.diff(position)))
    across = places.sign * (position - riser)
    wall = -abs(float(places.wall(offset)) - riser) - _MARGIN * spacing
    face = (across < wall) & (across > wall - max(_FACE, _FACE_WIDTHS * declared.width))
    face &= np.isfinite(height)
    if face.sum() < LEAST_FACE:
        return None
    lower = _fit_robust_face_line(position[face], height[face])(position)
    inside = (across >= wall) & (across < _FOOT * spacing) & ~(height > lower)
    # as far from the wall as they are, the face is seen
    mirrored = np.interp(
        2.0 * wall - across[inside], *_sort_by_position(across[face], (height - lower)[face])
    )
    return _ReliefPoints(inside, lower[inside] + mirrored)


def _sort_by_position(across: Array, level: Array) -> tuple[Array, Array]:
    """Sort positions and levels by position."""
    order = np.argsort(across)
    return across[order], level[order]


def _fill_relief_of_scan(
    scan: ScannedProfile | HeightMap, places: _Places, declared: DeclaredRelief
) -> tuple[ScannedProfile | HeightMap, Mask]:
    """Return a scan whose lower face goes on over its relief, and the points that are so."""
    if isinstance(scan, ScannedProfile):
        position = scan.position
        rows = [(scan.offset, scan.height)]
    else:
        position = scan.x
        rows = list(zip(scan.y.tolist(), scan.height, strict=True))
    heights = np.array([height for _, height in rows])
    filled = np.zeros(heights.shape, dtype=bool)
    for index, (offset, height) in enumerate(rows):
        points = _find_relief_points(position, height, offset, places, declared)
        if points is not None:
            filled[index] = points.inside
            heights[index, points.inside] = points.heights
    shape = scan.height.shape
    return replace(scan, height=heights.reshape(shape)), filled.reshape(shape)


def _fit_robust_face_line(position: Array, height: Array) -> np.polynomial.Polynomial:
    """Fit a line to a face without the points far off it."""
    line = np.polynomial.Polynomial.fit(position, height, 1)
    off = np.abs(height - line(position))
    near = off <= _SPIKE * max(float(np.median(off)), LEAST_SCATTER)
    return np.polynomial.Polynomial.fit(position[near], height[near], 1)
