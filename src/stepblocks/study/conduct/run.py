"""One participant's run of a design: trial after trial, each on the disk before the next."""

# Whatever happens, the trial that was running is asked again, those that were answered stay, and
# the order is the design's.

import math
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path

import numpy as np

from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.errors import PipelineError, StudyError
from stepblocks.files.atomic import lock_folder, replace_text, resolve_inside
from stepblocks.files.tables import format_csv
from stepblocks.files.text import is_file
from stepblocks.haptics.hands import HANDS, Hand, Mouse
from stepblocks.haptics.renderer import Renderer
from stepblocks.haptics.servo import RATE, Limits, Servo, write_motion
from stepblocks.quantities import parse_quantity
from stepblocks.study import RATINGS, require
from stepblocks.study.design.adaptive import order_trials
from stepblocks.study.design.experiments import EXPERIMENTS, Row, read_number
from stepblocks.study.design.sheet import (
    STAMPS,
    blind_row,
    list_answer_columns,
    read_answers,
    read_design,
    read_plan,
)
from stepblocks.study.design.trials import (
    FACTOR,
    REAL,
    VIRTUAL_FACTORS,
    WHEN,
    Blocks,
    Declared,
    find_designed_blocks,
    list_levels,
)

_SLOW = 1.0  # s
# Columns of a run's file beside those of a run sheet: when the trial was shown and answered (UTC),
# the time between, and what the participant noted
_TIMES = (*STAMPS, "comment")
MAGNIFICATION = 100.0  # of a virtual block: the hand of a mouse travels centimetres [1]


