"""Whether vertices lie on the edges that end in them.

A face keeps its plane when a vertex is moved, so no dimension notices it; the edges do.
"""

import math

import numpy as np

from stepblocks.artefacts.step.exchange import Exchange, is_reference
from stepblocks.artefacts.step.faces import (
    CIRCLE,
    LINE,
    Surface,
    read_edge_curve,
    read_representation_units,
    read_vertex_point,
)
from stepblocks.artefacts.step.units import read_measure, read_unit
from stepblocks.contact import Array

_LEAST_ALLOWED = 1e-9  # distance of a vertex from its edge [m]
_MOST_FINDINGS = 5  # that are listed


def list_vertices_off_edges(file: Exchange) -> list[str]:
    """Find the vertices that do not lie on the straight or circular edges that end in them.

    Parameters
    ----------
    file : Exchange
        The file; what it states of the uncertainty of its lengths is allowed.

    Returns
    -------
    list of str
        One line for each, up to five, and how many more there are.
    """
    allowed = max(_LEAST_ALLOWED, _read_uncertainty(file))
    units = read_representation_units(file, _find_body_representation(file))
    points: dict[str, Array] = {}
    moved: dict[str, str] = {}
    for ref, parameters in file.yield_instances("EDGE_CURVE"):
        if len(parameters) != 5:
            continue
        curve = read_edge_curve(file, ref, units)
        if curve.kind not in (LINE, CIRCLE):
            continue
        for vertex in map(str, parameters[1:3]):
            if vertex not in points:  # most end several edges
                points[vertex] = read_vertex_point(file, vertex, units)
            distance = _measure_distance_from_curve(curve, points[vertex])
            if distance > allowed:
                moved[vertex] = (
                    f"{vertex} vertex: must lie on its edge {ref}, lies {distance * 1e9:.3f} nm off"
                )
    lines = list(moved.values())
    if len(lines) > _MOST_FINDINGS:
        unlisted = len(lines) - _MOST_FINDINGS
        lines = [*lines[:_MOST_FINDINGS], f"and {unlisted} vertices more that lie off their edges"]
    return lines


def _find_body_representation(file: Exchange) -> str:
    """Find the representation that holds the bodies, and with them the units of their points."""
    for ref, _ in file.yield_instances(
        "ADVANCED_BREP_SHAPE_REPRESENTATION", "MANIFOLD_SURFACE_SHAPE_REPRESENTATION"
    ):
        return ref
    return ""


def _read_uncertainty(file: Exchange) -> float:
    """Read the largest uncertainty of lengths that a file states [m], 0 where it states none."""
    largest = 0.0
    for ref, parameters in file.yield_instances("UNCERTAINTY_MEASURE_WITH_UNIT"):
        measure = read_measure(file, ref)
        if measure is not None:
            largest = max(largest, measure.si)
        elif len(parameters) > 1 and is_reference(parameters[1]):
            value = getattr(parameters[0], "value", None)
            unit = read_unit(file, parameters[1])
            if isinstance(value, int | float):
                largest = max(largest, unit.convert_to_si(float(value)))
    return largest if math.isfinite(largest) else 0.0


def _measure_distance_from_curve(curve: Surface, point: Array) -> float:
    """Measure the distance of a point from a line or a circle [m]; 0 where one is unknown."""
    offset = point - curve.point
    along = float(offset @ curve.axis)
    across = offset - along * curve.axis
    radius = float(np.linalg.norm(across))
    distance = radius
    if curve.kind == CIRCLE:
        distance = math.hypot(radius - curve.sizes[0], along)
    return distance if math.isfinite(distance) else 0.0
