"""Heights and edge radii of the blocks of a session, from their scans."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from stepblocks.errors import StepblocksError
from stepblocks.files.layout import UNDECLARED, TableLayout
from stepblocks.files.text import is_file

# per block: height_m, height_std_m, and where known edge_radius_m, edge_radius_std_m
Scans = Mapping[str, Mapping[str, float]]


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


def scan_blocks(
    folder: Path, pattern: str | None, blocks: Sequence[str], layout: TableLayout = UNDECLARED
) -> ScannedBlocks:
    """Evaluate the scan of every block.

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
            found.scans[block] = _measure_scan(path, layout)
        except StepblocksError as error:
            found.unused[block] = str(error)
    return found


def _measure_scan(path: Path, layout: TableLayout) -> dict[str, float]:
    """Measure height and edge radius of a scan, with uncertainties; the mean over lines [m]."""
    from stepblocks.inspect.edge import fit_edge
    from stepblocks.scans.formats.text import TEXT_ENDINGS
    from stepblocks.scans.read import read_scan
    from stepblocks.scans.scan import list_profiles

    declared = UNDECLARED
    if path.suffix.lower() in TEXT_ENDINGS:
        declared = layout
    scan = read_scan(path, layout=declared)
    edges = [fit_edge(line.position, line.height) for line in list_profiles(scan)]
    heights = np.array([edge.height.value for edge in edges])
    height_stds = np.array([edge.height.std for edge in edges])
    radii = np.array([edge.radius.value for edge in edges])
    radius_stds = np.array([edge.radius.std for edge in edges])
    return {
        "height_m": float(np.mean(heights)),
        "height_std_m": float(np.sqrt(np.sum(height_stds**2)) / len(edges)),
        "edge_radius_m": float(np.mean(radii)),
        "edge_radius_std_m": float(np.sqrt(np.sum(radius_stds**2)) / len(edges)),
    }
