"""Heights and edge radii of the blocks of a session, from their scans."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from stepblocks.errors import StepblocksError
from stepblocks.files.layout import UNDECLARED, TableLayout
from stepblocks.files.text import is_file

if TYPE_CHECKING:
    from stepblocks.inspect.noise import Estimate

# per block: height_m, height_std_m, and where known edge_radius_m, edge_radius_std_m
ScanFiguresByBlock = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True)
class ScannedBlocks:
    """What the scans of the blocks showed.

    Attributes
    ----------
    scans : dict[str, dict[str, float]]
        Per block height and edge radius with their standard uncertainties [m].
    unused : dict[str, str]
        Blocks whose scans could not be used, and why.
    """

    scans: dict[str, dict[str, float]] = field(default_factory=dict)
    unused: dict[str, str] = field(default_factory=dict)


def measure_block_scans(
    folder: Path, pattern: str | None, blocks: Sequence[str], layout: TableLayout = UNDECLARED
) -> ScannedBlocks:
    """Measure the scan of every block.

    Parameters
    ----------
    folder : Path
        Of the session.
    pattern : str or None
        Path of a scan in the folder, with ``{block}`` for the name of the block; None where the
        session has no scans.
    blocks : sequence of str
    layout : TableLayout
        What is declared of scans in text.
    """
    found = ScannedBlocks()
    if not pattern:
        return found
    for block in blocks:
        path = folder / pattern.replace("{block}", block)
        if not is_file(path):
            found.unused[block] = f"no file {path.relative_to(folder)}"
            continue
        if folder.resolve() not in path.resolve().parents:
            found.unused[block] = f"{path.relative_to(folder)} leads out of the session"
            continue
        try:
            found.scans[block] = _measure_height_and_edge_radius(path, layout)
        except StepblocksError as error:
            found.unused[block] = str(error)
    return found


def _measure_height_and_edge_radius(path: Path, layout: TableLayout) -> dict[str, float]:
    """Measure height and edge radius of a scan, with uncertainties; the mean over lines [m]."""
    from stepblocks.inspect.edge import fit_edge
    from stepblocks.scans.formats.text import TEXT_ENDINGS
    from stepblocks.scans.read import read_scan
    from stepblocks.scans.scan import split_into_profiles

    declared = UNDECLARED
    if path.suffix.lower() in TEXT_ENDINGS:
        declared = layout
    scan = read_scan(path, layout=declared)
    heights, radii = [], []
    for line in split_into_profiles(scan):
        edge = fit_edge(line.position, line.height)
        heights.append(edge.height)
        radii.append(edge.radius)
    height, height_std = _average_independent_estimates(heights)
    radius, radius_std = _average_independent_estimates(radii)
    return {
        "height_m": height,
        "height_std_m": height_std,
        "edge_radius_m": radius,
        "edge_radius_std_m": radius_std,
    }


def _average_independent_estimates(estimates: Sequence["Estimate"]) -> tuple[float, float]:
    """Average independent estimates; the result is the mean and its standard uncertainty."""
    values = np.array([estimate.value for estimate in estimates])
    stds = np.array([estimate.std for estimate in estimates])
    return float(np.mean(values)), float(np.sqrt(np.sum(stds**2)) / len(estimates))