@dataclass
class Run:
    """A participant's run; `state`, `begin`, `answer` and `undo` are what a page needs of it.

    Attributes
    ----------
    folder : Path
        Of the study.
    participant : str
        Whose run it is.
    design : sequence of mapping
        Rows of design.csv.
    blocks : Blocks or None
        Of virtual blocks.
    hand : Hand or None
        What moves the probe over virtual blocks; a mouse where none is given.
    scale : float
        Magnification of all virtual blocks alike [1].
    ratings : tuple of int
        Lowest and highest rating.
    practice : int
        Trials with feedback before the first, which are not recorded.
    """

    folder: Path
    participant: str
    design: Sequence[Row]
    blocks: Blocks | None
    hand: Hand | None = None
    scale: float = MAGNIFICATION
    ratings: tuple[int, int] = RATINGS
    practice: int = 0

    def __post_init__(self) -> None:
        self.planned = [row for row in self.design if row["participant"] == self.participant]
        require(
            self.planned,
            "participant must be one of "
            f"{', '.join(dict.fromkeys(row['participant'] for row in self.design))}, got "
            f"{self.participant!r}",
        )
        self.experiment = self.planned[0]["experiment"]
        self.kind = EXPERIMENTS[self.experiment]
        self.virtual = self.blocks is not None
        self.columns = (*list_answer_columns(self.experiment), *_TIMES)
        require(
            0 <= self.practice <= len(self.planned),
            f"practice must be from 0 to {len(self.planned)} trials, got {self.practice}",
        )
        require(
            "practice_code" in self.planned[0]
            or not self.practice
            or all(self._is_virtual(row) for row in self.planned),
            "practice must show other codes than the trials, and this design has none: run it "
            "without, or design the study anew",
        )
        path = resolve_inside(self.folder / "runs", f"participant-{self.participant}.csv")
        if path is None:
            raise StudyError(f"participant must be a plain name, got {self.participant!r}")
        self.path = path
        self._guard = threading.RLock()
        self._running: Servo | None = None
        # a clock that is set anew during a run changes no stamp and no reaction time
        self._shown = time.time()
        self._wall = self._shown - time.monotonic()
        self.feedback = ""
        with ExitStack() as held:
            held.enter_context(lock_folder(path.with_suffix("")))
            self._all = self.planned
            self._place(())
            self._rows = self._resume()
            self._held = held.pop_all()
        self.practice = 0 if self._rows else self.practice

    def _resume(self) -> list[dict[str, str]]:
        # Return the answered trials; a last line that a crash cut short is dropped
        if not self.path.exists():
            return []
        require(is_file(self.path), f"answers cannot be read: Not a plain file [{self.path}]")
        text = self.path.read_text(encoding="utf-8-sig")
        whole = text if text.endswith("\n") else text[: text.rfind("\n") + 1]
        if whole != text:
            replace_text(self.path, whole or ",".join(self.columns) + "\n")
        rows = read_answers(self.path, self.experiment)
        self._place(rows)
        for row, planned in zip(rows, self.planned, strict=False):
            for name in ("participant", "trial"):
                require(
                    row[name] == planned[name],
                    f"{name} must be {planned[name]} here, as planned, got {row[name]} "
                    f"[{row['line']}]",
                )
        require(
            len(rows) <= len(self.planned),
            f"at most {len(self.planned)} trials are planned, got more [{self.path}]",
        )
        if whole.partition("\n")[0] != ",".join(self.columns):
            self._write(rows)  # a spreadsheet saved it with other separators or decimals
        return rows

    def _place(self, rows: Sequence[Row]) -> None:
        # Put the trials of an adaptive design in the order in which the answers place them
        if self.kind.adaptive:
            self.planned = order_trials(self._all, rows, read_plan(self.folder)[1])

    def _write(self, rows: Sequence[Row]) -> None:
        replace_text(
            self.path,
            format_csv(
                [{name: row.get(name, "") for name in self.columns} for row in rows], self.columns
            ),
        )

    @property
    def answered(self) -> int:
        """Return how many trials are answered."""
        return len(self._rows)

    @property
    def now(self) -> Row | None:
        """Return the trial that is next, with all that it hides; None when the run is done."""
        if self.practice:
            row = self.planned[-self.practice]
            return {
                **row,
                "code": row.get("practice_code", ""),
                "standard_code": row.get("practice_standard_code", ""),
            }
        return self.planned[self.answered] if self.answered < len(self.planned) else None

    def _is_virtual(self, row: Row | None) -> bool:
        return self.virtual and row is not None and row.get(f"{FACTOR}block") != REAL

    def state(self) -> dict[str, object]:
        """Say what a page may show: no identity or height, and of a virtual block no condition."""
        row = self.now
        virtual = self._is_virtual(row)
        found: dict[str, object] = {
            "participant": self.participant,
            "of": len(self.planned),
            "answers": list(self.kind.answers),
            "virtual": virtual,
            "ratings": list(self.ratings),
            "done": row is None,
            "running": self._running is not None,
            "practice": self.practice,
            "feedback": self.feedback,
            "answered": self.answered,
        }
        if row is not None:
            hidden = (
                "participant",
                *self.kind.answers,
                *(("setting", "condition", "code") if virtual else ()),
            )
            found |= {name: text for name, text in blind_row(row).items() if name not in hidden}
        return found

    def _set_point(self, row: Row) -> OperatingPoint:
        # Return where a virtual block is felt, as the trial's factors say
        assert self.blocks is not None
        levels = {
            name: parse_quantity(row[f"{FACTOR}{name}"], dimension)
            for name, dimension in VIRTUAL_FACTORS.items()
            if dimension and f"{FACTOR}{name}" in row
        }
        point = self.blocks.point
        return replace(
            point,
            normal_load=levels.get("load", point.normal_load),
            tool=replace(
                point.tool,
                frequency=levels.get("frequency", point.tool.frequency),
                decay_time=levels.get("decay", point.tool.decay_time),
                conversion=point.tool.conversion * levels.get("amplitude", 1.0) ** 2,
            ),
        )

    def begin(self) -> None:
        """Start the servo loop of a virtual block; one that still runs is ended and begun anew."""
        with self._guard:
            row = self.now
            if row is None or self.blocks is None or not self._is_virtual(row):
                return
            self.end()
            point = self._set_point(row)
            renderer = Renderer(
                self.blocks.faces[row["stimulus"]].centre_path(point.ball_radius),
                point,
                scale=self.scale,
                rate=RATE,
                event="vibration-off" not in list_levels(row),
            )
            renderer.tick(np.array([0.0, 0.0, 1.0]), np.zeros(3))  # compiled before it is felt
            if self.hand is None or isinstance(self.hand, Mouse):
                self.hand = Mouse(point.normal_load, renderer.wall, float(renderer.path.z.max()))
            self._running = Servo(
                renderer,
                self.hand,
                # without motors a machine that is slow for a moment needs no new start
                limits=Limits() if self.hand.motors else Limits(dead=_SLOW),
            )
            self._point = point
            self._running.start()
            self._shown = self._wall + time.monotonic()

    def sense(self) -> dict[str, object]:
        """Return where the probe is [m], what rings, and what is in doubt."""
        # `loudness` is the amplitude of the last release over the largest of the study
        servo = self._running
        if servo is None or self.blocks is None:
            return {"x": 0.0, "events": 0, "loudness": 0.0}
        tool, renderer = self._point.tool, servo.renderer
        louder = math.sqrt(tool.conversion / self.blocks.point.tool.conversion)
        return {
            "x": renderer.proxy[0],
            "events": renderer.events,
            "frequency": tool.frequency,
            "decay": tool.decay_time,
            "loudness": min(louder * abs(renderer.release_force) / self.strongest, 1.0),
            "over": servo.ended != "",
            "doubt": "" if servo.trusted else "".join(servo.doubts[-1:]),
        }

    @cached_property
    def strongest(self) -> float:
        """Return the largest release force of the study's blocks [N], the full scale of sound."""
        assert self.blocks is not None
        releases = [face.release(self.blocks.point) for face in self.blocks.faces.values()]
        return max(
            (one.pull_force for one in releases if one.status is Status.RELEASES), default=1e-9
        )

    @property
    def reach(self) -> float:
        """Return how far a hand pulls, magnified, before the last block releases [m]."""
        return (
            0.0
            if self.blocks is None
            else self.scale * self.strongest / self.blocks.point.tool.stiffness
        )

    def end(self) -> None:
        """Stop the servo loop, if one runs."""
        if self._running is not None:
            self._running.stop()
            self._running = None

    def answer(
        self, trial: str, texts: Mapping[str, str], reaction: float = math.nan, comment: str = ""
    ) -> None:
        """Check the answer to the trial that is next, and write it, after its motion, to the disk.

        Parameters
        ----------
        trial : str
            Its number.
        texts : mapping of str
            By column of the answers.
        reaction : float
            Time from the question to the answer as the page measured it [s], at most a day; by
            default since the trial was shown.
        comment : str
            Note of the participant.
        """
        with self._guard:
            row = self.now
            now = self._wall + time.monotonic()
            if row is None or trial != row["trial"]:
                raise StudyError(f"trial must be the one that is next, got {trial!r}")
            require(
                math.isnan(reaction) or 0.0 <= reaction <= 86_400.0,  # a day [s]
                f"reaction_s must be from 0 to 86400, got {reaction:g}: load the page anew",
            )
            given = {name: texts.get(name, "").strip() for name in self.kind.answers}
            values = self.kind.read(row, given, self.ratings)  # refuses what cannot be read
            if self._is_virtual(row):
                servo = self._running
                if servo is None or not (servo.record()["held"] > 0.0).any():
                    raise StudyError(f"trial {trial} must be touched before it is answered")
                servo.stop()
                if not self.practice:
                    write_motion(
                        self.path.with_suffix("") / f"trial-{int(trial):04}.h5",
                        servo,
                        {
                            **{name: row[name] for name in (*WHEN, "stimulus", "height_um")},
                            "scale": self.scale,
                        },
                    )
                self._running = None
            if self.practice:
                self.practice -= 1
                self.feedback = _give_feedback(row, values)
                self._shown = now
                return
            seconds = now - self._shown if math.isnan(reaction) else reaction
            stamps = [
                datetime.fromtimestamp(one, UTC)
                .isoformat(timespec="milliseconds")
                .replace("+00:00", "Z")
                for one in (self._shown, now)
            ]
            cells = (*stamps, f"{seconds:.3f}", " ".join(comment.split())[:500])
            line = blind_row(row) | given | dict(zip(_TIMES, cells, strict=True))
            self._write([*self._rows, line])
            self._rows.append(line)
            self._place(self._rows)
            self.feedback = ""
            self._shown = now

    def undo(self) -> None:
        """Take the last answer back; its trial is asked again."""
        with self._guard:
            require(self._rows, "an answer must be given before it can be taken back, got none")
            self.end()
            self._write(self._rows[:-1])
            self._rows.pop()
            self._place(self._rows)
            self._shown = self._wall + time.monotonic()

    def close(self) -> None:
        """Let go of the hand and of the run."""
        self.end()
        if self.hand is not None:
            self.hand.close()
        self._held.close()


