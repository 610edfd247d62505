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
from stepblocks.contact.counterface import Counterface
from stepblocks.contact.energy import Release, Status
from stepblocks.drag.model import DragSettings, probe_for
from stepblocks.drag.ring import Ring, ring_of
from stepblocks.drag.simulate import DragTrace, simulate
from stepblocks.drag.subject import Subject, subject_of
from stepblocks.drag.track import track_over
from stepblocks.errors import ContactError, PipelineError
from stepblocks.tables import write_table

if TYPE_CHECKING:
    import pandas as pd

_OF_SUBJECT = ("tip_radius", "edge_radius", "step_height", "load", "friction", "stiffness", "frequency")
_OF_SETTINGS: tuple[str, ...] = ("static_friction", "ring_time", "sample_rate", "speed")
_GUIDE_DAMPING = 20.0  # of a pulled handle [N s/m]; assumed


@dataclass(frozen=True)
class Drag:
    """A drag in time, beside what equation (1) says of it."""

    title: str
    trace: DragTrace
    formula: Release

    @cached_property
    def ring(self) -> Ring | None:
        """The vibration after the release; None where there was none."""
        return ring_of(self.trace) if self.trace.status is Status.RELEASES else None

    @property
    def frame(self) -> pd.DataFrame:
        """Traces [SI], one column each, its unit in its name."""
        return self.trace.frame

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
        }
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
        if self.formula.status is not Status.NO_CATCH:
            told["equation_1"] = {"status": str(self.formula.status)}
        if self.formula.status is Status.RELEASES:
            told["equation_1"] |= {
                "peak_force_n": self.formula.pull_force,
                "vibration_energy_j": self.formula.vibration_energy,
            }
        return told

    def write(self, folder: Path) -> None:
        """Leave ``trace.csv``, ``drag.json``, ``force.png`` and, after a release, ``spectra.png``."""
        from stepblocks.drag.figures import draw_force, draw_spectra

        folder.mkdir(parents=True, exist_ok=True)
        write_table(self.frame, folder / "trace.csv")
        draw_force(self.trace, folder / "force.png", self.title)
        if self.trace.status is Status.RELEASES:
            draw_spectra(self.trace, folder / "spectra.png", self.title)
        replace_text(folder / "drag.json", json.dumps(self.summary, indent=1, sort_keys=True) + "\n")

    def _repr_html_(self) -> str:
        from html import escape

        rows = {name: value for name, value in self.summary.items() if not isinstance(value, dict)}
        cells = "".join(
            f"<tr><th>{escape(name)}</th><td>{escape(str(value))}</td></tr>" for name, value in rows.items()
        )
        return f"<table>{cells}</table>"


def drag_over(
    subject: str | Path | Counterface | Subject,
    values: Mapping[str, float] | None = None,
    *,
    backward: bool = False,
    stimuli: Path | None = None,
    damping_ratio: float | None = None,
    **settings: float,
) -> Drag:
    """Drag a tip over something in time, until it has slipped and rung.

    Parameters
    ----------
    subject : str, Path or Counterface
        A step height such as ``"25 um"``; a CSV with the columns x and z, the unit in their names; a declared stimulus by
        ``ID``, ``SET/ID`` or ``FILE.toml/ID``; or a counterface, such as a part's.
    values : mapping of str to float, optional
        What differs from the paper, or from the stimulus's set: `tip_radius`, `edge_radius`, `step_height` [m], `load` [N],
        `friction` [1], `stiffness` [N/m], `frequency` [Hz].
    backward : bool
        Towards falling x: from the crown to the tooth, or down a step.
    stimuli : Path, optional
        Stimulus file or folder in which identities are looked up; by default the folder ``stimuli``.
    damping_ratio : float, optional
        Share of critical damping [1]; by default from the decay of the tool's ring.
    **settings : float
        Fields of `DragSettings`, such as `speed` [m/s], `pulling_force` [N] or `ring_time` [s].

    Returns
    -------
    Drag
        Traces as a table in `frame`, the release beside equation (1) in `summary`; `write` leaves them in a folder.

    Raises
    ------
    PipelineError
        If the subject cannot be understood, or a value is given that it declares itself.
    ContactError
        If the tip can never climb, or the settings make no sense or need more steps than can be afforded.

    Examples
    --------
    >>> done = drag_over("25 um", {"load": 0.5}, speed=20e-3)
    >>> done.summary["status"], done.summary["ledger_error"] < 1e-3
    ('releases', True)
    """
    found = subject if isinstance(subject, Subject) else subject_of(subject, values or {}, backward, stimuli)
    point = found.point
    try:
        track = track_over(found.face, point.ball_radius, found.backward)
        formula = found.face.release(point, found.backward)
    except ContactError as error:
        raise (PipelineError(f"{error} {found.place}") if found.place else error) from error
    probe = probe_for(point.tool, point.ball_radius)
    if damping_ratio is not None:
        probe = replace(probe, damping_ratio=damping_ratio)
    trace = simulate(track, probe, DragSettings.under(point, **settings))
    return Drag(f"Drag over {found.name}", trace, formula)


def drag_from_options(
    stimulus: str, given: dict[str, float], backward: bool, folder: Path, where: Path | None = None
) -> dict[str, Any]:
    """Run a drag by the options of the command line, write its folder and return its summary."""
    settings = {name: given[name] for name in _OF_SETTINGS if name in given}
    if pull := given.get("pull"):
        settings |= {"speed": 0.0, "pulling_force": pull, "handle_mass": given["handle_mass"]}
        settings["handle_damping"] = _GUIDE_DAMPING
    done = drag_over(
        stimulus,
        {name: given[name] for name in _OF_SUBJECT if name in given},
        backward=backward,
        stimuli=where,
        damping_ratio=given.get("damping_ratio"),
        **settings,
    )
    done.write(folder)
    return done.summary
