"""What a measured session has taught, applied to a surface, its operating point and its rings."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from stepblocks.artefacts.model_file import LearnedModel
from stepblocks.contact.energy import Status
from stepblocks.contact.event import Learned, VibrationEvent, vibration_events, with_energy
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.parts.kind import Part
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.predict.learned import learned_drag


def teach(
    learned: LearnedModel, surface: Part, condition: OperatingPoint, speed: float, keep_friction: bool = False
) -> tuple[Part, OperatingPoint, tuple[VibrationEvent, VibrationEvent]]:
    """Apply what was learnt to a surface, its condition and its events."""
    height = _height(surface, condition.ball_radius, 1)
    known = learned_drag(learned, surface.id, height, replace(condition, speed=speed))
    friction = condition.friction if keep_friction else known.friction
    taught = replace(condition, friction=friction, tool=known.tool)
    if isinstance(surface, StepBlock) and known.edge_radius > 0.0:
        radius = min(known.edge_radius, surface.height.nominal)
        surface = surface.model_copy(update={"edge_radius": replace(surface.edge_radius, nominal=radius)})
    up, down = vibration_events(surface.id, surface.counterface(), taught)
    return (
        surface,
        taught,
        (_taught(learned, up, surface, taught, speed), _taught(learned, down, surface, taught, speed)),
    )


def _height(surface: Part, ball_radius: float, direction: int) -> float:
    """Height of the step that this edge is for the ball [m]: its own, or that of the same critical angle."""
    if isinstance(surface, StepBlock) and direction > 0:
        return surface.height.nominal
    angle = surface.counterface().centre_path(ball_radius).notch(float(direction))[2]
    return ball_radius * (1.0 - math.cos(angle))


def _taught(
    learned: LearnedModel, event: VibrationEvent, surface: Part, condition: OperatingPoint, speed: float
) -> VibrationEvent:
    if event.status is not Status.RELEASES:
        return event
    height = _height(surface, condition.ball_radius, event.direction)
    known = learned_drag(learned, surface.id, height, replace(condition, speed=speed))
    told = replace(event, learned=Learned(known.status, known.peak_force, known.energy))
    return with_energy(told, known.energy[0]) if np.isfinite(known.energy[0]) else told
