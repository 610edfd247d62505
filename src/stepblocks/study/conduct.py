"""One participant's run of a design, trial by trial: what is next, what was answered; on the disk before the next trial is shown."""

# Whatever happens, the trial that was running is asked again, those that were answered stay, and
# the order is the design's.

import json
import math
import os
import secrets
import threading
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cached_property
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np

from stepblocks.atomic import lock_folder, replace_text, resolve_inside
from stepblocks.contact.energy import Status
from stepblocks.errors import PipelineError, StepblocksError, StudyError
from stepblocks.page_file import render_page
from stepblocks.simulators.renderer import Renderer
from stepblocks.study import require
from stepblocks.study.design import WHEN, Blocks, find_designed_blocks
from stepblocks.study.experiments import EXPERIMENTS, LARGEST_ESTIMATE, RATINGS, Row, read_number
from stepblocks.study.hands import HANDS, Hand, Mouse
from stepblocks.study.servo import RATE, Limits, Servo, raise_priority, write_motion
from stepblocks.study.sheet import blind_rows, list_answer_columns, read_answers, read_design
from stepblocks.tables import format_csv

_SLOW = 1.0  # s
_LARGEST = 20_000  # bytes of a request
_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; connect-src 'self'"
)
_PULL = 400  # pixels to the right of the edge that are there on every screen
_LINGER = 1.5  # the page still shows that the run is done [s]
MAGNIFICATION = 100.0  # of a virtual block: the hand of a mouse travels centimetres [1]


@dataclass
class Run:
    """A participant's run; `state`, `begin` and `record_answer` are what a page needs of it."""

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
        path = resolve_inside(runs, f"participant-{self.participant}.csv")
        if path is None:
            raise StudyError(f"participant must be a plain name, got {self.participant!r}")
        self.path, self._guard = path, threading.RLock()
        self._running: Servo | None = None
        with ExitStack() as held:
            held.enter_context(lock_folder(path.with_suffix("")))
            self.answered = self._resume(experiment)
            self._held = held.pop_all()

    def _resume(self, experiment: str) -> int:
        """Return how many trials are answered; a last line that a crash cut short is dropped."""
        columns = list_answer_columns(experiment)
        if not self.path.exists():
            replace_text(self.path, ",".join(columns) + "\n")
            return 0
        text = self.path.read_text(encoding="utf-8")
        if not text.endswith("\n"):
            text = text[: text.rfind("\n") + 1]
            replace_text(self.path, text or ",".join(columns) + "\n")
        rows, most = (
            read_answers(self.path, experiment) if text.count("\n") > 1 else [],
            len(self.planned),
        )
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
        said = {
            "participant": self.participant,
            "of": len(self.planned),
            "answers": list(self.kind.answers),
        }
        said |= {
            "virtual": self.virtual,
            "ratings": list(self.ratings),
            "done": row is None,
            "running": running,
        }
        if row is not None:
            hidden = (
                "participant",
                *self.kind.answers,
                *(("condition", "code") if self.virtual else ()),
            )
            said |= {
                name: text for name, text in blind_rows([row])[0].items() if name not in hidden
            }
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
            renderer = Renderer(
                path, point, scale=self.scale, rate=RATE, event=row["condition"] == "vibration-on"
            )
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
        doubts = {
            "over": servo.ended != "",
            "doubt": "" if servo.trusted else "".join(servo.doubts[-1:]),
        }
        return {"x": renderer.proxy[0], "events": renderer.events, **rung, **doubts}

    @cached_property
    def strongest(self) -> float:
        """Return the largest release force of the study's blocks [N]: they share one full scale of sound, and of the page."""
        if self.blocks is None:
            return 1.0
        releases = [face.release(self.blocks.point) for face in self.blocks.faces.values()]
        return max(
            (one.pull_force for one in releases if one.status is Status.RELEASES), default=1e-9
        )

    @property
    def reach(self) -> float:
        """Return how far the hand must pull before the last of the blocks releases, in the magnified frame [m]."""
        return (
            0.0
            if self.blocks is None
            else self.scale * self.strongest / self.blocks.point.tool.stiffness
        )

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
            if row is None or trial != row["trial"]:
                raise StudyError(f"trial must be the one that is next, got {trial!r}")
            given = {name: texts.get(name, "").strip() for name in self.kind.answers}
            top = LARGEST_ESTIMATE * max(read_number(one["height_um"]) for one in self.design)
            self.kind.read(row, given, top, self.ratings)  # says what cannot be read
            if self.virtual:
                if (servo := self._running) is None:
                    raise StudyError(f"trial {trial} must be felt before it is answered")
                servo.stop()
                name = f"trial-{int(trial):04}.h5"
                told = {name: row[name] for name in (*WHEN, "stimulus", "height_um")} | {
                    "scale": self.scale
                }
                write_motion(self.path.with_suffix("") / name, servo, told)
                self._running = None
            line = format_csv([blind_rows([row])[0] | given]).splitlines()[1]
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
        self._held.close()


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
        Holds design.csv; answers go to ``runs/participant-N.csv``, motions and forces of virtual
        blocks to ``runs/participant-N``.
    participant : str
        Whose run it is, as in the design.
    source : str or Path, optional
        Stimulus file of the virtual blocks; without one they are sharp steps of the design's
        heights.
    device : str
        ``"mouse"`` (and the loudspeaker of the browser), ``"openhaptics"``, ``"dhd"``, or
        ``"replay"`` of a recorded hand.
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
    require(
        math.isfinite(scale) and scale > 0.0, f"scale must be positive and finite, got {scale:g}"
    )
    if device not in ("mouse", *HANDS):
        raise PipelineError(f"device must be one of mouse, {', '.join(HANDS)}, got {device!r}")
    design = read_design(Path(folder) / "design.csv")
    blocks = (
        find_designed_blocks(design, source, felt) if design[0]["experiment"] == "virtual" else None
    )
    hand = HANDS[device](library) if blocks is not None and device in HANDS else None
    return Run(Path(folder), participant, design, blocks, hand, scale, ratings)


