"""What a scan looks like, and how far it reaches: a picture beside what the file leaves open."""

import base64
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np

from stepblocks.quantities import format_quantity
from stepblocks.scans.read import read_scan
from stepblocks.scans.scan import HeightMap, ScannedProfile
from stepblocks.window import texts

_MOST_POINTS = 4000  # of a profile that are drawn
_MOST_CELLS = 600  # of a map along a side that are drawn
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
    """

    description: str
    scale: str
    image: str


def draw_scan(path: Path, unit: str | None, channel: str | None) -> ScanPicture:
    """Read a scan and draw it.

    Raises
    ------
    MetrologyError
        If it cannot be read: the message asks for what the file leaves open.
    """
    scan = read_scan(path, unit, channel)
    height = scan.height[np.isfinite(scan.height)]
    low = format_quantity(float(height.min()), "length")
    high = format_quantity(float(height.max()), "length")
    if isinstance(scan, ScannedProfile):
        length = format_quantity(float(scan.position[-1] - scan.position[0]), "length")
        text = texts.PROFILE_READ.format(
            points=scan.position.size, length=length, low=low, high=high
        )
        return ScanPicture(text, scan.scale, _draw_profile(scan))
    rows, columns = scan.height.shape
    text = texts.MAP_READ.format(
        rows=rows,
        columns=columns,
        length=format_quantity(scan.dx * columns, "length"),
        width=format_quantity(scan.dy * rows, "length"),
        low=low,
        high=high,
    )
    return ScanPicture(text, scan.scale, _draw_map(scan))


def _draw_profile(scan: ScannedProfile) -> str:
    """Draw heights along the line."""
    from matplotlib.figure import Figure

    step = -(-scan.position.size // _MOST_POINTS)
    figure = Figure(figsize=_SIZE, layout="constrained")
    axes = figure.subplots()
    axes.plot(1e3 * scan.position[::step], 1e6 * scan.height[::step], linewidth=1.0)
    axes.set_xlabel(texts.AXIS_ALONG)
    axes.set_ylabel(texts.AXIS_HEIGHT)
    return _encode(figure)


def _draw_map(scan: HeightMap) -> str:
    """Draw heights as colours, true in plan."""
    from matplotlib.figure import Figure

    rows, columns = scan.height.shape
    step = -(-max(rows, columns) // _MOST_CELLS)
    figure = Figure(figsize=_SIZE, layout="constrained")
    axes = figure.subplots()
    image = axes.imshow(
        1e6 * scan.height[::step, ::step],
        extent=(0.0, 1e3 * scan.dx * columns, 0.0, 1e3 * scan.dy * rows),
        origin="lower",
    )
    axes.set_xlabel(texts.AXIS_ALONG)
    axes.set_ylabel(texts.AXIS_ACROSS)
    figure.colorbar(image, label=texts.AXIS_HEIGHT)
    return _encode(figure)


def _encode(figure: object) -> str:
    """Return a figure as an address that holds it."""
    from matplotlib.figure import Figure

    assert isinstance(figure, Figure)
    buffer = BytesIO()
    figure.savefig(buffer, format="png", dpi=_DOTS)
    return f"data:image/png;base64,{base64.b64encode(buffer.getvalue()).decode()}"
