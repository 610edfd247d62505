"""Geometry of a stimulus for the interactive view of the page, loaded as a script so that it works from a folder."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from stepblocks.build.picture import Arrays


def write_view(
    path: Path,
    identity: str,
    meshes: Sequence[Arrays],
    exaggeration: float,
    half_width: float,
    centre: tuple[float, float, float],
) -> None:
    """Write the bodies in millimetres as a call of the page's function ``stepblocksView``."""
    bodies = []
    for vertices, triangles in meshes:
        columns = [[float(f"{value:.9g}") for value in column] for column in (vertices * 1e3).T]
        bodies.append(
            dict(zip("xyz", columns, strict=True))
            | dict(zip("ijk", (column.tolist() for column in triangles.T), strict=True))
        )
    data = {
        "id": identity,
        "unit": "mm",
        "exaggeration": exaggeration,
        "half_width": half_width * 1e3,
        "centre": [value * 1e3 for value in centre],
        "bodies": bodies,
    }
    path.write_text(f"stepblocksView({json.dumps(data, separators=(',', ':'), allow_nan=False)});\n", encoding="ascii")