class RunServer(ThreadingHTTPServer):
    """Serves one run until it is done; `url` is where."""

    daemon_threads = True

    def __init__(self, run: Run, port: int = 0) -> None:
        super().__init__(("127.0.0.1", port), _Handler)
        self.experiment, self.token = run, secrets.token_urlsafe(16)
        self.url = f"http://127.0.0.1:{self.server_address[1]}/"

    def until_done(self) -> None:
        """Serve until the last answer is given."""
        if self.experiment.virtual:
            raise_priority(10)
        try:
            self.serve_forever(poll_interval=0.1)
        finally:
            self.server_close()
            self.experiment.close()


class _Handler(BaseHTTPRequestHandler):
    server: RunServer
    protocol_version = "HTTP/1.1"

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing: the terminal is the experimenter's."""

    def do_GET(self) -> None:
        run = self.server.experiment
        if not self._ours(None):
            return
        if self.path == "/":
            told = {
                "participant": run.participant,
                "virtual": run.virtual,
                "token": self.server.token,
            }
            page = render_page(
                "study", "run.html", metres=max(1e-4, 1.2 * run.reach / _PULL), **told
            )
            self._send(200, page, "text/html; charset=utf-8")
        elif self.path == "/state":
            self._json(200, run.state())
        else:
            self._json(404, {"error": "there is nothing here"})

    def do_POST(self) -> None:
        run, size = self.server.experiment, int(self.headers.get("Content-Length") or 0)
        content = self.rfile.read(min(size, _LARGEST))
        # a page of somebody else in the same browser knows no token
        if not self._ours(self.headers.get("X-Stepblocks")):
            return
        try:
            asked = json.loads(content) if size <= _LARGEST else None
            if not isinstance(asked, dict):
                raise ValueError("a JSON object is expected")
            if self.path == "/hand":
                if isinstance(run.hand, Mouse):
                    run.hand.post(min(max(float(asked["x"]), -1.0), 1.0), bool(asked["held"]))
                return self._json(200, run.felt())
            if self.path == "/begin":
                run.begin()
            elif self.path == "/answer":
                run.answer(
                    str(asked["trial"]),
                    {str(name): str(text) for name, text in asked["answers"].items()},
                )
                if run.now is None:
                    threading.Timer(_LINGER, self.server.shutdown).start()
            else:
                return self._json(404, {"error": "there is nothing here"})
            self._json(200, run.state())
        except StepblocksError as error:
            self._json(422, {"error": str(error)})
        except (ValueError, KeyError, TypeError, AttributeError):
            self._json(400, {"error": "the request is not one of this page"})

    def _ours(self, token: str | None) -> bool:
        """Whether a request is meant for this machine, and where it changes something, comes from this page."""
        local = (self.headers.get("Host") or "").rpartition(":")[0] in ("127.0.0.1", "localhost")
        if local and (
            self.command == "GET" or secrets.compare_digest(token or "", self.server.token)
        ):
            return True
        self._json(403, {"error": "only the page of this run may ask this"})
        return False

    def _json(self, status: int, content: object) -> None:
        self._send(status, json.dumps(content), "application/json")

    def _send(self, status: int, text: str, kind: str) -> None:
        body = text.encode()
        self.send_response(status)
        headers = {
            "Content-Type": kind,
            "Content-Length": str(len(body)),
            "Cache-Control": "no-store",
        }
        for name, value in (headers | {"Content-Security-Policy": _POLICY}).items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)
