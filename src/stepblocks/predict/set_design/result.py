"""What the design of a set finds, and its picture."""

import math
from dataclasses import dataclass
from pathlib import Path

from stepblocks.contact.operating_point import Tool
from stepblocks.declaration.set import StimulusSet
from stepblocks.files.figures import Axes, get_or_make_axes, make_figure_and_axes, save_figure
from stepblocks.predict.predictions import Model
from stepblocks.predict.set_design.allowances import EVEN, Allowance
from stepblocks.predict.set_design.neighbours import MERGED, Neighbours
from stepblocks.predict.set_design.reach import MissedTarget
from stepblocks.predict.set_design.targets import compute_threshold_energy

_BLUE = "#1f4e79"
_RED = "#b03030"
_NEAR = 0.1  # of what is shown, above which the threshold is shown, too [1]
MISSED = "targets that no block gives"  # title of their table
Row = dict[str, float | str]


@dataclass(frozen=True)
class DesignedBlock:
    """A block of a designed set.

    Attributes
    ----------
    id : str
        In the set.
    wanted : str
        What was asked for, such as ``"20 uJ"``.
    target_energy : float
        The same as an energy [J].
    exact_size : float
        Height of the step, or gap, that gives it [m].
    size : float
        The same, rounded to what is made [m].
    energy, level : float
        At that size [J], and over the detection threshold [dB].
    energy_low, energy_high : float
        Ends of the 95 % interval [J]; infinite where that share of blocks and settings locks.
    held : float
        Probability that a block made within tolerance locks [1].
    further_sizes : tuple of float
        Further sizes that give the same energy [m].
    """

    id: str
    wanted: str
    target_energy: float
    exact_size: float
    size: float
    energy: float
    level: float
    energy_low: float
    energy_high: float
    held: float
    further_sizes: tuple[float, ...]


@dataclass(frozen=True, repr=False)
class SetDesign:
    """A set designed by what is felt.

    Attributes
    ----------
    stimuli : StimulusSet
        The set; `StimulusSet.to_toml` writes it.
    blocks : tuple of DesignedBlock
        By rising energy.
    neighbours : tuple of Neighbours
        Each block beside the next.
    missed : tuple of MissedTarget
        Targets that no block gives, why, and what would.
    allowances : tuple of Allowance
        How far inputs may deviate before the set is no longer evenly spaced.
    model : Model
        Whose energies these are: of the formula, or of the drag where both differ.
    difference : float
        Just noticeable difference [dB].
    tool : Tool
        With which the set is felt.
    notes : tuple of str
        What else should be known.
    """

    stimuli: StimulusSet
    blocks: tuple[DesignedBlock, ...]
    neighbours: tuple[Neighbours, ...]
    missed: tuple[MissedTarget, ...]
    allowances: tuple[Allowance, ...]
    model: Model
    difference: float
    tool: Tool
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        return (
            f"SetDesign({self.stimuli.name!r}, {len(self.blocks)} blocks, "
            f"{len(self.missed)} targets missed)"
        )

    __str__ = __repr__

    def tabulate(self) -> dict[str, list[Row]]:
        """Put it into tables by their titles, the unit at the end of each column's name."""
        tables = {"blocks": [_make_block_row(block) for block in self.blocks]}
        if self.neighbours:
            tables["neighbours"] = [_make_neighbours_row(pair) for pair in self.neighbours]
            title = f"deviations that change no distance by more than {EVEN:g} JND"
            tables[title] = [_make_allowance_row(allowance) for allowance in self.allowances]
        if self.missed:
            tables[MISSED] = [_make_missed_target_row(miss) for miss in self.missed]
        return tables

    def plot(self, ax: "Axes | None" = None) -> Axes:
        """Draw targets and blocks on the axis of energies.

        Parameters
        ----------
        ax : matplotlib axes, optional
            Where to draw; new axes by default.

        Returns
        -------
        matplotlib axes
            With the picture.
        """
        axis = get_or_make_axes(ax)
        axis.set(xscale="log", xlabel=f"vibration energy, {self.model} [uJ]")
        _draw_blocks(axis, self.blocks)
        _draw_missed_targets(axis, self.missed, len(self.blocks))
        threshold = 1e6 * compute_threshold_energy(self.tool)
        if threshold > _NEAR * axis.get_xlim()[0]:
            axis.axvline(threshold, color=_RED, ls="--", lw=1, label="detection threshold")
        axis.set_yticks(range(len(self.blocks) + len(self.missed)), _list_row_labels(self))
        axis.invert_yaxis()
        axis.legend(fontsize=8)
        return axis

    def draw(self, path: str | Path) -> None:
        """Write the picture of `plot` as PNG or SVG."""
        height = 1.6 + 0.3 * (len(self.blocks) + len(self.missed))
        figure, axis = make_figure_and_axes(height=max(height, 3.0))
        self.plot(axis)
        save_figure(figure, Path(path))


