"""What the first trace of a session looks like: every column, to tell which is which."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stepblocks.errors import BenchError
from stepblocks.files.text_table import read_text_table
from stepblocks.window import texts
from stepblocks.window.scan_picture import encode_figure_as_data_url

_MOST_COLUMNS = 8  # that are drawn
_MOST_POINTS = 4000  # of a column that are drawn
_WIDTH, _HEIGHT = 8.0, 1.3  # of the picture, and of each column in it [inch]


@dataclass(frozen=True)
class TracePicture:
    """A trace as it was read.

    Attributes
    ----------
    columns : tuple of str
        Names of the columns with numbers.
    image : str
        Picture, as the address of a PNG that holds it.
    """

    columns: tuple[str, ...]
    image: str


def read_and_draw_trace(path: Path) -> TracePicture:
    """Read a trace in text and draw each of its columns over the rows.

    Raises
    ------
    BenchError
        If it is no table with names and numbers.
    """
    from matplotlib.figure import Figure

    table = read_text_table(path, raises=BenchError)
    columns = {}
    for number, name in enumerate(table.names):
        if table.holds_numbers(number):
            columns[name] = table.read_numbers(number).values
    if not columns:
        raise BenchError(texts.NO_COLUMNS.format(name=path.name))
    drawn = list(columns)[:_MOST_COLUMNS]
    figure = Figure(figsize=(_WIDTH, _HEIGHT * len(drawn)), layout="constrained")
    all_axes = np.atleast_1d(figure.subplots(len(drawn), 1, sharex=True))
    for axes, name in zip(all_axes, drawn, strict=True):
        step = -(-columns[name].size // _MOST_POINTS)
        rows = np.arange(columns[name].size)
        axes.plot(rows[::step], columns[name][::step], linewidth=0.8)
        axes.set_ylabel(name)
    all_axes[-1].set_xlabel(texts.AXIS_ROWS)
    return TracePicture(tuple(columns), encode_figure_as_data_url(figure))
