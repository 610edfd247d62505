"""Where a ball rests on a height map: on a sample, on the line between two, or on the triangle of three.

The map is the triangulated surface of its samples; the rest of the ball is the upper envelope of its offset features. Which
samples matter at a place is known beforehand from the dilation of the map: those that the ball touches over the four
nodes around it. One query therefore takes the same short time anywhere, and slopes come from the contact itself. In a
hollow almost as round as the ball the contact runs ahead of the nodes, and the rest is found up to 3 nm too low (2 um grid).
"""

from __future__ import annotations

import math
from typing import Any

import numba

CONTACT = 4  # Contacts that are kept at a place: more than three share a load in no lasting way
_SAME = 1e-12  # heights closer than this touch at once [m], times the magnification
_PARALLEL = 1.0 - 1e-10  # cosine between normals that count as one


@numba.njit(cache=True)  # type: ignore[untyped-decorator, unused-ignore]
def _offer(height: Any, nx: Any, ny: Any, nz: Any, found: Any, count: Any, same: Any) -> Any:
    """Keep a touching feature if it is the highest, or as high as the highest with another normal."""
    if count > 0 and height < found[0, 3] - same:
        return count
    if count == 0 or height > found[0, 3] + same:
        count = 0
    for i in range(count):
        if nx * found[i, 0] + ny * found[i, 1] + nz * found[i, 2] > _PARALLEL:
            found[i, 3] = max(found[i, 3], height)
            return count
    if count < CONTACT:
        found[count, 0], found[count, 1], found[count, 2], found[count, 3] = nx, ny, nz, height
        count += 1
    return count


@numba.njit(cache=True)  # type: ignore[untyped-decorator, unused-ignore]
def _edge(ax: Any, ay: Any, az: Any, bx: Any, by: Any, bz: Any, R: Any, found: Any, count: Any, same: Any) -> Any:
    """Rest on the line from a sample at `a` by `b`, both relative to the place; its ends are left to the samples."""
    length = math.sqrt(bx * bx + by * by)
    along = (ax * bx + ay * by) / length
    reach = R * R - (ax * ax + ay * ay - along * along)
    if reach <= 0.0:
        return count
    slope = bz / length
    u = math.sqrt(reach) * slope / math.sqrt(1.0 + slope * slope)
    t = (u - along) / length
    if not 0.0 < t < 1.0:
        return count
    rise = math.sqrt(reach - u * u)
    return _offer(az + t * bz + rise, -(ax + t * bx) / R, -(ay + t * by) / R, rise / R, found, count, same)


@numba.njit(cache=True)  # type: ignore[untyped-decorator, unused-ignore]
def _face(
    ax: Any,
    ay: Any,
    az: Any,
    bx: Any,
    by: Any,
    bz: Any,
    cx: Any,
    cy: Any,
    cz: Any,
    R: Any,
    found: Any,
    count: Any,
    same: Any,
) -> Any:
    """Rest on the triangle with corners `a`, `a + b`, `a + c`, if the contact lies within it."""
    nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    size = math.copysign(math.sqrt(nx * nx + ny * ny + nz * nz), nz)
    nx, ny, nz = nx / size, ny / size, nz / size
    px, py, det = -R * nx - ax, -R * ny - ay, bx * cy - by * cx
    s, t = (px * cy - py * cx) / det, (bx * py - by * px) / det
    if s < -1e-9 or t < -1e-9 or s + t > 1.0 + 1e-9:
        return count
    return _offer(az + s * bz + t * cz + R * nz, nx, ny, nz, found, count, same)


@numba.njit(cache=True)  # type: ignore[untyped-decorator, unused-ignore]
def _around(row: Any, column: Any, x: Any, y: Any, z: Any, grid: Any, R: Any, found: Any, count: Any) -> Any:
    """Offer a sample, its six lines and its six triangles; the diagonal of a cell runs from its low to its high corner."""
    dx, dy, same = grid[2], grid[3], _SAME * grid[4]
    rows, columns = z.shape
    ax, ay, az = grid[0] + column * dx - x, grid[1] + row * dy - y, z[row, column]
    across = R * R - ax * ax - ay * ay
    if across > 0.0:
        rise = math.sqrt(across)
        count = _offer(az + rise, -ax / R, -ay / R, rise / R, found, count, same)
    e, w, n, s = column + 1 < columns, column > 0, row + 1 < rows, row > 0
    ze = z[row, column + 1] - az if e else math.nan
    zw = z[row, column - 1] - az if w else math.nan
    zn = z[row + 1, column] - az if n else math.nan
    zs = z[row - 1, column] - az if s else math.nan
    zne = z[row + 1, column + 1] - az if n and e else math.nan
    zsw = z[row - 1, column - 1] - az if s and w else math.nan
    if ze == ze:
        count = _edge(ax, ay, az, dx, 0.0, ze, R, found, count, same)
    if zw == zw:
        count = _edge(ax, ay, az, -dx, 0.0, zw, R, found, count, same)
    if zn == zn:
        count = _edge(ax, ay, az, 0.0, dy, zn, R, found, count, same)
    if zs == zs:
        count = _edge(ax, ay, az, 0.0, -dy, zs, R, found, count, same)
    if zne == zne:
        count = _edge(ax, ay, az, dx, dy, zne, R, found, count, same)
        if ze == ze:
            count = _face(ax, ay, az, dx, 0.0, ze, dx, dy, zne, R, found, count, same)
        if zn == zn:
            count = _face(ax, ay, az, dx, dy, zne, 0.0, dy, zn, R, found, count, same)
    if zsw == zsw:
        count = _edge(ax, ay, az, -dx, -dy, zsw, R, found, count, same)
        if zw == zw:
            count = _face(ax, ay, az, -dx, 0.0, zw, -dx, -dy, zsw, R, found, count, same)
        if zs == zs:
            count = _face(ax, ay, az, -dx, -dy, zsw, 0.0, -dy, zs, R, found, count, same)
    if zn == zn and zw == zw:
        count = _face(ax, ay, az, 0.0, dy, zn, -dx, 0.0, zw, R, found, count, same)
    if zs == zs and ze == ze:
        count = _face(ax, ay, az, 0.0, -dy, zs, dx, 0.0, ze, R, found, count, same)
    return count


@numba.njit(cache=True)  # type: ignore[untyped-decorator, unused-ignore]
def locate(x: Any, y: Any, z: Any, touched: Any, grid: Any, R: Any, found: Any) -> Any:
    """Find the contacts of the ball whose centre is over (x, y)."""
    rows, columns = z.shape
    x = min(max(x, grid[0]), grid[0] + (columns - 1) * grid[2])  # beyond its border a map goes on as it ends
    y = min(max(y, grid[1]), grid[1] + (rows - 1) * grid[3])
    column = min(max(int((x - grid[0]) / grid[2]), 0), columns - 2)
    row = min(max(int((y - grid[1]) / grid[3]), 0), rows - 2)
    count = 0
    a, b = touched[row, column], touched[row, column + 1]
    c, d = touched[row + 1, column], touched[row + 1, column + 1]
    if a >= 0:
        count = _around(a // columns, a % columns, x, y, z, grid, R, found, count)
    if b >= 0 and b != a:
        count = _around(b // columns, b % columns, x, y, z, grid, R, found, count)
    if c >= 0 and c != a and c != b:
        count = _around(c // columns, c % columns, x, y, z, grid, R, found, count)
    if d >= 0 and d != a and d != b and d != c:
        count = _around(d // columns, d % columns, x, y, z, grid, R, found, count)
    return count
