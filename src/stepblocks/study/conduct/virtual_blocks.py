"""Virtual blocks of a run: the servo loop of each trial, and what the page hears of it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.haptics.hands import Hand, Mouse
from stepblocks.haptics.renderer import Renderer
from stepblocks.haptics.servo import RATE, Limits, Servo
from stepblocks.quantities import parse_quantity
from stepblocks.study.columns import FACTOR, Row, collect_levels_of_trial
from stepblocks.study.design.blocks import Blocks
from stepblocks.study.design.virtual import DIMENSIONS, VIBRATION_OFF

_SLOW = 1.0  # without motors a machine that is slow for a moment needs no new start [s]
_NO_RELEASE = 1e-9  # full scale of sound where no block releases [N]
_ABOVE = 1.0  # height of the probe at which the renderer is compiled [m]


@dataclass(frozen=True)
class _Trial:
    """The trial in progress."""

    servo: Servo
    point: OperatingPoint


class VirtualBlocks:
    """The virtual blocks of a study, one of which is felt at a time.

    Parameters
    ----------
    blocks : Blocks
        Of the study.
    hand : Hand or None
        What moves the probe; a mouse where none is given.
    scale : float
        Magnification of all blocks alike [1].
    """

    def __init__(self, blocks: Blocks, hand: Hand | None, scale: float) -> None:
        self.blocks = blocks
        self.hand = hand
        self.scale = scale
        self._trial: _Trial | None = None

    @property
    def servo(self) -> Servo | None:
        """The loop of the trial that is felt; None between trials."""
        trial = self._trial  # another thread may end it
        if trial is None:
            return None
        return trial.servo

    @cached_property
    def largest_release_force(self) -> float:
        """The largest release force of the study's blocks [N], the full scale of sound."""
        forces = []
        for face in self.blocks.faces.values():
            release = face.release(self.blocks.point)
            if release.status is Status.RELEASES:
                forces.append(release.pull_force)
        return max(forces, default=_NO_RELEASE)

    @property
    def reach(self) -> float:
        """How far a hand pulls, magnified, before the last block releases [m]."""
        return self.scale * self.largest_release_force / self.blocks.point.tool.stiffness

    def begin(self, row: Row) -> None:
        """Start the servo loop of a trial; one that still runs is ended."""
        self.end()
        point = self._make_operating_point(row)
        renderer = Renderer(
            self.blocks.faces[row["stimulus"]].centre_path(point.ball_radius),
            point,
            scale=self.scale,
            rate=RATE,
            event=VIBRATION_OFF not in collect_levels_of_trial(row),
        )
        renderer.tick(np.array([0.0, 0.0, _ABOVE]), np.zeros(3))  # compiled before it is felt
        if self.hand is None or isinstance(self.hand, Mouse):
            self.hand = Mouse(point.normal_load, renderer.wall, float(renderer.path.z.max()))
        limits = Limits()
        if not self.hand.motors:
            limits = Limits(dead=_SLOW)
        servo = Servo(renderer, self.hand, limits=limits)
        self._trial = _Trial(servo, point)
        servo.start()

    def _make_operating_point(self, row: Row) -> OperatingPoint:
        """Return where a block is felt, as the trial's factors say."""
        levels = {}
        for name, dimension in DIMENSIONS.items():
            column = f"{FACTOR}{name}"
            if column in row:
                levels[name] = parse_quantity(row[column], dimension)
        point = self.blocks.point
        tool = replace(
            point.tool,
            frequency=levels.get("frequency", point.tool.frequency),
            decay_time=levels.get("decay", point.tool.decay_time),
            conversion=point.tool.conversion * levels.get("amplitude", 1.0) ** 2,
        )
        return replace(point, normal_load=levels.get("load", point.normal_load), tool=tool)

    def is_touched(self) -> bool:
        """Return whether the block of the trial was touched."""
        servo = self.servo
        return servo is not None and bool((servo.get_log_columns()["held"] > 0.0).any())

    def report_probe_state(self) -> Mapping[str, object]:
        """Return where the probe is [m], what rings, and what is in doubt, as the page asks it.

        ``loudness`` is the amplitude of the last release over the largest of the study.
        """
        trial = self._trial  # another thread may end it
        if trial is None:
            return {"x": 0.0, "events": 0, "loudness": 0.0}
        servo, renderer = trial.servo, trial.servo.renderer
        tool = trial.point.tool
        louder = math.sqrt(tool.conversion / self.blocks.point.tool.conversion)
        loudness = louder * abs(renderer.release_force) / self.largest_release_force
        doubt = ""
        if servo.doubts and not servo.trusted:
            doubt = servo.doubts[-1]
        return {
            "x": renderer.proxy[0],
            "events": renderer.events,
            "frequency": tool.frequency,
            "decay": tool.decay_time,
            "loudness": min(loudness, 1.0),
            "over": servo.ended != "",
            "doubt": doubt,
        }

    def end(self) -> None:
        """Stop the servo loop, if one runs."""
        if self._trial is not None:
            self._trial.servo.stop()
            self._trial = None

    def close(self) -> None:
        """Release the hand."""
        self.end()
        if self.hand is not None:
            self.hand.close()
