"""One participant's run of a design: trial after trial, each on the disk before the next."""

# Whatever happens, the trial that was running is asked again, those that were answered stay, and
# the order is the design's.

import math
import re
import threading
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

from stepblocks.errors import PipelineError, StudyError
from stepblocks.files.atomic import lock_folder, resolve_inside
from stepblocks.haptics.hands import HANDS, Hand, Mouse
from stepblocks.haptics.servo import Servo, write_motion_file
from stepblocks.study.columns import FACTOR, RATINGS, WHEN, Row, read_number_or_nan
from stepblocks.study.conduct.answer_file import TIMES, AnswerFile
from stepblocks.study.conduct.clock import SteadyClock, format_timestamp
from stepblocks.study.conduct.virtual_blocks import VirtualBlocks
from stepblocks.study.design.adaptive import order_trials
from stepblocks.study.design.blocks import Blocks, Declared, find_designed_blocks
from stepblocks.study.design.plan import read_plan, read_prior
from stepblocks.study.design.read import SheetRow, read_design
from stepblocks.study.design.sheet import make_blinded_row
from stepblocks.study.design.virtual import BLOCK, REAL
from stepblocks.study.experiments.registry import EXPERIMENTS

MAGNIFICATION = 100.0  # of a virtual block: the hand of a mouse travels centimetres [1]
_LONGEST_REACTION = 86_400.0  # a day [s]
_LONGEST_COMMENT = 500  # letters

# What a participant reads for the columns of answers
_ANSWER_WORDS = {
    "estimate_um": "the height in micrometres",
    "realism_rating": "the rating",
    "second_is_higher": "the answer",
    "magnitude_ratio": "the number",
}
_DECIMAL_COMMA = re.compile(r"(\d+),(\d+)")


def _convert_decimal_comma(column: str, text: str) -> str:
    """Return an answer with a decimal point where a participant wrote a decimal comma.

    Three digits behind a comma may be thousands, which nobody must guess.
    """
    found = _DECIMAL_COMMA.fullmatch(text)
    if found is None:
        return text
    whole, share = found.groups()
    if len(share) == 3 and whole != "0":
        words = _ANSWER_WORDS.get(column, column)
        raise StudyError(
            f"{words} must be clear: is it {whole}{share} or {whole}.{share}? Write one of them"
        )
    return f"{whole}.{share}"


