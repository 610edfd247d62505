"""The events of a drag: every place that caught the tip, and how it let go.

One of them is the event that was asked about.
"""

from collections.abc import Mapping
from dataclasses import replace

from stepblocks.contact.counterface import Counterface
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.drag.probe import DragSettings, build_probe
from stepblocks.drag.ring import measure_ring
from stepblocks.drag.simulate import DragEvent, DragTrace, simulate_drag
from stepblocks.drag.track import build_track


def list_events(
    trace: DragTrace, backward: bool, within: tuple[float, float] | None
) -> tuple[DragEvent, ...]:
    """List every place that the tip came to, with its ring; positions are on the surface."""
    sign = -1.0 if backward else 1.0
    asked = trace.events[trace.asked] if trace.asked >= 0 else None

    def complete(number: int, one: DragEvent) -> DragEvent:
        belongs = "before" if asked is None or one.x_m < asked.x_m else "after"
        inside = within is not None and within[0] <= sign * one.contact_x_m <= within[1]
        if inside or (asked is not None and one.place == asked.place):
            belongs = "feature"
        placed = replace(
            one, belongs_to=belongs, x_m=sign * one.x_m, contact_x_m=sign * one.contact_x_m
        )
        if one.status != "releases":
            return placed
        ring = measure_ring(trace, spectra=False, event=number)
        return replace(
            placed,
            sliding_force_n=ring.level,
            stored_energy_j=trace.probe.energy(one.pull_n),
            vibration_energy_j=ring.energy,
            ring_share=ring.share,
            ring_decay_s=ring.decay_time,
            fall_energy_j=ring.fall_energy,
        )

    return tuple(complete(number, one) for number, one in enumerate(trace.events))


def drag_face(
    face: Counterface,
    point: OperatingPoint,
    backward: bool = False,
    *,
    settings: Mapping[str, float] | None = None,
    probe: Mapping[str, float] | None = None,
) -> DragTrace:
    """Drag over a counterface in time.

    The trace answers for the edge that the equations answer for.
    """
    track = build_track(face, point.ball_radius, backward)
    return simulate_drag(
        track,
        build_probe(point.tool, point.ball_radius, point.contact, **(probe or {})),
        DragSettings.under(point, **(settings or {})),
        track.feature and track.feature[:2],
    )
