"""The events of a drag as a table: every place that caught the tip, and what it let go."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

from stepblocks.contact.counterface import Counterface
from stepblocks.contact.energy import Status
from stepblocks.contact.kernels import compute_height_at_angle
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.drag.probe import DragSettings, build_probe
from stepblocks.drag.ring import measure_ring
from stepblocks.drag.simulate import DragTrace, simulate_drag
from stepblocks.drag.track import build_track, find_asked_range

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class DragEvent:
    """One place that the tip came to; the fields are the columns of ``events.csv``.

    Attributes
    ----------
    event : int
        Number in the order of the drag.
    status : str
        ``"releases"``; ``"run-over"`` where the tip came in flight and was not caught; ``"locked"``
        where no pull lifts a rigid tip.
    belongs_to : str
        ``"feature"``: what was asked about, or the place with the greatest critical angle;
        ``"before"`` and ``"after"`` it: the texture, or another edge.
    x_m, contact_x_m : float
        Position of the tip's axis and of the edge that it touches, on the surface [m].
    critical_angle_deg : float
        Slope of the path of the tip there.
    caught_s, released_s : float
        When the pull begins to rise, and when it is greatest [s].
    pull_n : float
        That greatest pull.
    formula_pull_n : float
        Equation (1) for the same angle; NaN where it holds the tip.
    stored_energy_j, vibration_energy_j : float
        Energy of the spring at the release, and of the ring.
    ring_share : float
        One over the other [1].
    ring_decay_s : float
        Time in which the swings fall to 1/e; NaN where the next place comes before.
    ledger_error : float
        Open share of the energy ledger since the event before [1].
    """

    event: int
    status: str
    belongs_to: str
    x_m: float
    contact_x_m: float
    critical_angle_deg: float
    caught_s: float
    released_s: float
    pull_n: float
    formula_pull_n: float
    stored_energy_j: float = math.nan
    vibration_energy_j: float = math.nan
    ring_share: float = math.nan
    ring_decay_s: float = math.nan
    ledger_error: float = math.nan


def list_events(
    trace: DragTrace, backward: bool = False, within: tuple[float, float] | None = None
) -> tuple[DragEvent, ...]:
    """List every place that the tip came to, in the order of the drag; positions are on the surface."""
    return tuple(_read_events(trace, -1.0 if backward else 1.0, within))


def _read_events(
    trace: DragTrace, sign: float, within: tuple[float, float] | None
) -> Iterator[DragEvent]:
    asked = trace.passages[trace.asked] if trace.asked >= 0 else None
    for number, one in enumerate(trace.passages):
        belongs = "before" if asked is None or one.x < asked.x else "after"
        inside = within is not None and within[0] <= sign * one.contact <= within[1]
        if inside or (asked is not None and one.place == asked.place):
            belongs = "feature"
        figures = {}
        if one.status is Status.RELEASES:
            ring = measure_ring(trace, spectra=False, passage=number)
            figures = {
                "stored_energy_j": trace.probe.energy(one.pull),
                "vibration_energy_j": ring.energy,
                "ring_share": ring.share,
                "ring_decay_s": ring.decay_time,
            }
        yield DragEvent(
            event=number,
            status=str(one.status),
            belongs_to=belongs,
            x_m=sign * one.x,
            contact_x_m=sign * one.contact,
            critical_angle_deg=math.degrees(one.angle),
            caught_s=one.caught_time,
            released_s=one.time,
            pull_n=one.pull,
            formula_pull_n=one.needed if math.isfinite(one.needed) else math.nan,
            ledger_error=one.ledger_error,
            **figures,
        )


def build_event_table(events: tuple[DragEvent, ...]) -> pd.DataFrame:
    """Return the events as a table, one row each, the unit in each column's name."""
    import pandas as pd

    columns = list(DragEvent.__dataclass_fields__)
    return pd.DataFrame([asdict(one) for one in events], columns=columns)


def find_texture_floor(
    events: tuple[DragEvent, ...], radius_sum: float
) -> tuple[float, float] | None:
    """Find the greatest angle of the texture [rad], and the height of the step that it hides [m].

    A step of that height has the same critical angle, so that its release cannot be told from one
    of the texture. None where the feature stands alone.
    """
    angles = [one.critical_angle_deg for one in events if one.belongs_to != "feature"]
    if not angles:
        return None
    greatest = math.radians(max(angles))
    return greatest, float(compute_height_at_angle(greatest, radius_sum))


def drag_face(
    face: Counterface,
    point: OperatingPoint,
    backward: bool = False,
    *,
    settings: Mapping[str, float] | None = None,
    probe: Mapping[str, float] | None = None,
) -> DragTrace:
    """Drag over a counterface in time; the trace answers for the edge that the equations answer for."""
    track = build_track(face, point.ball_radius, backward)
    return simulate_drag(
        track,
        build_probe(point.tool, point.ball_radius, point.contact, **(probe or {})),
        DragSettings.under(point, **(settings or {})),
        find_asked_range(track),
    )
