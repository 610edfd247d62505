"""Draw how far neighbouring stimuli are apart, in just noticeable differences."""

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from stepblocks.files.figures import make_figure_and_axes, save_figure
from stepblocks.predict.neighbours import Pair, get_pair_sort_key

_RED = "#b03030"
_SPREAD = 0.5  # of the conditions about the place of a pair, in distances of pairs
_LEGEND_ROWS = 12  # beyond which a legend takes two columns

Groups = dict[tuple[str, float], list[Pair]]


def write_neighbour_plots(set_name: str, pairs: Iterable[Pair], folder: Path) -> Iterator[Path]:
    """Draw the neighbours of a set, one picture for each direction and tip."""
    groups: Groups = {}
    for pair in pairs:
        condition = (pair.first.edge_direction, pair.first.point.ball_radius)
        groups.setdefault(condition, []).append(pair)
    for (drag, radius), group in groups.items():
        path = folder / f"{set_name}.neighbours.{drag}.R{radius * 1e6:g}.png"
        draw_neighbour_distances(group, path, f"{set_name}, {drag}, R {radius * 1e6:g} um")
        yield path


def draw_neighbour_distances(pairs: list[Pair], path: Path, title: str) -> None:
    """Draw distances with their intervals; a series of marks for each friction and load.

    Parameters
    ----------
    pairs : list of Pair
        Neighbours under one tip, at least one.
    path : Path
        Picture to write.
    title : str
        Above it.
    """
    places: dict[str, int] = {}
    series: dict[tuple[float, float], list[Pair]] = {}
    for pair in sorted(pairs, key=get_pair_sort_key):
        places.setdefault(_format_pair_name(pair), len(places))
        point = pair.first.point
        series.setdefault((point.friction, point.normal_load), []).append(pair)
    figure, axis = make_figure_and_axes(width=max(7.0, 0.9 * len(places)))
    shifts = np.linspace(-0.5, 0.5, len(series) + 2)[1:-1] * _SPREAD
    for shift, ((friction, load), members) in zip(shifts, series.items(), strict=True):
        x, jnds, below, above = [], [], [], []
        for pair in members:
            distance = pair.distance
            x.append(places[_format_pair_name(pair)] + shift)
            jnds.append(distance.jnd)
            below.append(distance.jnd - distance.low)
            above.append(distance.high - distance.jnd)
        axis.errorbar(
            x,
            jnds,
            yerr=[below, above],
            fmt="o",
            ms=4,
            lw=1,
            capsize=2,
            label=f"mu {friction:g}, {load:g} N",
        )
    axis.axhline(1.0, color=_RED, ls="--", lw=1, label="75 % tell them apart")
    axis.set_xticks(list(places.values()), list(places), rotation=30, ha="right")
    axis.set_ylabel("just noticeable differences")
    axis.set_title(title, fontsize=9)
    columns = 1 + len(series) // _LEGEND_ROWS
    figure.legend(loc="outside right upper", fontsize=7, ncols=columns)
    save_figure(figure, path)


def _format_pair_name(pair: Pair) -> str:
    """Name a pair of neighbours."""
    return f"{pair.first.edge_name} to {pair.second.edge_name}"
