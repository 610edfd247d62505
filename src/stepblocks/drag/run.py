"""One drag, from what is dragged over to traces, figures and a summary."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stepblocks.atomic import replace_text
from stepblocks.contact.counterface import Counterface, Profile, Step
from stepblocks.contact.energy import Release, Status
from stepblocks.contact.operating_point import PAPER, OperatingPoint, Tool
from stepblocks.declare import load_declared
from stepblocks.drag.kernels import COLUMNS
from stepblocks.drag.ring import Ring, draw_force, draw_spectra, measure_ring
from stepblocks.drag.simulate import (
    SETTINGS,
    DragSettings,
    DragTrace,
    Setting,
    build_probe,
    simulate_drag,
)
from stepblocks.drag.track import build_track
from stepblocks.errors import ContactError, PipelineError, QuantityError
from stepblocks.parts.kind import Part
from stepblocks.parts.set import StimulusSet
from stepblocks.quantities import format_quantity, parse_quantity
from stepblocks.select import find_stimulus_files, matches_pattern
from stepblocks.tables import read_si_columns, read_table, write_table
from stepblocks.text_file import format_file_name

if TYPE_CHECKING:
    import pandas as pd

# what may be given beside the subject [SI]: where it goes in an operating point, in its tool, in
# the probe; else in the settings
_OF_POINT = {"tip_radius": "ball_radius", "load": "normal_load", "friction": "friction"}
_OF_TOOL = ("stiffness", "frequency")
_OF_PROBE = ("damping_ratio", "hardening")
_ELSEWHERE = (
    *_OF_POINT,
    *_OF_TOOL,
    *_OF_PROBE,
    "edge_radius",
    "step_height",
    "pull",
    "handle_mass",
)
_WANTED = "stimulus must be a step height such as '25 um', a CSV"
_GUIDE_DAMPING = 20.0  # of a pulled handle [N s/m]; assumed


@dataclass(frozen=True)
class Subject:
    """What is dragged over, and under what."""

    name: str  # for the heading and the summary
    face: Counterface
    point: OperatingPoint
    place: str = ""  # file of a profile, for messages


def resolve_subject(
    given: str | Path | Counterface,
    values: Mapping[str, float],
    backward: bool = False,
    where: Path | None = None,
) -> Subject:
    """Understand what is to be dragged over; `values` [SI] take the place of what the paper or the set says."""
    if isinstance(given, Counterface):
        return Subject("a counterface", given, _changed(PAPER, values))
    if (path := Path(given)).suffix.lower() == ".csv":
        if "edge_radius" in values:
            raise PipelineError(
                f"--edge-radius is for a plain step; a profile has its own [{path}]"
            )
        frame = read_table(path)
        columns = read_si_columns(
            frame, {name: ([name], "length", None) for name in ("x", "z")}, path
        )
        try:
            shape = Profile(columns["x"], columns["z"])
            return Subject(format_file_name(path.name), shape, _changed(PAPER, values), f"[{path}]")
        except ContactError as error:
            raise PipelineError(f"{error} [{path}]") from error
    try:
        height = parse_quantity(str(given), "length")
    except QuantityError:
        return _declared(*_find(str(given), where), values, backward)
    face = Step(height, values.get("edge_radius", 0.0))
    return Subject(f"a step of {format_quantity(height, 'length')}", face, _changed(PAPER, values))


def _declared(
    stimuli: StimulusSet, part: Part, values: Mapping[str, float], backward: bool
) -> Subject:
    """Drag over a part, or with it, under the first tip, load, friction and step of its set unless `values` differ."""
    grid = stimuli.grid_of(part)
    own = {
        "edge_radius": "--edge-radius is for a plain step; a stimulus declares its own",
        "tip_radius": "--tip-radius must not be given for a tip, it declares its own"
        if part.ball is not None
        else "",
        "step_height": "--step-height is for a declared tip; a block declares its own"
        if part.crossed
        else "",
    }
    for name, rule in own.items():
        if rule and name in values:
            raise PipelineError(f"{rule} [{stimuli.name}/{part.id}]")
    ball = grid.tip_radii[0] if part.ball is None else part.ball.nominal
    height = None if part.crossed else values.get("step_height", grid.step_heights[0])
    tool = grid.as_tool()
    if ring := stimuli.ring_of(part):
        tool = ring.as_tool(tool)
    point = OperatingPoint(
        ball, grid.normal_loads[0], grid.frictions[0], tool, tissue=part.tissue(tool)
    )
    face, name = part.counterface(height), part.id
    if height is not None:
        probe = name if part.ball is not None else f"probe in {name}"
        name = f"{probe} over a step of {format_quantity(height, 'length')}"
    elif len(face.ways) > 1:
        name = f"{name}, {face.ways[backward]}"
    return Subject(name, face, _changed(point, values))


def _changed(point: OperatingPoint, values: Mapping[str, float]) -> OperatingPoint:
    of_tool: dict[str, Any] = {name: values[name] for name in _OF_TOOL if name in values}
    moved: dict[str, Any] = {
        field: values[name] for name, field in _OF_POINT.items() if name in values
    }
    return replace(point, tool=replace(point.tool, **of_tool), **moved)


def _find(text: str, where: Path | None) -> tuple[StimulusSet, Part]:
    """Find a stimulus by ``ID``, ``SET/ID`` or ``FILE.toml/ID``."""
    head, _, identity = text.rpartition("/")
    if head.endswith(".toml"):
        files, wanted = [Path(head)], identity
    elif where is None and not Path("stimuli").is_dir():
        raise PipelineError(f"{_WANTED}, or FILE.toml/ID (no folder stimuli here), got {text!r}")
    else:
        files, wanted = find_stimulus_files(where), text
    sets = [load_declared(file) for file in files]
    found = [
        (one, part)
        for one in sets
        for part in one.stimuli
        if matches_pattern(wanted, one.name, part.id)
    ]
    if len(found) > 1:
        names = ", ".join(f"{one.name}/{part.id}" for one, part in found)
        raise PipelineError(f"stimulus must be one, {identity!r} is several: {names}")
    if not found:
        places = ", ".join(map(str, files))
        raise PipelineError(f"{_WANTED}, or declared in {places}, got {text!r}")
    return found[0]


@dataclass(frozen=True)
class Drag:
    """A drag in time, beside what equation (1) says of it."""

    title: str
    trace: DragTrace
    formula: Release
    tool: Tool = PAPER.tool
    setting: Setting | None = None  # by which its load is carried

    @cached_property
    def ring(self) -> Ring | None:
        """The vibration after the release; None where there was none."""
        return measure_ring(self.trace) if self.trace.status is Status.RELEASES else None

    @property
    def frame(self) -> pd.DataFrame:
        """Traces [SI], one column each, its unit in its name."""
        import pandas as pd

        return pd.DataFrame(self.trace.rows, columns=list(COLUMNS))

    @cached_property
    def summary(self) -> dict[str, Any]:
        """What ``drag.json`` says, units in the names."""
        trace, ring = self.trace, self.ring
        told: dict[str, Any] = {
            "subject": self.title,
            "status": str(trace.status),
            "ledger_j": trace.ledger,
            "ledger_error": trace.ledger_error,
            "time_step_s": trace.time_step,
            "probe": asdict(trace.probe),
            "settings": asdict(trace.settings),
            "tool_frequency_hz": self.tool.frequency,
            "tool_frequency_deviation_hz": self.tool.frequency_deviation,
        }
        if self.setting is not None:
            told["setting"] = asdict(self.setting)
        if ring is not None:
            told |= {
                "peak_force_n": trace.peak_force,
                "release_time_s": trace.release_time,
                "stored_energy_j": trace.stored_energy,
                "vibration_energy_j": ring.energy,
                "ring_share": ring.share,
                "ring_duration_s": ring.duration,
                "ring_decay_time_s": None if math.isnan(ring.decay_time) else ring.decay_time,
                "ring_frequency_hz": ring.frequency,
                "loading_share_0_100_hz": ring.loading_share,
                "vibration_share_250_350_hz": ring.ring_band_share,
            }
        by = self.formula
        if by.status is not Status.NO_CATCH:
            told["equation_1"] = {"status": str(by.status)}
        if by.status is Status.RELEASES:
            told["equation_1"] |= {
                "peak_force_n": by.pull_force,
                "vibration_energy_j": by.vibration_energy,
            }
        return told

    def write(self, folder: Path) -> None:
        """Leave ``trace.csv``, ``drag.json``, ``force.png`` and, after a release, ``spectra.png``."""
        folder.mkdir(parents=True, exist_ok=True)
        write_table(self.frame, folder / "trace.csv")
        draw_force(self.trace, folder / "force.png", self.title)
        if self.trace.status is Status.RELEASES:
            draw_spectra(self.trace, folder / "spectra.png", self.title)
        replace_text(
            folder / "drag.json", json.dumps(self.summary, indent=1, sort_keys=True) + "\n"
        )

    def _repr_html_(self) -> str:
        import pandas as pd

        rows = {name: value for name, value in self.summary.items() if not isinstance(value, dict)}
        return str(pd.Series(rows, dtype=object).to_frame().to_html(header=False))


def drag_over(
    subject: str | Path | Counterface,
    *,
    backward: bool = False,
    stimuli: Path | None = None,
    setting: str | None = None,
    **values: float,
) -> Drag:
    """Drag a tip over something in time, until it has slipped and rung.

    Parameters
    ----------
    subject : str, Path or Counterface
        A step height such as ``"25 um"``; a CSV with the columns x and z, the unit in their names;
        a declared stimulus by ``ID``, ``SET/ID`` or ``FILE.toml/ID``; or a counterface, such as a
        part's.
    backward : bool
        Towards falling x: from the crown to the tooth, or down a step.
    stimuli : Path, optional
        Where identities are looked up; by default the folder ``stimuli``.
    setting : str, optional
        ``"figures-3-to-5"``: the load carried as those of the paper need it, and its load, friction
        and damping unless given.
    **values : float
        What differs from the paper, or from the stimulus's set: `tip_radius`, `edge_radius`,
        `step_height` [m], `load` [N], `friction` [1], `stiffness` [N/m], `frequency` [Hz],
        `damping_ratio`, a share of critical damping [1] that is else that of the tool's ring;
        `hardening`, k3 of ``F = k x + k3 x^3`` [N/m^3]; `pull`, a force [N] on a handle of
        `handle_mass` [kg] that else moves at constant speed; fields of `DragSettings`, such as
        `speed` [m/s].

    Returns
    -------
    Drag
        Traces as a table in `frame`, the release beside equation (1) in `summary`; `write` leaves
        them in a folder.

    Raises
    ------
    PipelineError
        If the subject cannot be understood, or a value is given that it declares itself.
    ContactError
        If the tip can never climb, or the settings make no sense or need more steps than can be
        afforded.

    Examples
    --------
    >>> done = drag_over("25 um", load=0.5, speed=20e-3)
    >>> done.summary["status"], done.summary["ledger_error"] < 1e-3
    ('releases', True)
    """
    if setting is not None and setting not in SETTINGS:
        raise PipelineError(f"setting must be one of {', '.join(SETTINGS)}, got {setting!r}")
    named = SETTINGS[setting] if setting else None
    usual = {"load": named.normal_load, "friction": named.friction} if named else {}
    given = usual | values
    settings = {name: value for name, value in given.items() if name not in _ELSEWHERE}
    if pull := given.get("pull"):
        settings |= {
            "speed": 0.0,
            "pulling_force": pull,
            "handle_mass": given.get("handle_mass", 0.1),
        }
        settings["handle_damping"] = _GUIDE_DAMPING
    found = resolve_subject(subject, given, backward, stimuli)
    point = found.point
    try:
        track = build_track(found.face, point.ball_radius, backward)
        formula = found.face.release(point, backward)
    except ContactError as error:
        raise (PipelineError(f"{error} {found.place}") if found.place else error) from error
    changes = named.changes(point.tool, point.normal_load) if named else {}
    changes |= {name: given[name] for name in _OF_PROBE if name in given}
    trace = simulate_drag(
        track,
        build_probe(point.tool, point.ball_radius, **changes),
        DragSettings.under(point, **settings),
    )
    return Drag(f"Drag over {found.name}", trace, formula, point.tool, named)
