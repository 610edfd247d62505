"""From a scan to measured characteristics: which evaluation answers for which part, and over how many profiles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import MetrologyError
from stepblocks.metrology.conformity import Decision, Outcome, decide
from stepblocks.metrology.edge import Edge, fit_edge
from stepblocks.metrology.flatness import flatness, parallelism
from stepblocks.metrology.margin_gap import fit_margin
from stepblocks.metrology.scan import HeightMap, Profile, rows_of
from stepblocks.metrology.tip_sphere import fit_sphere
from stepblocks.metrology.type_a1 import evaluate_a1
from stepblocks.metrology.uncertainty import Component, Instrument, Measured, measured_from_profiles

__all__ = [
    "MOST_PROFILES",
    "Inspected",
    "Shown",
    "judge",
    "measure_edge",
    "measure_groove",
    "measure_margin",
    "measure_tip",
    "verdict_of",
]

Array = NDArray[np.float64]
T = TypeVar("T")

MOST_PROFILES = 60
"""Profiles of a map that are evaluated; of more, as many are taken evenly over the map."""


@dataclass(frozen=True)
class Shown:
    """What a plot shows.

    Attributes
    ----------
    position, height : ndarray
        One profile, levelled on its lower or outer face [m].
    windows : tuple of (float, float, str)
        Begin, end [m] and name of the stretches that were evaluated.
    """

    position: Array
    height: Array
    windows: tuple[tuple[float, float, str], ...]


@dataclass(frozen=True)
class Inspected:
    """What a scan says.

    Attributes
    ----------
    values : dict of str to Measured
        By key of the characteristic.
    convention : str
        How the values are defined.
    notes : tuple of str
        What was left out or cut.
    shown : Shown
        For the plot.
    """

    values: dict[str, Measured]
    convention: str
    notes: tuple[str, ...]
    shown: Shown


def _sampled(scan: Profile | HeightMap) -> tuple[list[Profile], list[str]]:
    rows = rows_of(scan)
    if len(rows) <= MOST_PROFILES:
        return rows, []
    chosen = np.unique(np.linspace(0, len(rows) - 1, MOST_PROFILES).round().astype(int))
    return [rows[index] for index in chosen], [f"{len(chosen)} of {len(rows)} profiles evaluated"]


def _each(rows: list[Profile], evaluate: Callable[[Profile], T], notes: list[str]) -> list[tuple[Profile, T]]:
    """Evaluate profile by profile; refused ones are named, and all refused is an error."""
    results: list[tuple[Profile, T]] = []
    refused: list[str] = []
    for row in rows:
        try:
            results.append((row, evaluate(row)))
        except MetrologyError as error:
            refused.append(str(error))
    if not results:
        raise MetrologyError(f"no profile can be evaluated: {refused[0]}")
    if refused:
        notes.append(f"{len(refused)} of {len(rows)} profiles refused, the first since {refused[0]}")
    return results


def measure_edge(scan: Profile | HeightMap, instrument: Instrument, exclusion: float | None = None) -> Inspected:
    """Height and edge radius of a step; of a map also flatness and parallelism of the faces.

    Parameters
    ----------
    scan : Profile or HeightMap
        Scan across the working edge.
    instrument : Instrument
        Calibration and resolution.
    exclusion : float, optional
        Half width around the riser kept out of the faces [m]; see `stepblocks.metrology.edge.fit_edge`.

    Returns
    -------
    Inspected
        ``step_height``, ``edge_radius`` and for a map ``flatness_lower``, ``flatness_upper``, ``parallelism``.

    Raises
    ------
    MetrologyError
        If no profile can be evaluated.
    """
    rows, notes = _sampled(scan)
    results = _each(rows, lambda row: fit_edge(row.position, row.height, exclusion), notes)
    edges = [edge for _, edge in results]
    form = _form_of(results)
    values = {
        "step_height": measured_from_profiles(
            "step height", [e.height for e in edges], [e.height_std for e in edges], instrument, form
        ),
        "edge_radius": measured_from_profiles(
            "edge radius", [e.radius for e in edges], [e.radius_std for e in edges], instrument
        ),
    }
    first, edge = results[0]
    if isinstance(scan, HeightMap):
        values |= _faces(scan, edge, instrument)
    rejected = sum(one.rejected for one in edges)
    if rejected:
        notes.append(f"{rejected} points missing or left out as spikes")
    if any(e.radius < 2.0 * first.spacing for e in edges):
        limit = max(e.radius_limit for e in edges)
        notes.append(f"edge sharper than the sampling resolves; radius below {limit * 1e6:.2g} um at 95 %")
    convention = f"two planes with a common slope, {edge.exclusion * 1e6:.4g} um excluded on either side of the edge; radius by arc"
    return Inspected(values, convention, tuple(notes), _shown_edge(first, edge))


def _form_of(results: list[tuple[Profile, Edge]]) -> float:
    """Half the change of the mean height when twice as much is excluded, as a rectangle."""
    changes = []
    for row, edge in results[:: max(len(results) // 10, 1)]:
        try:
            wider = fit_edge(row.position, row.height, 2.0 * edge.exclusion)
        except MetrologyError:
            continue
        changes.append(wider.height - edge.height)
    return abs(float(np.mean(changes))) / np.sqrt(3.0) if changes else 0.0


def _shown_edge(profile: Profile, edge: Edge) -> Shown:
    x = profile.position
    low = (x < edge.position - edge.exclusion) if edge.rising else (x > edge.position + edge.exclusion)
    z = profile.height - edge.tilt * x
    z = z - np.nanmedian(z[low])
    left = (float(x[0]), edge.position - edge.exclusion, "face")
    right = (edge.position + edge.exclusion, float(x[-1]), "face")
    return Shown(x, z, (left, right))


def _faces(scan: HeightMap, edge: Edge, instrument: Instrument) -> dict[str, Measured]:
    x, y = np.meshgrid(scan.x, scan.y)
    low, high = x < edge.position - edge.exclusion, x > edge.position + edge.exclusion
    if not edge.rising:
        low, high = high, low
    clouds = [np.stack([x[side], y[side], scan.height[side]], axis=1) for side in (low, high)]
    planes = [flatness(cloud) for cloud in clouds]
    # extremes of n normal values: the zone of a perfect face grows by noise alone, stated as its uncertainty
    count = max(int(low.sum()), 2)
    spread = edge.roughness * 2.0 * np.sqrt(2.0 * np.log(count)) / np.sqrt(12.0)
    parts = (
        Component("noise", float(spread), how="extremes of the roughness, rectangular"),
        Component("resolution", instrument.resolution / np.sqrt(12.0), how="one count, rectangular"),
    )
    return {
        "flatness_lower": Measured("flatness, lower face", planes[0].zone, parts),
        "flatness_upper": Measured("flatness, upper face", planes[1].zone, parts),
        "parallelism": Measured("parallelism, upper face to A", parallelism(clouds[1], planes[0]), parts),
    }


def measure_groove(
    scan: Profile | HeightMap, instrument: Instrument, key: str = "groove_depth", exclude: bool = False
) -> Inspected:
    """Depth of a groove, or height of a ridge, by ISO 5436-1 type A1.

    Parameters
    ----------
    scan : Profile or HeightMap
        Scan across the whole feature and one width beyond.
    instrument : Instrument
        Calibration and resolution.
    key : str
        Key of the characteristic.
    exclude : bool
        Whether contaminated ends of windows are cut instead of refused.

    Returns
    -------
    Inspected
        The one value, positive for a ridge too.

    Raises
    ------
    MetrologyError
        If no profile can be evaluated.
    """
    rows, notes = _sampled(scan)
    policy: Literal["refuse", "exclude"] = "exclude" if exclude else "refuse"
    results = _each(rows, lambda row: evaluate_a1(row.position, row.height, contaminated=policy), notes)
    depths = [abs(one.depth) for _, one in results]
    value = measured_from_profiles(key.replace("_", " "), depths, [one.depth_std for _, one in results], instrument)
    excluded = sum(one.excluded for _, one in results)
    if excluded:
        notes.append(f"{excluded} points cut from the windows since a flank reached into them")
    first, best = results[0]
    windows = tuple((*span, name) for span, name in zip(best.windows, "ACB", strict=True))
    outer = (first.position >= best.windows[0][0]) & (first.position <= best.windows[0][1])
    z = first.height - best.tilt * first.position
    return Inspected(
        {key: value}, "ISO 5436-1 type A1, profile by profile, unfiltered", tuple(notes),
        Shown(first.position, z - np.nanmedian(z[outer]), windows),
    )  # fmt: skip


def measure_margin(scan: Profile | HeightMap, instrument: Instrument) -> Inspected:
    """Measure opening and rise of a margin, and the absolute discrepancy.

    Parameters
    ----------
    scan : Profile or HeightMap
        Scan across the margin, tooth on the left.
    instrument : Instrument
        Calibration and resolution.

    Returns
    -------
    Inspected
        ``vertical_discrepancy`` (opening along the path of draw), ``horizontal_discrepancy`` (rise of the crown) and
        ``absolute_discrepancy``.

    Raises
    ------
    MetrologyError
        If no profile can be evaluated.
    """
    rows, notes = _sampled(scan)
    results = _each(rows, lambda row: fit_margin(row.position, row.height), notes)
    ones = [one for _, one in results]
    sets = {
        "vertical_discrepancy": ([one.opening for one in ones], [one.opening_std for one in ones]),
        "horizontal_discrepancy": ([one.rise for one in ones], [one.rise_std for one in ones]),
        "absolute_discrepancy": ([one.absolute for one in ones], [one.absolute_std for one in ones]),
    }
    values = {
        key: measured_from_profiles(key.replace("_", " "), found, stds, instrument)
        for key, (found, stds) in sets.items()
    }
    first = results[0][0]
    return Inspected(
        values, "shoulders by two planes with a common slope; edges at half the depth of the gap", tuple(notes),
        Shown(first.position, first.height - np.nanmedian(first.height[: len(first.height) // 4]), ()),
    )  # fmt: skip


def measure_tip(scan: Profile | HeightMap, instrument: Instrument, nominal: float) -> Inspected:
    """Radius of a probe tip from a height map that looks at it along its axis.

    Parameters
    ----------
    scan : HeightMap
        The tip, pointing up.
    instrument : Instrument
        Calibration and resolution.
    nominal : float
        Nominal radius [m]; the cap within 0.7 of it around the apex is fitted.

    Returns
    -------
    Inspected
        ``ball_radius``.

    Raises
    ------
    MetrologyError
        If the scan is no map or shows no cap.
    """
    if not isinstance(scan, HeightMap):
        raise MetrologyError(f"a tip needs a height map, got a profile [{scan.source}]")
    x, y = np.meshgrid(scan.x, scan.y)
    top = scan.height > np.nanmax(scan.height) - 0.02 * nominal
    cap = np.hypot(x - x[top].mean(), y - y[top].mean()) < 0.7 * nominal
    sphere = fit_sphere(np.stack([x[cap], y[cap], scan.height[cap]], axis=1))
    parts = (
        Component("noise", sphere.radius_std, how="scatter about the sphere"),
        Component("form", sphere.form / np.sqrt(12.0) / max(np.sqrt(cap.sum()), 1.0), how="sphericity over the points"),
        Component("calibration", np.nan, how="not stated")
        if instrument.calibration_std is None
        else Component("calibration", instrument.calibration_std * sphere.radius, how="of the value"),
    )
    middle = scan.height[scan.height.shape[0] // 2]
    notes = (f"form of the ball {sphere.form * 1e6:.3g} um over a cap of {np.degrees(sphere.cap_angle):.3g} deg",)
    return Inspected(
        {"ball_radius": Measured("ball radius", sphere.radius, parts)}, "least-squares sphere through the cap", notes,
        Shown(scan.x, middle - np.nanmin(middle), ()),
    )  # fmt: skip


def verdict_of(decisions: list[Decision]) -> Outcome:
    """Return the verdict over all characteristics: one failure fails, one unproven leaves the whole unproven."""
    verdicts = {decision.verdict for decision in decisions}
    for verdict in (Outcome.DOES_NOT_CONFORM, Outcome.NOT_PROVEN):
        if verdict in verdicts:
            return verdict
    return Outcome.CONFORMS


def judge(measured: Measured, nominal: float, lower: float, upper: float) -> Decision:
    """Judge a value; a lower limit at or below zero of what cannot be negative is none.

    Parameters
    ----------
    measured : Measured
        Value with its budget.
    nominal, lower, upper : float
        Nominal and signed deviations [m].

    Returns
    -------
    Decision
        By ISO 14253-1.
    """
    low = nominal + lower
    return decide(measured.value, measured.std, low if low > 0.0 or nominal < 0.0 else -np.inf, nominal + upper)
