"""Make and save figures: no display, no time stamp, written beside their place and renamed."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from stepblocks.errors import PipelineError
from stepblocks.files.atomic import write_atomically
from stepblocks.mistakes import shorten_value
from stepblocks.quantities import format_units

if TYPE_CHECKING:
    import matplotlib.axes

Axes: TypeAlias = "matplotlib.axes.Axes"  # by its name: matplotlib is loaded when it draws


def make_figure_and_axes(
    rows: int = 1,
    columns: int = 1,
    *,
    sharex: bool = False,
    width: float = 7.0,
    height: float = 4.0,
) -> Any:
    """Make a figure and its axes without matplotlib's global state; sizes are in inches."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=130, layout="constrained")
    axes = figure.subplots(rows, columns, sharex=sharex)
    for axis in figure.axes:
        axis.grid(alpha=0.3, lw=0.5)
        axis.tick_params(labelsize=8)
    return figure, axes


def get_or_make_axes(ax: "Axes | None") -> "Axes":
    """Return the axes that were given, or new ones, which a notebook shows by itself."""
    if ax is None:
        from matplotlib import pyplot

        ax = pyplot.subplots()[1]
    if not hasattr(ax, "plot"):
        raise PipelineError(f"ax must be axes of matplotlib, got {shorten_value(ax)}")
    return ax


def save_figure(figure: Any, path: Path) -> None:
    """Write a figure as PNG or SVG, the same bytes for the same figure."""
    import matplotlib as mpl
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        text.set_text(format_units(text.get_text()))
    image_format = path.suffix.lstrip(".")
    # neither the version of the program nor the hour is written
    metadata: dict[str, None] = {"Date": None, "Creator": None}
    if image_format == "png":
        metadata = {"Software": None}
    with mpl.rc_context({"svg.hashsalt": "stepblocks"}), write_atomically(path) as draft:
        figure.savefig(draft, format=image_format, metadata=metadata)
