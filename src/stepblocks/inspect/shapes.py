"""Margins and tips measured: the gap and discrepancies of a crown margin, the radius of a probe tip."""

from __future__ import annotations

import numpy as np

from stepblocks.artefacts.scans.scan import HeightMap, Profile
from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import Component, Instrument, measured_from_profiles
from stepblocks.inspect.evaluate.margin_gap import fit_margin
from stepblocks.inspect.evaluate.tip_cap import fit_cap
from stepblocks.inspect.inspection import Inspected, Shown, evaluated, sampled


def measure_margin(scan: Profile | HeightMap, instrument: Instrument) -> Inspected:
    """Measure opening and rise of a margin, and the absolute discrepancy."""
    rows, notes = sampled(scan)
    results = evaluated(rows, lambda row: fit_margin(row.position, row.height), notes)
    ones = [one for _, one in results]
    share = float(np.mean([one.opening / one.absolute for one in ones]))
    sampling = float(np.mean([one.opening_sampling for one in ones]))
    how = "one interval at either edge, rectangular; the same in every profile"
    values = {
        "vertical_discrepancy": measured_from_profiles(
            "vertical discrepancy",
            [one.opening for one in ones],
            [one.opening_noise for one in ones],
            instrument,
            [Component("sampling", sampling, how=how)],
            axes=(0.0, 1.0),
        ),
        "horizontal_discrepancy": measured_from_profiles(
            "horizontal discrepancy", [one.rise for one in ones], [one.rise_noise for one in ones], instrument
        ),
        "absolute_discrepancy": measured_from_profiles(
            "absolute discrepancy",
            [one.absolute for one in ones],
            [one.absolute_noise for one in ones],
            instrument,
            [Component("sampling", sampling * share, how=how)],
            axes=(1.0 - share**2, share**2),
        ),
    }
    first = results[0][0]
    return Inspected(
        values,
        "shoulders by two planes with a common slope; edges at half the depth of the gap",
        tuple(notes),
        Shown(first.position, first.height - np.nanmedian(first.height[: len(first.height) // 4]), ()),
    )


def measure_tip(scan: Profile | HeightMap, instrument: Instrument, nominal: float) -> Inspected:
    """Radius of a probe tip from a height map that looks at it along its axis."""
    if not isinstance(scan, HeightMap):
        raise MetrologyError(f"a tip needs a height map, got a profile [{scan.source}]")
    cap = fit_cap(scan, nominal)
    # of a cap, height h over width a, R is a^2 / 2h: twice the lateral error, once the vertical
    value = measured_from_profiles("ball radius", [cap.radius], [cap.noise], instrument, axes=(1.0, 2.0))
    middle = scan.height[scan.height.shape[0] // 2]
    notes = [
        f"form of the ball {cap.form * 1e6:.3g} um, noise included, over a cap of {np.degrees(cap.cap_angle):.3g} deg"
    ]
    if cap.rejected:
        notes.append(f"{cap.rejected} points left out as spikes")
    return Inspected(
        {"ball_radius": value},
        "least-squares sphere through the cap, in heights",
        tuple(notes),
        Shown(scan.x, middle - np.nanmin(middle), ()),
    )
