"""A tooth with its crown as a surface of revolution, scanned badly: noise, holes, flipped
triangles, and debris beside it.
"""

from pathlib import Path

import numpy as np
import trimesh

RADIUS = 4e-3  # at the margin, z = 0 [m]
# curvature of the tooth, slope and curvature of the crown [1/m], [rad]
HOLLOW, FLARE, BULGE = (
    -60.0,
    np.radians(10.0),
    -150.0,
)
NOISE = 20e-6  # standard deviation of a point along its normal [m]
# picked points [mm]
MARGIN = [[4.0 * np.cos(a), 4.0 * np.sin(a), 0.0] for a in np.arange(8) * np.pi / 4.0]

SET = """
title = "A scan"
[prediction]
tip_radii = ["125 um"]
normal_loads = ["0.5 N"]
frictions = [0.15]
[[scanned_margin]]
id = "molar"
mesh = "tooth.{form}"
unit = "{unit}"
margin = {margin}
stations = {stations}
marginal_gap = "80 um"
{more}
"""


def outline(height):
    """Distance of the surface from the axis [m]; at the margin it meets the tooth."""
    tooth, crown = 0.5 * HOLLOW * height**2, np.tan(FLARE) * height + 0.5 * BULGE * height**2
    return RADIUS + np.where(height < 0.0, tooth, crown)


def scan(surface=outline, noise=NOISE, low=-2.5e-3, spacing=70e-6, seed=1):
    """Mesh in mm; without noise also without any other defect."""
    rng = np.random.default_rng(seed)
    heights, count = np.arange(low, 2.5e-3, spacing), round(2.0 * np.pi * RADIUS / spacing)
    angles = np.arange(count) * 2.0 * np.pi / count
    z, turn = np.meshgrid(heights, angles, indexing="ij")
    radius = surface(z) + noise * rng.standard_normal(z.shape)
    points = 1e3 * np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=-1).reshape(
        -1, 3
    )
    row, column = np.meshgrid(np.arange(len(heights) - 1), np.arange(count), indexing="ij")
    a, b = row * count + column, row * count + (column + 1) % count
    faces = np.concatenate(
        [
            np.stack([*one], -1).reshape(-1, 3)
            for one in ((a, b, b + count), (a, b + count, a + count))
        ]
    )
    if noise:
        middles = points[faces].mean(axis=1)
        for hole in middles[rng.integers(len(middles), size=6)]:
            kept = np.linalg.norm(middles - hole, axis=1) > 0.15
            faces, middles = faces[kept], middles[kept]
        flipped = rng.choice(len(faces), 300, replace=False)
        faces[flipped] = faces[flipped, ::-1]
        debris = len(points) + np.arange(3)
        points = np.vstack([points, [[4.6, 0.0, 0.1], [4.6, 0.1, 0.1], [4.6, 0.0, 0.2]]])
        faces = np.vstack([faces, debris])
    return trimesh.Trimesh(points, faces, process=False)


def scanned_set(
    folder, mesh=None, margin=MARGIN, stations=3, more="", unit="mm", form="stl"
) -> Path:
    """Write a set beside its mesh; picked points in mm."""
    folder.mkdir(parents=True, exist_ok=True)
    scale = {"mm": 1.0, "um": 1e3, "m": 1e-3}[unit]
    written = (mesh or scan()).copy()
    written.apply_scale(scale)
    written.export(folder / f"tooth.{form}")
    picked = [[scale * float(x) for x in point] for point in margin]
    path = folder / "scans.toml"
    path.write_text(SET.format(form=form, unit=unit, margin=picked, stations=stations, more=more))
    return path
