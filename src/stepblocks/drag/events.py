"""The events of a drag: every place that caught the tip, and how it let go.

One of them is the event that was asked about.
"""

from collections.abc import Mapping
from dataclasses import replace

from stepblocks.contact.counterface import Counterface
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.drag.probe import DragSettings, build_probe_of_tool
from stepblocks.drag.ring import measure_ring
from stepblocks.drag.simulate import Belonging, DragEvent, DragTrace, simulate_drag
from stepblocks.drag.track import build_track


def list_surface_events(
    trace: DragTrace, backward: bool, feature_range: tuple[float, float] | None
) -> tuple[DragEvent, ...]:
    """List every place that the tip came to, with its ring; positions are on the surface.

    Events at the place that was asked about, and those in the `feature_range` of x [m], belong to
    the feature.
    """
    sign = 1.0
    if backward:
        sign = -1.0
    events = []
    for number, event in enumerate(trace.events):
        contact_x = sign * event.contact_x_m
        placed = replace(
            event,
            belongs_to=_classify_belonging(trace, event, contact_x, feature_range),
            x_m=sign * event.x_m,
            contact_x_m=contact_x,
        )
        if event.status is Status.RELEASES:
            placed = _add_ring_figures(placed, trace, number)
        events.append(placed)
    return tuple(events)


def _classify_belonging(
    trace: DragTrace, event: DragEvent, contact_x: float, feature_range: tuple[float, float] | None
) -> Belonging:
    """Find to what an event belongs, whose edge lies at `contact_x` on the surface [m]."""
    if feature_range is not None and feature_range[0] <= contact_x <= feature_range[1]:
        return Belonging.FEATURE
    if trace.asked < 0:
        return Belonging.BEFORE
    asked = trace.events[trace.asked]
    if event.place == asked.place:
        return Belonging.FEATURE
    if event.x_m < asked.x_m:
        return Belonging.BEFORE
    return Belonging.AFTER


def _add_ring_figures(event: DragEvent, trace: DragTrace, event_number: int) -> DragEvent:
    """Return a release with the figures of its ring; `event_number` is that of the event."""
    ring = measure_ring(trace, with_spectra=False, event=event_number)
    return replace(
        event,
        sliding_force_n=ring.level,
        stored_energy_j=trace.probe.compute_energy(event.pull_n),
        vibration_energy_j=ring.energy,
        ring_share=ring.share,
        ring_decay_s=ring.decay_time,
        fall_energy_j=ring.fall_energy,
    )


def drag_face(
    face: Counterface,
    point: OperatingPoint,
    backward: bool = False,
    *,
    settings: Mapping[str, float] | None = None,
    probe: Mapping[str, float] | None = None,
) -> DragTrace:
    """Drag over a counterface in time.

    The trace answers for the edge that the equations answer for. `settings` and `probe` are fields
    of `DragSettings` and `Probe` that differ from those of the operating point.
    """
    track = build_track(face, point.ball_radius, backward)
    within = None
    if track.feature is not None:
        within = track.feature.first, track.feature.last
    built_probe = build_probe_of_tool(point.tool, point.ball_radius, point.contact, **(probe or {}))
    drag_settings = DragSettings.from_point(point, **(settings or {}))
    return simulate_drag(track, built_probe, drag_settings, within)
