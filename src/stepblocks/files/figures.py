"""Make and save figures: no display, no time stamp, written beside their place and renamed."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from stepblocks.errors import PipelineError
from stepblocks.files.atomic import write_atomically
from stepblocks.mistakes import shorten_value
from stepblocks.quantities import format_units

if TYPE_CHECKING:
    import matplotlib.axes

Axes: TypeAlias = "matplotlib.axes.Axes"  # by its name: matplotlib is loaded when it draws


def make_figure(
    rows: int = 1,
    columns: int = 1,
    *,
    sharex: bool = False,
    width: float = 7.0,
    height: float = 4.0,
    heights: Sequence[float] | None = None,
) -> Any:
    """Make a figure and its axes without matplotlib's global state.

    Sizes are in inches, `heights` in parts of the height.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=130, layout="constrained")
    axes = figure.subplots(rows, columns, sharex=sharex, height_ratios=heights)
    for axis in figure.axes:
        axis.grid(alpha=0.3, lw=0.5)
        axis.tick_params(labelsize=8)
    return figure, axes


def take_axes(ax: "Axes | None") -> "Axes":
    """Return the axes that were given, or new ones, which a notebook shows by itself."""
    if ax is None:
        from matplotlib import pyplot

        ax = pyplot.subplots()[1]
    PipelineError.require(
        hasattr(ax, "plot"), f"ax must be axes of matplotlib, got {shorten_value(ax)}"
    )
    return ax


def save_figure(figure: Any, path: Path) -> None:
    """Write a figure as PNG or SVG, the same bytes for the same figure."""
    import matplotlib as mpl
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        text.set_text(format_units(text.get_text()))
    kind = path.suffix.lstrip(".")
    with mpl.rc_context({"svg.hashsalt": "stepblocks"}), write_atomically(path) as draft:
        figure.savefig(
            draft,
            format=kind,
            metadata={"Software": None} if kind == "png" else {"Date": None, "Creator": None},
        )
