"""Angle and straightness of a riser that slopes, where the stylus does not show it so."""

import math
from dataclasses import dataclass, field

import numpy as np

from stepblocks.inspect.budget import (
    UNSTATED_SCALE,
    Component,
    Instrument,
    Measured,
    Source,
    make_measured_with_instrument,
)
from stepblocks.inspect.edge_flank import is_flank_of_surface
from stepblocks.inspect.notes import Note, NoteKind, NotMeasuredReason
from stepblocks.inspect.working_edge.crossing import CrossedEdges

ANGLE, STRAIGHTNESS = "riser_angle", "riser_straightness"


@dataclass(frozen=True)
class Riser:
    """What a scan says of the riser of an edge."""

    values: dict[str, Measured] = field(default_factory=dict)  # by key
    missing: dict[str, str] = field(default_factory=dict)  # reasons by key


def measure_riser(
    crossed: CrossedEdges, instrument: Instrument, stylus_cone: float | None, notes: list[Note]
) -> Riser:
    """Measure angle and straightness of the riser of an edge.

    Parameters
    ----------
    crossed : CrossedEdges
    instrument : Instrument
    stylus_cone : float or None
        Full angle of the stylus [rad], 0 of an optical instrument; None where it is not stated.
    notes : list of Note
        Takes what is said of the flank.

    Returns
    -------
    Riser
        Without values where the riser is upright, or the stylus may show it so.
    """
    if not crossed.shows_mostly_flanks:
        return _make_unmeasured_riser(NotMeasuredReason.UPRIGHT_RISER.format_message())
    flanks = crossed.all_flanks
    angles = [flank.angle for flank in flanks]
    angle = float(np.mean(angles))
    std = float(np.mean([flank.angle_std for flank in flanks]))
    slope = f"{math.degrees(angle):.1f} +-{math.degrees(2.0 * std):.1f} deg"
    if not is_flank_of_surface(angle, std, stylus_cone):
        cone = "cone of the stylus"
        if stylus_cone is None:
            cone += ", which is not stated,"
        notes.append(NoteKind.NO_ARC_OR_STEEPER.make_note(slope=slope, cone=cone))
        return _make_unmeasured_riser(
            NotMeasuredReason.STYLUS_CONE.format_message(cone=cone, slope=slope)
        )
    notes.append(NoteKind.NO_ARC.make_note(slope=slope))
    scatter = np.std(angles)
    values = {
        ANGLE: _make_riser_angle_with_budget(angle, math.hypot(std, scatter), instrument),
        STRAIGHTNESS: _average_riser_straightness(crossed, angle, instrument),
    }
    return Riser(values=values)


def _make_unmeasured_riser(reason: str) -> Riser:
    """Return why neither of both was measured."""
    return Riser(missing=dict.fromkeys((ANGLE, STRAIGHTNESS), reason))


def _make_riser_angle_with_budget(
    angle: float, noise_std: float, instrument: Instrument
) -> Measured:
    """Add its budget to the angle of a riser [rad]."""
    vertical = instrument.calibration_std
    if vertical is None:
        vertical = UNSTATED_SCALE
    lateral = instrument.lateral_std
    if lateral is None:
        lateral = UNSTATED_SCALE
    scales = math.hypot(vertical, lateral)
    calibration = 0.5 * math.sin(2.0 * angle) * scales
    components = (
        Component(Source.NOISE, noise_std, how="covariance of the fit of the flank"),
        Component(Source.CALIBRATION, calibration, how="of both scales"),
    )
    return Measured("angle of the riser", angle, components)


def _average_riser_straightness(
    crossed: CrossedEdges, riser_angle: float, instrument: Instrument
) -> Measured:
    """Average the straightness of a riser of an angle [rad] over the profiles that show it."""
    values, stds = [], []
    for crossing in crossed.crossings:
        if crossing.edge.flank is not None:
            row = crossing.row
            zone = crossing.edge.estimate_riser_form(row.position, row.height, riser_angle)
            values.append(zone.value)
            stds.append(zone.std)
    noise = Component(
        Source.NOISE,
        # neighbouring profiles may err together: their scatter is not divided
        math.hypot(np.mean(stds), np.std(values)),
        how="covariance of the form, and scatter over the profiles",
    )
    name = "straightness of the riser"
    return make_measured_with_instrument(name, float(np.mean(values)), [noise], instrument)
