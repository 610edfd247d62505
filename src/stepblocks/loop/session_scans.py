"""Scans of a session's blocks: heights and edge radii beside what the forces say."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from stepblocks.errors import StepblocksError

# A scan in; ``height_m``, ``height_std_m``, ``edge_radius_m``, ``edge_radius_std_m`` out
Evaluate = Callable[[Path], dict[str, float]]


def scan_blocks(
    folder: Path, pattern: str | None, blocks: Sequence[str], evaluate: Evaluate
) -> tuple[dict[str, dict[str, float]], dict[str, str]]:
    """Evaluate the scan of every block that has one."""
    found: dict[str, dict[str, float]] = {}
    failed: dict[str, str] = {}
    for block in blocks if pattern else ():
        path = folder / str(pattern).replace("{block}", block)
        if not path.is_file():
            failed[block] = f"no file {path.relative_to(folder)}"
            continue
        if folder.resolve() not in path.resolve().parents:
            failed[block] = f"{path.relative_to(folder)} leads out of the session"
            continue
        try:
            found[block] = evaluate(path)
        except StepblocksError as error:
            failed[block] = str(error)
    return found, failed


def edge_of_scan(path: Path) -> dict[str, float]:
    """Height and edge radius of the scan of a block; the mean over the lines of a map [m]."""
    import numpy as np

    from stepblocks.artefacts.scans.read import read_scan
    from stepblocks.artefacts.scans.scan import rows_of
    from stepblocks.inspect.evaluate.edge import fit_edge

    edges = [fit_edge(line.position, line.height) for line in rows_of(read_scan(path))]
    count = len(edges)
    return {
        "height_m": float(np.mean([e.height for e in edges])),
        "height_std_m": float(np.sqrt(np.sum([e.height_std**2 for e in edges])) / count),
        "edge_radius_m": float(np.mean([e.radius for e in edges])),
        "edge_radius_std_m": float(np.sqrt(np.sum([e.radius_std**2 for e in edges])) / count),
    }
