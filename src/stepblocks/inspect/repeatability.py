"""How well readings of a block repeat, and what their mean is uncertain by."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from stepblocks.files.tables import Table
from stepblocks.inspect.budget import Component, Measured, Source

# components of one scan, which the scatter of several shows together
_SCATTER = (Source.NOISE, Source.REPEATABILITY, Source.SCATTER)


class Repeatability(NamedTuple):
    """Scatter of readings of a block."""

    std: float  # of one reading [m or rad]
    dof: float  # degrees of freedom; 0 where no block has several readings


def estimate_repeatability(table: Table) -> Repeatability:
    """Return the standard deviation of a reading of a block and its degrees of freedom.

    Both are pooled over blocks.

    Columns of `table` are ``value``, ``block`` and conditions. Where readings were repeated under a
    condition, their mean is one reading: so what a day or an operator changes counts as well.
    """
    by_condition = [name for name in table.columns if name != "value"]
    means = table.groupby(by_condition, sort=False)["value"].mean().reset_index()
    # where each block has one condition alone, its single readings tell
    readings = means if means["block"].duplicated().any() else table
    within = readings["value"] - readings.groupby("block")["value"].transform("mean")
    dof = len(readings) - readings["block"].nunique()
    if not dof:
        return Repeatability(0.0, 0.0)
    return Repeatability(math.sqrt(float((within**2).sum()) / dof), float(dof))


def average_scans(
    scans: Sequence[Measured], mean_value: float, reading_count: int, repeatability: Repeatability
) -> Measured:
    """Return the mean over the scans of a block with its budget.

    The scatter over all scans takes the place of their own; what the instrument owes and the form
    of the surface do not average.

    Parameters
    ----------
    scans : sequence of Measured
        What each scan says.
    mean_value : float
        Of their values [m or rad].
    reading_count : int
        How many count: scans under one condition are one.
    repeatability : Repeatability
        Of one reading.

    Returns
    -------
    Measured
    """
    first = scans[0]
    if not repeatability.dof or len(scans) == 1:
        return first
    components = [
        Component(
            Source.REPEATABILITY,
            repeatability.std / math.sqrt(reading_count),
            repeatability.dof,
            f"scatter over all blocks, {reading_count} readings of this one",
        )
    ]
    for part in first.components:
        if part.name not in _SCATTER:  # all scans share what they have of it
            components.append(replace(part, std=_average_component_std(part.name, scans)))
    return replace(first, value=mean_value, components=tuple(components))


def _average_component_std(component_name: str, scans: Sequence[Measured]) -> float:
    """Return the mean standard uncertainty of a component over scans [m or rad]."""
    stds = []
    for measured in scans:
        stds += measured.list_component_stds(component_name)
    return sum(stds) / len(stds)
