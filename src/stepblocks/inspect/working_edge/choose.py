"""Which of several edges in a scan is the working edge: what lies beside it says so."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.inspect.attempts import evaluate_each, evaluate_if_possible
from stepblocks.inspect.found_edges import FoundEdge, find_edges
from stepblocks.inspect.layout import DeclaredLayout
from stepblocks.scans.scan import ScannedProfile

_MOST_ROWS = 12  # of a map, in which the working edge is looked for
# Distance within which a lesser edge is a part of a greater one, such as its burr [m]
_SAME_EDGE = 0.1e-3
_PLAUSIBLE = 0.3  # part of the declared step by which that of the working edge may be off [1]
_MARGIN = 5.0  # sampling intervals kept out beside the flank of another edge [1]
# how a user says which edge of a block with two steps is meant
_NAME_ONE = (
    "say which one a scan shows by --feature first-edge or second-edge, with --from and --to where "
    "it shows both"
)


@dataclass(frozen=True)
class _EdgesOfRow:
    """The edges of a profile, each with what belongs to it."""

    row: ScannedProfile
    edges: tuple[FoundEdge, ...]

    def describe_edges(self) -> str:
        """Name the edges by what they rise and where they lie."""
        named = []
        for edge in self.edges:
            named.append(f"{edge.rise * 1e6:+.3g} um at {edge.position * 1e6:.4g} um")
        return ", ".join(named)


@dataclass(frozen=True, order=True)
class _Fit:
    """How well a scan fits the declaration if an edge is the working one; the best is greatest."""

    is_possible: bool
    explained: int  # edges beside it that the declaration has
    is_plausible: bool  # whether it is about as high
    unexplained: int  # less the edges that it has not


@dataclass(frozen=True)
class Stretch:
    """The part of a scan in which the working edge lies alone."""

    begin: float  # m
    end: float  # m
    beside: str  # which other edges were left out


def find_working_stretch(rows: Sequence[ScannedProfile], layout: DeclaredLayout) -> Stretch | None:
    """Find the stretch of a scan in which the working edge lies alone.

    Parameters
    ----------
    rows : sequence of ScannedProfile
        Profiles of a scan.
    layout : DeclaredLayout
        What lies beside the edge.

    Returns
    -------
    Stretch or None
        None where no profile shows another edge.

    Raises
    ------
    MetrologyError
        If several edges may be the working edge, or the scan fits upside down.
    """
    chosen = rows[:: max(len(rows) // _MOST_ROWS, 1)]
    found = evaluate_each(lambda row: _find_edges_of_row(row, layout), chosen).results
    several = [edges for edges in found if len(edges.edges) > 1]
    if not several and not layout.may_be_alone:
        raise _make_missing_edge_error(found, layout)
    if not several:
        return None
    decided: list[tuple[_EdgesOfRow, int]] = []
    for edges in several:
        index = _choose_working_edge_index(edges, layout)
        if index is not None:
            decided.append((edges, index))
    if not decided:
        raise _make_ambiguity_error(several[0], layout)
    return _find_common_stretch(several, decided)


def _find_edges_of_row(row: ScannedProfile, layout: DeclaredLayout) -> _EdgesOfRow:
    """Find the edges of a profile, a lesser one near a greater one being part of that."""
    edges = find_edges(row.position, row.height)
    if layout.needs_neighbours:
        edges += _find_lesser_edges_between(row, edges, layout)
    kept: list[FoundEdge] = []
    for edge in sorted(edges, key=lambda candidate: -abs(candidate.rise)):
        distances = _measure_edge_distances(kept, edge.position)
        if min(distances, default=np.inf) > _SAME_EDGE:
            kept.append(edge)
    kept.sort(key=lambda edge: edge.position)
    return _EdgesOfRow(row, tuple(kept))


def _measure_edge_distances(edges: Iterable[FoundEdge], position: float) -> list[float]:
    """Measure how far edges lie from a position along the profile [m]."""
    return [abs(edge.position - position) for edge in edges]


def _find_lesser_edges_between(
    row: ScannedProfile, edges: Sequence[FoundEdge], layout: DeclaredLayout
) -> list[FoundEdge]:
    """Find edges beside those found, each stretch for itself.

    Beside a far higher edge none of them stands out of the whole profile. What is far lower than
    any declared one is left out: dust and scratches are no edges of the part.
    """
    margin = _MARGIN * row.spacing
    begins, ends = [-np.inf], []
    for edge in edges:
        ends.append(edge.begin - margin)
        begins.append(edge.end + margin)
    ends.append(np.inf)
    rises = [abs(wall.rise) for wall in layout.walls]
    least = (1.0 - _PLAUSIBLE) * min(layout.step, *rises)
    beside: list[FoundEdge] = []
    for begin, end in zip(begins, ends, strict=True):
        inside = (row.position > begin) & (row.position < end)
        stretch = replace(row, position=row.position[inside], height=row.height[inside])
        found = evaluate_if_possible(_find_edges_of_stretch, stretch) or []
        beside += [edge for edge in found if abs(edge.rise) >= least]
    return beside


def _find_edges_of_stretch(stretch: ScannedProfile) -> list[FoundEdge]:
    """Find the edges of a part of a profile."""
    return find_edges(stretch.position, stretch.height)


def _choose_working_edge_index(edges: _EdgesOfRow, layout: DeclaredLayout) -> int | None:
    """Return the index of the working edge; None where several are as likely."""
    fits = _rate_edges_as_working(edges, layout)
    best = max(fits)
    if not best.is_possible or fits.count(best) > 1:
        return None
    if not best.explained and not best.is_plausible:
        return None
    return fits.index(best)


def _rate_edges_as_working(edges: _EdgesOfRow, layout: DeclaredLayout) -> list[_Fit]:
    """Compare the edges of a profile with a layout, each in turn as the working edge."""
    return [_rate_edge_as_working(edges, index, layout) for index in range(len(edges.edges))]


def _rate_edge_as_working(edges: _EdgesOfRow, edge_index: int, layout: DeclaredLayout) -> _Fit:
    """Compare the edges of a profile with a layout, if one of them is the working edge."""
    working = edges.edges[edge_index]
    sign = float(np.sign(working.rise))
    walls: set[int] = set()
    unexplained = 0
    is_plausible = _is_rise_plausible(working.rise, layout.step)
    for number, edge in enumerate(edges.edges):
        if number == edge_index:
            continue
        wall = layout.find_wall_index(sign * (edge.position - working.position), sign * edge.rise)
        if wall is None:
            unexplained += 1
        else:
            walls.add(wall)
            if layout.needs_neighbours:
                is_plausible &= _is_rise_plausible(edge.rise, layout.walls[wall].rise)
    is_possible = not _is_other_wall_missing(edges.row, working, sign, walls, layout)
    if layout.needs_neighbours:
        is_possible = is_plausible and len(walls) == len(layout.walls)
    return _Fit(
        is_possible=is_possible,
        explained=len(walls),
        is_plausible=is_plausible,
        unexplained=-unexplained,
    )


def _is_rise_plausible(rise: float, declared_rise: float) -> bool:
    """Tell whether an edge is about as high as declared [m], whichever way it is crossed."""
    return abs(abs(rise) - abs(declared_rise)) <= _PLAUSIBLE * abs(declared_rise)


def _is_other_wall_missing(
    row: ScannedProfile, working: FoundEdge, sign: float, walls: set[int], layout: DeclaredLayout
) -> bool:
    """Tell whether a profile shows one wall of a groove or ridge, and not the other within it."""
    if len(walls) != 1:
        return False
    for index, wall in enumerate(layout.walls):
        if index in walls:
            continue
        place = working.position + sign * wall.place
        slack = _SAME_EDGE + 2.0 * row.spacing
        if row.position[0] + slack < place < row.position[-1] - slack:
            return True
    return False


def _make_ambiguity_error(edges: _EdgesOfRow, layout: DeclaredLayout) -> MetrologyError:
    """Make the error of a profile whose working edge cannot be told."""
    upside_down = layout.turn_upside_down()
    best = max(_rate_edges_as_working(edges, upside_down))
    fits_upside_down = best.is_possible and best.explained == len(layout.walls) > 0
    if layout.needs_neighbours:
        reading = ""
        if fits_upside_down:
            reading = " (as of heights that are upside down, or of steps in the other order)"
        return MetrologyError(
            "edges must be those of both steps as declared, and fit in one way, got "
            f"{edges.describe_edges()}{reading}: {_NAME_ONE}"
        )
    if fits_upside_down:
        return MetrologyError(
            "heights must be positive upwards: the edges of the scan are those of the part upside "
            f"down, got {edges.describe_edges()}"
        )
    return MetrologyError(
        "scan must show which of its edges is the working edge, got "
        f"{edges.describe_edges()}, of which several may be it: give the part that holds it "
        "alone by --from and --to"
    )


def _make_missing_edge_error(
    found: Sequence[_EdgesOfRow], layout: DeclaredLayout
) -> MetrologyError:
    """Make the error of a scan that shows one edge where the part has several."""
    shown = ""
    if found:
        shown = found[0].describe_edges()
    return MetrologyError(
        f"scan must show both edges of the part, got {shown or 'none'}: {_NAME_ONE}"
    )


def _find_common_stretch(
    several: Sequence[_EdgesOfRow], decided: Sequence[tuple[_EdgesOfRow, int]]
) -> Stretch:
    """Return the stretch that holds the working edge, and no other edge, in all profiles."""
    places = [edges.edges[index].position for edges, index in decided]
    usual = float(np.median(places))
    begins = []
    ends = []
    for edges in several:
        margin = _MARGIN * edges.row.spacing
        distances = _measure_edge_distances(edges.edges, usual)
        index = int(np.argmin(distances))
        begins.append(float(edges.row.position[0]))
        ends.append(float(edges.row.position[-1]))
        if index > 0:
            begins[-1] = edges.edges[index - 1].end + margin
        if index + 1 < len(edges.edges):
            ends[-1] = edges.edges[index + 1].begin - margin
    begin = max(begins)
    end = min(ends)
    if not begin < min(places) <= max(places) < end:
        raise MetrologyError(
            "working edge must keep clear of the other edges in all profiles, got one that runs "
            "across them: give a part that holds it alone by --from, --to or --area"
        )
    first, chosen = decided[0]
    beside = first.edges[:chosen] + first.edges[chosen + 1 :]
    return Stretch(begin, end, _EdgesOfRow(first.row, beside).describe_edges())
