"""Perceptual tolerancing: which tolerances of height, edge and tip keep the vibration energy within a given share."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from stepblocks.contact.counterface import Step
from stepblocks.contact.domain import require_not_negative
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.uncertainty import inputs_of, moved_releases, sensitivities
from stepblocks.errors import ContactError

_DIMENSIONS = ("height", "edge_radius", "ball_radius")


@dataclass(frozen=True)
class TolerancePlan:
    """Tolerances that keep the energy of a block within a band, at every corner of the tolerance zone."""

    achievable: bool  # whether the workshop and the setting of the trial leave room for it
    reason: str  # one sentence: what limits it
    height: float  # half-width t of the tolerance +-t [m]; 0 where nothing will do
    edge_radius: float  # the same; for a nominally sharp edge the largest radius allowed
    ball_radius: float  # the same
    worst_low: float  # relative change of the energy at the worst corners [1]
    worst_high: float


def tolerances_for_energy(
    face: Step,
    point: OperatingPoint,
    energy_tolerance: float,
    *,
    finest: Mapping[str, float] | None = None,
    fixed: Mapping[str, float] | None = None,
    weights: Mapping[str, float] | None = None,
) -> TolerancePlan:
    """Find tolerances of height, edge radius and tip radius for a tolerance of the energy.

    Parameters
    ----------
    face, point : Step, OperatingPoint
        Nominal block, tip and trial; it must release.
    energy_tolerance : float
        Allowed relative change of E_v [1], such as 0.10 for +-10 %.
    finest : mapping, optional
        Smallest half-width that the workshop holds, by dimension [m].
    fixed : mapping, optional
        Half-widths that are given, of any input: those of friction and load spend the budget before the block does;
        a dimension given here is not toleranced.
    weights : mapping, optional
        Shares in which `height`, `edge_radius` and `ball_radius` split the budget; equal by default.

    Returns
    -------
    TolerancePlan
        The widest tolerances in those shares whose worst corner still keeps the band, or why none will do. Where a share
        is finer than the workshop holds, that dimension keeps to what it holds and the others give way.

    Raises
    ------
    ContactError
        If the nominal step does not release, the tolerance is not between 0 and 1, or a name is unknown.

    Examples
    --------
    >>> from stepblocks.contact.operating_point import PAPER
    >>> plan = tolerances_for_energy(Step(25e-6), PAPER, 0.10)
    >>> plan.achievable, 0.3e-6 < plan.height < 0.7e-6
    (True, True)
    >>> tolerances_for_energy(Step(25e-6), PAPER, 0.10, finest={"height": 3e-6}).achievable
    False
    """
    finest, fixed = dict(finest or {}), dict(fixed or {})
    weights = dict.fromkeys(_DIMENSIONS, 1.0) | dict(weights or {})
    _check(face, point, energy_tolerance, finest, fixed, weights)
    free = [name for name in _DIMENSIONS if name not in fixed and weights[name] > 0.0]
    at_finest: dict[str, float] = {}  # what cannot be made as fine as its share keeps to what can, the others give way
    while True:
        low, high = energy_at_corners(face, point, fixed | at_finest)
        if not free or high >= energy_tolerance or low <= -energy_tolerance:
            given = " and ".join(sorted(name for name, width in fixed.items() if width > 0.0))
            held = " and ".join(f"{name} to {width * 1e6:.3g} um" for name, width in at_finest.items())
            cause = f"the workshop holds {held}, which" if held else f"the given uncertainty of {given}"
            reason = f"{cause} alone changes the energy by {low:+.1%} to {high:+.1%}"
            return TolerancePlan(False, reason, 0.0, 0.0, 0.0, low, high)
        found = _in_shares(face, point, energy_tolerance, fixed | at_finest, {name: weights[name] for name in free})
        tight = [name for name in free if found[name] < finest.get(name, 0.0)]
        if not tight:
            break
        at_finest |= {name: finest[name] for name in tight}
        free = [name for name in free if name not in tight]
    found |= at_finest
    low, high = energy_at_corners(face, point, fixed | found)
    height, edge, ball = (found.get(name, fixed.get(name, 0.0)) for name in _DIMENSIONS)
    reason = "the worst corner of all tolerances just keeps the band"
    return TolerancePlan(True, reason, height, edge, ball, low, high)


def _in_shares(
    face: Step, point: OperatingPoint, energy_tolerance: float, fixed: dict[str, float], weights: dict[str, float]
) -> dict[str, float]:
    """Find the widest half-widths in the shares of `weights` whose worst corner keeps the energy."""
    from scipy.optimize import brentq

    slopes = sensitivities(face, point, weights)
    total = sum(weights.values())
    unit = {name: weight / total / abs(slopes[name][1]) for name, weight in weights.items()}

    def excess(scale: float) -> float:
        low, high = energy_at_corners(face, point, fixed | {name: scale * width for name, width in unit.items()})
        return min(max(high, -low), 1e6) - energy_tolerance

    # half the tolerance is inside by linearity; four times is outside, since the energy grows faster than linearly
    scale = float(brentq(excess, 0.0, 4.0 * energy_tolerance, xtol=1e-9 * energy_tolerance))
    return {name: scale * width for name, width in unit.items()}


def _check(
    face: Step,
    point: OperatingPoint,
    tolerance: float,
    finest: dict[str, float],
    fixed: dict[str, float],
    weights: dict[str, float],
) -> None:
    if not 0.0 < tolerance < 1.0:
        raise ContactError(f"energy_tolerance must lie between 0 and 1, got {tolerance:g}")
    for name, table in (("finest", finest), ("fixed", fixed), ("weights", weights)):
        known = _DIMENSIONS if name != "fixed" else tuple(inputs_of(face, point))
        for key, value in table.items():
            if key not in known:
                raise ContactError(f"{name} must name one of {', '.join(known)}, got {key!r}")
            require_not_negative(f"{name} of {key}", value)
    if not any(weights[name] > 0.0 for name in _DIMENSIONS if name not in fixed):
        raise ContactError("weights must leave at least one of height, edge_radius and ball_radius to be toleranced")
    status = face.release(point).status
    if status is not Status.RELEASES:
        raise ContactError(f"a step of {face.height:g} m that is {status} has no energy to keep")


def energy_at_corners(face: Step, point: OperatingPoint, widths: Mapping[str, float]) -> tuple[float, float]:
    """Relative change of the energy at the worst corners of a tolerance zone; infinite where the tip is held at one."""
    nominal = face.release(point).vibration_energy
    toleranced = {name: width for name, width in widths.items() if width > 0.0}
    inputs = inputs_of(face, point)
    if any(inputs[name] <= toleranced.get(name, 0.0) for name in ("ball_radius", "stiffness", "normal_load")):
        return -1.0, math.inf
    signs = np.array(list(product((-1.0, 1.0), repeat=len(toleranced)))).T
    deviations = {name: sign * width for sign, (name, width) in zip(signs, toleranced.items(), strict=True)}
    changes = moved_releases(face, point, deviations)[1] / nominal - 1.0
    return min(0.0, float(np.min(changes))), max(0.0, float(np.max(changes)))