def _give_feedback(row: Row, values: Mapping[str, float]) -> str:
    # Say after a practice trial what was right
    height, standard = (read_number(row[name]) for name in ("height_um", "standard_height_um"))
    if "higher" in values:
        return "right" if bool(values["higher"]) == (height > standard) else "wrong"
    return f"the step is {height:g} um high" if "error" in values else ""


def open_run(
    folder: str | Path,
    participant: str,
    source: Declared | None = None,
    *,
    device: str = "mouse",
    library: str = "",
    scale: float = MAGNIFICATION,
    ratings: tuple[int, int] = RATINGS,
    practice: int = 0,
    **felt: float,
) -> Run:
    """Open a participant's run of a design, where it was left.

    Parameters
    ----------
    folder : str or Path
        Holds design.csv; answers go to ``runs/participant-N.csv``, motions and forces of virtual
        blocks to ``runs/participant-N``.
    participant : str
        Whose run it is, as in the design.
    source : str, Path or StimulusSet, optional
        Stimulus file of the virtual blocks; without one they are sharp steps of the design's
        heights.
    device : str
        ``"mouse"`` (and the loudspeaker of the browser), ``"openhaptics"`` or ``"dhd"``.
    library : str
        Path of the device's library, where the system does not find it.
    scale : float
        Magnification of all blocks [1].
    ratings : tuple of int
        Lowest and highest rating.
    practice : int
        Trials with feedback before the first; they are not recorded.
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
    require(
        math.isfinite(scale) and scale > 0.0, f"scale must be positive and finite, got {scale:g}"
    )
    PipelineError.require(
        device in ("mouse", *HANDS),
        f"device must be one of mouse, {', '.join(HANDS)}, got {device!r}",
    )
    require(
        not library or device in HANDS,
        f"library is an option of {', '.join(HANDS)}, not of {device}",
    )
    design = read_design(Path(folder) / "design.csv")
    blocks = (
        find_designed_blocks(design, source, felt) if design[0]["experiment"] == "virtual" else None
    )
    return Run(
        Path(folder),
        participant,
        design,
        blocks,
        HANDS[device](library) if blocks is not None and device in HANDS else None,
        scale,
        ratings,
        practice,
    )
