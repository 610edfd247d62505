"""One participant's run of a design, trial by trial: what is next, what was answered; on the disk before the next trial is shown.

Whatever happens, the trial that was running is asked again, those that were answered stay, and the order is the design's.
"""

from __future__ import annotations

import fcntl
import math
import os
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from stepblocks.atomic import inside, replace_text
from stepblocks.contact.energy import Status
from stepblocks.errors import PipelineError, StudyError
from stepblocks.simulators.renderer import Renderer
from stepblocks.study import require
from stepblocks.study.blocks import Blocks, designed_blocks
from stepblocks.study.design import WHEN
from stepblocks.study.experiments import EXPERIMENTS, LARGEST_ESTIMATE, RATINGS, Row, number
from stepblocks.study.hands import HANDS, Hand, Mouse
from stepblocks.study.servo import RATE, Limits, Servo, write_motion
from stepblocks.study.sheet import answer_columns, read_answers, read_design, sheet_rows
from stepblocks.tables import csv_text

_SLOW = 1.0  # s
MAGNIFICATION = 100.0  # of a virtual block: the hand of a mouse travels centimetres [1]


@dataclass
class Run:
    """A participant's run; `state`, `begin` and `answer` are what a page needs of it."""

    folder: Path
    participant: str
    design: Sequence[Row]
    blocks: Blocks | None  # of virtual blocks
    hand: Hand | None = None  # of virtual blocks; a mouse where none is given
    scale: float = MAGNIFICATION  # of all blocks alike
    ratings: tuple[int, int] = RATINGS

    def __post_init__(self) -> None:
        self.planned = [row for row in self.design if row["participant"] == self.participant]
        known = ", ".join(dict.fromkeys(row["participant"] for row in self.design))
        require(self.planned, f"participant must be one of {known}, got {self.participant!r}")
        experiment = self.planned[0]["experiment"]
        self.kind, self.virtual = EXPERIMENTS[experiment], self.blocks is not None
        runs = self.folder / "runs"
        path = inside(runs, f"participant-{self.participant}.csv")
        require(path is not None, f"participant must be a plain name, got {self.participant!r}")
        assert path is not None
        runs.mkdir(exist_ok=True)
        self.path, self._guard = path, threading.RLock()
        self._running: Servo | None = None
        self._lock = (runs / f".{path.stem}.lock").open("w")
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self.answered = self._resume(experiment)
        except BaseException as error:
            self._lock.close()
            if not isinstance(error, BlockingIOError):
                raise
            said = f"participant {self.participant} must be run once at a time, another run is open [{path}]"
            raise PipelineError(said) from error

    def _resume(self, experiment: str) -> int:
        """Return how many trials are answered; a last line that a crash cut short is dropped."""
        columns = answer_columns(experiment)
        if not self.path.exists():
            replace_text(self.path, ",".join(columns) + "\n")
            return 0
        text = self.path.read_text(encoding="utf-8")
        if not text.endswith("\n"):
            text = text[: text.rfind("\n") + 1]
            replace_text(self.path, text or ",".join(columns) + "\n")
        rows, most = read_answers(self.path, experiment) if text.count("\n") > 1 else [], len(self.planned)
        for row, planned in zip(rows, self.planned, strict=False):
            if row["trial"] != planned["trial"]:
                said = f"trial must be {planned['trial']} here, as planned"
                raise StudyError(f"{said}, got {row['trial']} [{row['line']}]")
        require(len(rows) <= most, f"at most {most} trials are planned, got more [{self.path}]")
        return len(rows)

    @property
    def now(self) -> Row | None:
        """Return the trial that is next, with all that it hides; None when the run is done."""
        return self.planned[self.answered] if self.answered < len(self.planned) else None

    def state(self) -> dict[str, Any]:
        """Say what a page may show: neither identity nor height, and of a virtual block not even its condition."""
        row, running = self.now, self._running is not None
        said = {"participant": self.participant, "of": len(self.planned), "answers": list(self.kind.answers)}
        said |= {"virtual": self.virtual, "ratings": list(self.ratings), "done": row is None, "running": running}
        if row is not None:
            hidden = ("participant", *self.kind.answers, *(("condition", "code") if self.virtual else ()))
            said |= {name: text for name, text in sheet_rows([row])[0].items() if name not in hidden}
        return said

    def begin(self) -> None:
        """Start the servo loop of a virtual block; one that still runs is ended and begun anew."""
        with self._guard:
            row = self.now
            if row is None or self.blocks is None:
                return
            self.end()
            face, point = self.blocks.faces[row["stimulus"]], self.blocks.point
            path = face.centre_path(point.ball_radius)
            renderer = Renderer(path, point, scale=self.scale, rate=RATE, event=row["condition"] == "vibration-on")
            renderer.tick(np.array([0.0, 0.0, 1.0]), np.zeros(3))  # compiled before it is felt
            if self.hand is None or isinstance(self.hand, Mouse):
                self.hand = Mouse(point.normal_load, renderer.wall, float(renderer.path.z.max()))
            self.hand.begin()
            # without motors a machine that is slow for a moment needs no new start
            limits = Limits() if self.hand.motors else Limits(dead=_SLOW)
            self._running = Servo(renderer, self.hand, limits=limits)
            self._running.start()

    def felt(self) -> dict[str, Any]:
        """Return where the probe is [m], what rings (releases, amplitude of the last over the study's largest), what is in doubt."""
        servo = self._running
        if servo is None or self.blocks is None:
            return {"x": 0.0, "events": 0, "loudness": 0.0}
        tool, renderer = self.blocks.point.tool, servo.renderer
        loudness = abs(renderer.release_force) / self.strongest
        rung = {"frequency": tool.frequency, "decay": tool.decay_time, "loudness": loudness}
        doubts = {"over": servo.ended != "", "doubt": "" if servo.trusted else "".join(servo.doubts[-1:])}
        return {"x": renderer.proxy[0], "events": renderer.events, **rung, **doubts}

    @cached_property
    def strongest(self) -> float:
        """Return the largest release force of the study's blocks [N]: they share one full scale of sound, and of the page."""
        if self.blocks is None:
            return 1.0
        releases = [face.release(self.blocks.point) for face in self.blocks.faces.values()]
        return max((one.pull_force for one in releases if one.status is Status.RELEASES), default=1e-9)

    @property
    def reach(self) -> float:
        """Return how far the hand must pull before the last of the blocks releases, in the magnified frame [m]."""
        return 0.0 if self.blocks is None else self.scale * self.strongest / self.blocks.point.tool.stiffness

    def end(self) -> str:
        """Stop the servo loop, if one runs, and return why it ended."""
        if self._running is None:
            return ""
        self._running.stop()
        ended, self._running = self._running.ended, None
        return ended

    def answer(self, trial: str, texts: Mapping[str, str]) -> None:
        """Take the answer to the trial that is next: checked, its motion written, then itself, both on the disk before this returns."""
        with self._guard:
            row = self.now
            require(row is not None and trial == row["trial"], f"trial must be the one that is next, got {trial!r}")
            assert row is not None
            given = {name: texts.get(name, "").strip() for name in self.kind.answers}
            top = LARGEST_ESTIMATE * max(number(one["height_um"]) for one in self.design)
            self.kind.read(row, given, top, self.ratings)  # says what cannot be read
            if self.virtual:
                if (servo := self._running) is None:
                    raise StudyError(f"trial {trial} must be felt before it is answered")
                servo.stop()
                name = f"trial-{int(trial):04}.h5"
                told = {name: row[name] for name in (*WHEN, "stimulus", "height_um")} | {"scale": self.scale}
                write_motion(self.path.with_suffix("") / name, servo, told)
                self._running = None
            line = csv_text([sheet_rows([row])[0] | given]).splitlines()[1]
            with self.path.open("ab", buffering=0) as file:
                before = file.tell()
                try:
                    file.write(f"{line}\n".encode())
                    os.fsync(file.fileno())
                except BaseException:
                    file.truncate(before)  # the same trial is asked again
                    raise
            self.answered += 1

    def close(self) -> None:
        """Let go of the hand and of the run."""
        self.end()
        if self.hand is not None:
            self.hand.close()
        self._lock.close()