class Run:
    """A participant's run; `state`, `begin`, `answer` and `undo` are what a page needs of it.

    Parameters
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

    Attributes
    ----------
    planned : list of mapping
        Rows of design.csv of this participant, in the order in which they are run.
    path : Path
        Of the answers.
    feedback : str
        What was right in the last trial of practice.

    Raises
    ------
    StepblocksError
        If the design has no such participant or practice, another run is open, or the answers so
        far do not belong to the design.
    """

    def __init__(
        self,
        folder: Path,
        participant: str,
        design: Sequence[Row],
        blocks: Blocks | None,
        hand: Hand | None = None,
        *,
        scale: float = MAGNIFICATION,
        ratings: tuple[int, int] = RATINGS,
        practice: int = 0,
    ) -> None:
        self.folder = folder
        self.participant = participant
        self.ratings = ratings
        self.practice = practice
        self._plan = read_plan(folder)
        self.planned = [row for row in design if row["participant"] == participant]
        if not self.planned:
            people = dict.fromkeys(row["participant"] for row in design)
            raise StudyError(f"participant must be one of {', '.join(people)}, got {participant!r}")
        self.experiment = self.planned[0]["experiment"]
        self.kind = EXPERIMENTS[self.experiment]
        self._virtual: VirtualBlocks | None = None
        if blocks is not None:
            self._virtual = VirtualBlocks(blocks, hand, scale)
        self._check_practice_count()
        path = resolve_inside(folder / "runs", f"participant-{participant}.csv")
        if path is None:
            raise StudyError(f"participant must be a plain name, got {participant!r}")
        self.path = path
        self.feedback = ""
        self._guard = threading.RLock()
        self._clock = SteadyClock()
        self._shown = self._clock.read_time()
        self._file = AnswerFile(path, self.experiment)
        self._designed = self.planned
        with ExitStack() as stack:
            stack.enter_context(lock_folder(path.with_suffix("")))
            self._update_trial_order(())
            self._rows = self._read_answered_trials()
            self._lock = stack.pop_all()
        if self._rows:
            self.practice = 0

    def _check_practice_count(self) -> None:
        """Reject practice that the design does not have codes for."""
        if not 0 <= self.practice <= len(self.planned):
            raise StudyError(
                f"practice must be from 0 to {len(self.planned)} trials, got {self.practice}"
            )
        if not self.practice or "practice_code" in self.planned[0]:
            return
        if not all(self._is_virtual_trial(row) for row in self.planned):
            raise StudyError(
                "practice must show other codes than the trials, and this design has none: run it "
                "without, or design the study anew"
            )

    def _read_answered_trials(self) -> list[dict[str, str]]:
        """Return the answered trials, as planned."""
        answers = self._file.read_answered_rows()
        rows = [dict(answer.cells) for answer in answers]
        self._update_trial_order(rows)
        for answer, planned in zip(answers, self.planned, strict=False):
            _check_answer_is_planned(answer, planned)
        if len(rows) > len(self.planned):
            raise StudyError(
                f"answers must be at most the {len(self.planned)} planned, got {len(rows)} "
                f"[{self.path}]"
            )
        if self.path.exists() and self._file.was_saved_by_other_program():
            self._file.write_answered_rows(rows)
        return rows

    def _update_trial_order(self, answers: Sequence[Row]) -> None:
        """Put the trials of an adaptive design in the order in which the answers place them."""
        if self.kind.adaptive:
            self.planned = order_trials(self._designed, answers, read_prior(self.folder))

    @property
    def answered(self) -> int:
        """How many trials are answered."""
        return len(self._rows)

    @property
    def now(self) -> Row | None:
        """The trial that is next, with all that it hides; None when the run is done."""
        if self.practice:
            row = self.planned[-self.practice]
            return {
                **row,
                "code": row.get("practice_code", ""),
                "standard_code": row.get("practice_standard_code", ""),
            }
        if self.answered < len(self.planned):
            return self.planned[self.answered]
        return None

    @property
    def virtual(self) -> bool:
        """Whether the experiment is one on virtual blocks."""
        return self._virtual is not None

    @property
    def blocks(self) -> Blocks | None:
        """The virtual blocks; None where blocks are real."""
        if self._virtual is None:
            return None
        return self._virtual.blocks

    @property
    def hand(self) -> Hand | None:
        """What moves the probe over virtual blocks; None before a mouse does."""
        if self._virtual is None:
            return None
        return self._virtual.hand

    @hand.setter
    def hand(self, hand: Hand | None) -> None:
        if self._virtual is not None:
            self._virtual.hand = hand

    @property
    def servo(self) -> Servo | None:
        """The loop of the virtual block that is felt; None where none is."""
        if self._virtual is None:
            return None
        return self._virtual.servo

    @property
    def reach(self) -> float:
        """How far a hand pulls, magnified, before the last block releases [m]."""
        if self._virtual is None:
            return 0.0
        return self._virtual.reach

    def _is_virtual_trial(self, row: Row | None) -> bool:
        """Return whether the block of a trial is rendered."""
        return self.virtual and row is not None and row.get(f"{FACTOR}{BLOCK}") != REAL

    def state(self) -> dict[str, object]:
        """Return what a page may show.

        That is no identity or height, and of a virtual block no condition.
        """
        row = self.now
        virtual = self._is_virtual_trial(row)
        state: dict[str, object] = {
            "participant": self.participant,
            "of": len(self.planned),
            "answers": list(self.kind.answers),
            "virtual": virtual,
            "ratings": list(self.ratings),
            "question": self._plan.question,
            "anchors": list(self._plan.anchors),
            "done": row is None,
            "running": self.servo is not None,
            "practice": self.practice,
            "feedback": self.feedback,
            "answered": self.answered,
        }
        if row is None:
            return state
        hidden = {"participant", *self.kind.answers}
        if virtual:
            hidden |= {"setting", "condition", "code"}
        for name, text in make_blinded_row(row).items():
            if name not in hidden:
                state[name] = text
        return state

    def begin(self) -> None:
        """Start the servo loop of a virtual block; one that still runs is ended and begun anew."""
        with self._guard:
            row = self.now
            if row is None or self._virtual is None or not self._is_virtual_trial(row):
                return
            self._virtual.begin(row)
            self._shown = self._clock.read_time()

    def move(self, x: float, held: bool) -> None:
        """Take where the page says that the mouse is [m], and whether it is held."""
        if isinstance(self.hand, Mouse):
            self.hand.update_target(x, held)

    def report_probe_state(self) -> dict[str, object]:
        """Return where the probe is [m], what rings, and what is in doubt."""
        if self._virtual is None:
            return {"x": 0.0, "events": 0, "loudness": 0.0}
        return dict(self._virtual.report_probe_state())

    def end(self) -> None:
        """Stop the servo loop, if one runs."""
        if self._virtual is not None:
            self._virtual.end()

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

        Raises
        ------
        StudyError
            If the trial is not the next, its virtual block was not touched, or the answer cannot
            be read.
        """
        with self._guard:
            row = self.now
            moment = self._clock.read_time()
            if row is None or trial != row["trial"]:
                raise StudyError(f"trial must be the one that is next, got {trial!r}")
            if reaction < 0.0 or reaction > _LONGEST_REACTION:
                raise StudyError(
                    f"reaction_s must be from 0 to {_LONGEST_REACTION:.0f}, got {reaction:g}: "
                    "load the page anew"
                )
            answers = {}
            for name in self.kind.answers:
                answers[name] = _convert_decimal_comma(name, texts.get(name, "").strip())
            values = self._parse_answers(row, answers)
            if self._virtual is not None and self._is_virtual_trial(row):
                self._end_virtual_trial(row, self._virtual)
            if self.practice:
                self.practice -= 1
                self.feedback = _format_feedback(row, values)
            else:
                if math.isnan(reaction):
                    reaction = moment - self._shown
                stamps = [
                    format_timestamp(self._shown),
                    format_timestamp(moment),
                    f"{reaction:.3f}",
                ]
                note = " ".join(comment.split())[:_LONGEST_COMMENT]
                times = dict(zip(TIMES, (*stamps, note), strict=True))
                self._record_answer({**make_blinded_row(row), **answers, **times})
                self.feedback = ""
            self._shown = moment

    def _end_virtual_trial(self, row: Row, virtual: VirtualBlocks) -> None:
        """End the servo loop of a trial, and write its motion; it must have been touched."""
        servo = virtual.servo
        if servo is None or not virtual.is_touched():
            raise StudyError(f"trial {row['trial']} must be touched before it is answered")
        servo.stop()
        if not self.practice:
            path = self.path.with_suffix("") / f"trial-{int(row['trial']):04}.h5"
            attributes: dict[str, object] = {
                name: row[name] for name in (*WHEN, "stimulus", "height_um")
            }
            attributes["scale"] = virtual.scale
            write_motion_file(path, servo, attributes)
        virtual.end()

    def _record_answer(self, row: dict[str, str]) -> None:
        """Write an answered trial to the disk."""
        self._file.write_answered_rows([*self._rows, row])
        self._rows.append(row)
        self._update_trial_order(self._rows)

    def _parse_answers(self, row: Row, answers: Row) -> dict[str, float]:
        """Read the answers to a trial; refuse them in the words of the page, not of the files."""
        try:
            return self.kind.read(row, answers, self.ratings)
        except StudyError as error:
            text = str(error)
            for name, words in _ANSWER_WORDS.items():
                text = text.replace(name, words)
            raise StudyError(text) from error

    def undo(self) -> None:
        """Take the last answer back; its trial is asked again."""
        with self._guard:
            if not self._rows:
                raise StudyError("an answer must be given before it can be taken back, got none")
            self.end()
            self._file.write_answered_rows(self._rows[:-1])
            self._rows.pop()
            self._update_trial_order(self._rows)
            self._shown = self._clock.read_time()

    def close(self) -> None:
        """Release the hand and the run."""
        if self._virtual is not None:
            self._virtual.close()
        self._lock.close()


def _check_answer_is_planned(answer: SheetRow, planned: Row) -> None:
    """Reject an answer of another participant or trial than was planned."""
    for name in ("participant", "trial"):
        if answer.cells[name] != planned[name]:
            raise StudyError(
                f"{name} must be {planned[name]} here, as planned, got {answer.cells[name]} "
                f"[{answer.place}]"
            )


def _format_feedback(row: Row, values: Mapping[str, float]) -> str:
    """Return the feedback after a practice trial; magnitudes have none."""
    height = read_number_or_nan(row["height_um"])
    if "higher" in values:
        is_higher = height > read_number_or_nan(row["standard_height_um"])
        return "right" if bool(values["higher"]) == is_higher else "wrong"
    if "error" in values:
        return f"the step is {height:g} um high"
    return ""


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

    Examples
    --------
    >>> import tempfile
    >>> import stepblocks
    >>> folder = tempfile.mkdtemp()
    >>> design = stepblocks.design_study([20e-6, 50e-6], folder, seed=1)
    >>> run = stepblocks.open_run(folder, "1")
    >>> run.answer("1", {"estimate_um": "35"})
    >>> run.answered
    1
    >>> run.close()
    """
    if not (math.isfinite(scale) and scale > 0.0):
        raise StudyError(f"scale must be positive and finite, got {scale:g}")
    if device != "mouse" and device not in HANDS:
        raise PipelineError(f"device must be one of mouse, {', '.join(HANDS)}, got {device!r}")
    if library and device not in HANDS:
        raise StudyError(f"library is an option of {', '.join(HANDS)}, not of {device}")
    design = read_design(Path(folder) / "design.csv")
    blocks: Blocks | None = None
    hand: Hand | None = None
    if design[0]["experiment"] == "virtual":
        blocks = find_designed_blocks(design, source, felt)
        if device in HANDS:
            hand = HANDS[device](library)
    return Run(
        Path(folder),
        participant,
        design,
        blocks,
        hand,
        scale=scale,
        ratings=ratings,
        practice=practice,
    )
