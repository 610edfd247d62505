"""What a scan looks like, and how far it reaches: a picture beside what the file leaves open."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from stepblocks.quantities import format_quantity
from stepblocks.window import texts

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from stepblocks.scans.scan import HeightMap, ScannedProfile
    from stepblocks.window.scan_edges import ScanEdge

_MOST_POINTS = 4000  # of a profile that are drawn
_MOST_CELLS = 600  # of a map along a side that are drawn
_MOST_NAMED = 12  # edges that are named on the picture
_SIZE = 8.0, 3.6  # of the picture [inch]
_DOTS = 90  # per inch


@dataclass(frozen=True)
class ScanPicture:
    """A scan as it was read.

    Attributes
    ----------
    description : str
        How many points, over which lengths, between which heights.
    scale : str
        What the file says of its units.
    image : str
        Picture, as the address of a PNG that holds it.
    edges : tuple of ScanEdge
        Its edges, from the start of the profiles.
    columns : tuple of float
        Where each edge stands in the picture [pixels from the left].
    """

    description: str
    scale: str
    image: str
    edges: "tuple[ScanEdge, ...]" = ()
    columns: tuple[float, ...] = ()

    def find_nearest_edge(self, column: float) -> "ScanEdge | None":
        """Return the edge nearest to a column of the picture [pixels]; None without edges."""
        if not self.edges:
            return None
        distances = [abs(place - column) for place in self.columns]
        return self.edges[distances.index(min(distances))]


def read_and_draw_scan(path: Path, unit: str | None, channel: str | None) -> ScanPicture:
    """Read a scan and draw it, with its edges named.

    Raises
    ------
    MetrologyError
        If it cannot be read: the message asks for what the file leaves open.
    """
    from matplotlib.figure import Figure

    from stepblocks.scans.read import read_scan
    from stepblocks.scans.scan import ScannedProfile
    from stepblocks.window.scan_edges import list_scan_edges

    scan = read_scan(path, unit, channel)
    edges = list_scan_edges(scan)
    figure = Figure(figsize=_SIZE, dpi=_DOTS, layout="constrained")
    axes = figure.subplots()
    if isinstance(scan, ScannedProfile):
        _draw_profile(axes, scan)
    else:
        _draw_map(figure, axes, scan)
    _draw_edge_marks(axes, edges)
    image = encode_figure_as_data_url(figure)  # which lays the figure out, too
    places = [(1e3 * edge.position, 0.0) for edge in edges]
    columns: list[float] = []
    if places:
        columns = axes.transData.transform(places)[:, 0].tolist()
    return ScanPicture(
        _describe_size_and_range(scan), scan.scale, image, tuple(edges), tuple(columns)
    )


def _describe_size_and_range(scan: "ScannedProfile | HeightMap") -> str:
    """Describe points, lengths and range of heights of a scan."""
    from stepblocks.scans.scan import ScannedProfile

    height = scan.height[np.isfinite(scan.height)]
    low = format_quantity(float(height.min()), "length")
    high = format_quantity(float(height.max()), "length")
    if isinstance(scan, ScannedProfile):
        length = format_quantity(float(scan.position[-1] - scan.position[0]), "length")
        return texts.PROFILE_READ.format(
            points=scan.position.size, length=length, low=low, high=high
        )
    rows, columns = scan.height.shape
    return texts.MAP_READ.format(
        rows=rows,
        columns=columns,
        length=format_quantity(scan.dx * columns, "length"),
        width=format_quantity(scan.dy * rows, "length"),
        low=low,
        high=high,
    )


def _draw_profile(axes: "Axes", scan: "ScannedProfile") -> None:
    """Draw heights along the line."""
    step = -(-scan.position.size // _MOST_POINTS)
    axes.plot(1e3 * scan.position[::step], 1e6 * scan.height[::step], linewidth=1.0)
    axes.set_xlabel(texts.AXIS_ALONG)
    axes.set_ylabel(texts.AXIS_HEIGHT)


def _draw_map(figure: "Figure", axes: "Axes", scan: "HeightMap") -> None:
    """Draw heights as colours, true in plan."""
    rows, columns = scan.height.shape
    step = -(-max(rows, columns) // _MOST_CELLS)
    image = axes.imshow(
        1e6 * scan.height[::step, ::step],
        extent=(0.0, 1e3 * scan.dx * columns, 0.0, 1e3 * scan.dy * rows),
        origin="lower",
    )
    axes.set_xlabel(texts.AXIS_ALONG)
    axes.set_ylabel(texts.AXIS_ACROSS)
    figure.colorbar(image, label=texts.AXIS_HEIGHT)


def _draw_edge_marks(axes: "Axes", edges: "Sequence[ScanEdge]") -> None:
    """Draw a line at every edge, with its number above."""
    if len(edges) > _MOST_NAMED:
        return
    for number, edge in enumerate(edges, start=1):
        axes.axvline(1e3 * edge.position, color="tab:red", linewidth=0.8, linestyle="--")
        axes.annotate(
            str(number),
            (1e3 * edge.position, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0.0, 2.0),
            textcoords="offset points",
            ha="center",
            color="tab:red",
        )


def encode_figure_as_data_url(figure: "Figure") -> str:
    """Return a figure as the data URL of a PNG."""
    buffer = BytesIO()
    figure.savefig(buffer, format="png", dpi=_DOTS)
    return f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}"