def open_run(
    folder: str | Path,
    participant: str,
    source: str | Path | None = None,
    *,
    device: str = "mouse",
    library: str = "",
    scale: float = MAGNIFICATION,
    ratings: tuple[int, int] = RATINGS,
    **felt: float,
) -> Run:
    """Open a participant's run of a design, where it was left.

    Parameters
    ----------
    folder : str or Path
        Holds design.csv; answers go to ``runs/participant-N.csv``, motions and forces of virtual blocks to ``runs/participant-N``.
    participant : str
        Whose run it is, as in the design.
    source : str or Path, optional
        Stimulus file of the virtual blocks; without one they are sharp steps of the design's heights.
    device : str
        ``"mouse"`` (and the loudspeaker of the browser), ``"openhaptics"``, ``"dhd"``, or ``"replay"`` of a recorded hand.
    library : str
        Path of the device's library, where the system does not find it, or of the record.
    scale : float
        Magnification of all blocks [1].
    ratings : tuple of int
        Lowest and highest rating.
    **felt : float
        As in `simulate_study`.

    Returns
    -------
    Run
        To be asked for its `state`, begun, answered, and closed.

    Raises
    ------
    StepblocksError
        If there is no such participant, block or device, or the run is open already.
    """
    require(math.isfinite(scale) and scale > 0.0, f"scale must be positive and finite, got {scale:g}")
    if device not in ("mouse", *HANDS):
        raise PipelineError(f"device must be one of mouse, {', '.join(HANDS)}, got {device!r}")
    design = read_design(Path(folder) / "design.csv")
    blocks = designed_blocks(design, source, felt) if design[0]["experiment"] == "virtual" else None
    hand = HANDS[device](library) if blocks is not None and device in HANDS else None
    return Run(Path(folder), participant, design, blocks, hand, scale, ratings)