def _make_block_row(block: DesignedBlock) -> Row:
    """Put a block into a row."""
    further = ", ".join(f"{size * 1e6:.4g}" for size in block.further_sizes)
    row: Row = {
        "block": block.id,
        "wanted": block.wanted,
        "exact_size_um": 1e6 * block.exact_size,
        "size_um": 1e6 * block.size,
        "energy_uj": 1e6 * block.energy,
        "energy_95_low_uj": 1e6 * block.energy_low,
        "energy_95_high_uj": 1e6 * block.energy_high,
        "level_db": block.level,
        "locks_probability": block.held,
        "target_uj": 1e6 * block.target_energy,
    }
    if further:
        row["also_at_um"] = further
    return row


def _make_neighbours_row(pair: Neighbours) -> Row:
    """Put two neighbours into a row."""
    return {
        "weaker": pair.first,
        "stronger": pair.second,
        "distance_jnd": pair.distance,
        "distance_95_low_jnd": pair.low,
        "distance_95_high_jnd": pair.high,
        "reversed_probability": pair.reversal,
        f"closer_than_{MERGED:g}_jnd_probability".replace("0.", "0p"): pair.merging,
    }


_UNITS = {"friction": ("", 1.0), "normal_load": ("N", 1.0)}


def _make_allowance_row(allowance: Allowance) -> Row:
    """Put an allowance into a row, with its unit beside it."""
    unit, factor = _UNITS.get(allowance.name, ("um", 1e6))
    down = _format_deviation(factor * allowance.down)
    up = _format_deviation(factor * allowance.up)
    return {"input": allowance.name.replace("_", " "), "down": down, "up": up, "unit": unit}


def _format_deviation(deviation: float) -> str:
    """Format a deviation with three digits; "any" where it is infinite."""
    if math.isinf(deviation):
        return "any"
    return f"{deviation:.3g}"


def _make_missed_target_row(miss: MissedTarget) -> Row:
    """Put a target that no block gives into a row."""
    return {
        "target": miss.target.wanted,
        "why": miss.obstacle.value,
        "detail": miss.detail,
        "what_would": miss.remedy or "no load and no tip",
    }


def _list_row_labels(design: SetDesign) -> list[str]:
    """Name the rows of the picture: blocks, then targets that are missed."""
    labels = [block.id for block in design.blocks]
    for miss in design.missed:
        labels.append(f"{miss.target.wanted}: {miss.obstacle}")
    return labels


def _draw_blocks(axis: Axes, blocks: tuple[DesignedBlock, ...]) -> None:
    """Draw the blocks of a set with their intervals beside their targets."""
    rows = range(len(blocks))
    energies = [1e6 * block.energy for block in blocks]
    top = 10.0 * max(energies)
    lows = [1e6 * block.energy_low for block in blocks]
    highs = [min(1e6 * block.energy_high, top) for block in blocks]
    axis.hlines(rows, lows, highs, color=_BLUE, alpha=0.4, lw=5, label="95 % interval")
    axis.plot(energies, rows, "|", ms=12, mew=2, color=_BLUE, label="block")
    targets = [1e6 * block.target_energy for block in blocks]
    axis.plot(targets, rows, "o", ms=5, mfc="none", color="k", label="target")


def _draw_missed_targets(axis: Axes, missed: tuple[MissedTarget, ...], first_row: int) -> None:
    """Draw the targets that no block gives, below the blocks."""
    if not missed:
        return
    rows = range(first_row, first_row + len(missed))
    energies = [1e6 * miss.target.energy for miss in missed]
    axis.plot(energies, rows, "x", ms=7, color=_RED, label="target that no block gives")
