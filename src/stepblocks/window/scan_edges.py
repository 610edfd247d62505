"""The edges of a scan, to pick the working one where several may be it."""

from dataclasses import dataclass

from stepblocks.errors import MetrologyError
from stepblocks.inspect.found_edges import FoundEdge, find_edges
from stepblocks.inspect.profiles import sample_profiles
from stepblocks.quantities import format_number
from stepblocks.scans.scan import HeightMap, ScannedProfile
from stepblocks.window import texts

_MARGIN = 5.0  # sampling intervals kept out beside the flank of another edge [1]


@dataclass(frozen=True)
class ScanEdge:
    """An edge of a scan, as it is named on the picture.

    Attributes
    ----------
    name : str
        Its number from the start, its rise and its place.
    position : float
        Where it lies along the profiles [m].
    begin, end : str
        Part of the profiles that holds it alone, as ``--from`` and ``--to`` take it; empty where
        no other edge lies on that side.
    """

    name: str
    position: float
    begin: str
    end: str


def list_scan_edges(scan: ScannedProfile | HeightMap) -> list[ScanEdge]:
    """List the edges of a scan, of a map those of its middle row; none where none stands out."""
    try:
        rows = sample_profiles(scan).rows
        row = rows[len(rows) // 2]
        found = find_edges(row.position, row.height)
    except MetrologyError:
        return []
    margin = _MARGIN * row.spacing
    edges = []
    for index, edge in enumerate(found):
        begin = ""
        end = ""
        if index > 0:
            begin = _format_position(found[index - 1].end + margin)
        if index + 1 < len(found):
            end = _format_position(found[index + 1].begin - margin)
        edges.append(ScanEdge(_name_edge(index + 1, edge), edge.position, begin, end))
    return edges


def _name_edge(number: int, edge: FoundEdge) -> str:
    """Name an edge by its number, its rise and its place."""
    sign = "+" if edge.rise > 0.0 else "-"
    rise = f"{sign}{format_number(abs(edge.rise) * 1e6)}"
    place = format_number(edge.position * 1e6)
    return texts.EDGE.format(number=number, rise=rise, place=place)


def _format_position(position: float) -> str:
    """Write a place along a profile as an option takes it."""
    return f"{position * 1e6:.6g} um"
