"""One drag, from what is dragged over to traces, figures and a summary."""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from difflib import get_close_matches
from functools import cached_property
from html import escape
from pathlib import Path
from typing import cast

import numpy as np
import pandas as pd

from stepblocks.contact.counterface import Counterface, Profile
from stepblocks.contact.domain import read_number
from stepblocks.contact.energy import Release, Status
from stepblocks.contact.kernels import (
    compute_height_at_angle,
    compute_pull_force,
    compute_step_angle,
)
from stepblocks.contact.laws import ContactLaw, FrictionLaw
from stepblocks.contact.operating_point import PAPER, Tool
from stepblocks.declaration.read import Sets
from stepblocks.drag.events import drag_face, list_events
from stepblocks.drag.figures import draw_force, draw_spectra, plot_force
from stepblocks.drag.kernels import COLUMNS
from stepblocks.drag.probe import SETTINGS, Setting
from stepblocks.drag.ring import Ring, measure_ring
from stepblocks.drag.simulate import DragEvent, DragTrace
from stepblocks.drag.subject import resolve_subject
from stepblocks.errors import ContactError, PipelineError
from stepblocks.files.atomic import replace_text
from stepblocks.files.figures import Axes, take_axes
from stepblocks.files.tables import write_table
from stepblocks.files.text import Document
from stepblocks.parts.kind import Part
from stepblocks.quantities import format_quantity
from stepblocks.scans.read import Scan

# What of the probe and of the settings may be given beside the subject, and each dimension
_OF_PROBE = ("damping_ratio", "hardening")
_OF_SETTINGS = {
    "speed": "speed",
    "handle_damping": "",
    "static_friction": "ratio",
    "stribeck_speed": "speed",
    "viscous_friction": "",
    "lead": "length",
    "ring_time": "time",
    "sample_rate": "frequency",
    "resolution": "ratio",
}
_DIMENSIONS = {
    "tip_radius": "length",
    "edge_radius": "length",
    "step_height": "length",
    "load": "force",
    "friction": "ratio",
    "stiffness": "stiffness",
    "frequency": "frequency",
    "damping_ratio": "ratio",
    "hardening": "",
    "pull": "force",
    "handle_mass": "mass",
    **_OF_SETTINGS,
}
_NOTABLE = 2e-3  # of the pull, above which a cause of a difference is named
_GUIDE_DAMPING = 20.0  # of a pulled handle [N s/m]; assumed


def _read_values(given: Mapping[str, object]) -> dict[str, float]:
    # Read the keywords of a drag as numbers in SI; a text with its unit is read too
    unknown = [name for name in given if name not in _DIMENSIONS]
    if unknown:
        near = get_close_matches(unknown[0], _DIMENSIONS, 1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise PipelineError(
            f"{', '.join(unknown)} must be one of {', '.join(_DIMENSIONS)}, contact, tool, "
            f"x_range{hint}"
        )
    return {
        name: cast(float, value)
        if isinstance(value, FrictionLaw)
        else read_number(name, value, _DIMENSIONS[name] or "ratio")
        for name, value in given.items()
    }


@dataclass(frozen=True, repr=False)
class Drag:
    """A drag in time, beside what equation (1) says of it.

    Attributes
    ----------
    title : str
        What was dragged over.
    trace : DragTrace
        Rows, release and energy ledger.
    formula : Release
        Equations (1) and (2) for the same edge.
    tool : Tool
        The spring that rings.
    setting : Setting, optional
        By which the load is carried.
    backward : bool
        Whether towards falling x.
    within : tuple of float, optional
        Range of x that was asked about [m].
    """

    title: str
    trace: DragTrace
    formula: Release
    tool: Tool = PAPER.tool
    setting: Setting | None = None
    backward: bool = False
    within: tuple[float, float] | None = None
    ball_radius: float = PAPER.ball_radius

    def __repr__(self) -> str:
        return (
            f"Drag({self.title!r}, {self.trace.status}, {self.trace.peak_force:.4g} N, "
            f"{len(self.trace.events)} events)"
        )

    def _repr_html_(self) -> str:
        return f"<p>{escape(repr(self))}</p>" + str(
            self.events.to_html(index=False, float_format="{:.4g}".format)
        )

    @cached_property
    def ring(self) -> Ring | None:
        """The vibration after the release that was asked about; None where there was none."""
        return measure_ring(self.trace) if self.trace.status is Status.RELEASES else None

    @cached_property
    def events(self) -> pd.DataFrame:
        """Every place that the tip came to, one row each.

        The columns are the fields of `DragEvent`.
        """
        return pd.DataFrame(
            [asdict(one) for one in list_events(self.trace, self.backward, self.within)],
            columns=[field.name for field in fields(DragEvent)],
        )

    @property
    def frame(self) -> pd.DataFrame:
        """Traces [SI], one column each, its unit in its name."""
        modes = range(1, self.trace.rows.shape[1] - len(COLUMNS) + 1)
        return pd.DataFrame(
            self.trace.rows, columns=[*COLUMNS, *(f"mode_{number}_n" for number in modes)]
        )

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Plot the pull against time with a mark at every event.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Where to; by default new axes.

        Returns
        -------
        matplotlib.axes.Axes
        """
        axes = plot_force(self.trace, take_axes(ax))
        axes.set_xlabel("time [ms]")
        axes.set_title(self.title, fontsize=10)
        return axes

    @cached_property
    def summary(self) -> Document:
        """What ``drag.json`` says of the release that was asked about, units in the names."""
        trace, ring, by = self.trace, self.ring, self.formula
        others = self.events[self.events.belongs_to != "feature"]
        summary: Document = {
            "schema": 1,
            "subject": self.title,
            "status": str(trace.status),
            "ledger_j": trace.ledger,
            "ledger_error": trace.ledger_error,
            "time_step_s": trace.time_step,
            "probe": asdict(trace.probe)
            | {"overtones": [list(one) for one in trace.probe.overtones]},
            "settings": {
                name: repr(one) if isinstance(one, FrictionLaw) else one
                for name, one in vars(trace.settings).items()
                if one is not None
            },
            "tool_frequency_hz": self.tool.frequency,
            "tool_frequency_deviation_hz": self.tool.frequency_deviation,
            "events": json.loads(self.events.to_json(orient="records", double_precision=15)),
            "other_releases": int((others.status == "releases").sum()),
        }
        if trace.reason:
            summary["reason"] = trace.reason
        if self.setting is not None:
            summary["setting"] = asdict(self.setting)
        if len(others):
            # a step of this height has the critical angle of the steepest place of the texture
            angle = float(others.critical_angle_deg.max())
            summary |= {
                "texture_angle_deg": angle,
                "texture_hides_step_m": float(
                    compute_height_at_angle(math.radians(angle), self.ball_radius)
                ),
            }
        if ring is not None:
            summary |= {
                "peak_force_n": trace.peak_force,
                "release_time_s": trace.release_time,
                "stored_energy_j": trace.stored_energy,
                "vibration_energy_j": ring.energy,
                "mode_energies_j": list(ring.mode_energies),
                "ring_share": ring.share,
                "fall_energy_j": ring.fall_energy,
                "ring_duration_s": ring.duration,
                "ring_decay_time_s": None if math.isnan(ring.decay_time) else ring.decay_time,
                "ring_frequency_hz": ring.frequency,
                "loading_share_0_100_hz": ring.loading_share,
                "vibration_share_250_350_hz": ring.ring_band_share,
            }
        if ring is not None and ring.fall_energy > trace.stored_energy:
            summary["reason"] = (
                f"the tip falls behind the edge: the load gives {1e6 * ring.fall_energy:.3g} uJ, "
                f"the spring had stored {1e6 * trace.stored_energy:.3g} uJ"
            )
        if by.status is not Status.NO_CATCH:
            summary["equation_1"] = {"status": str(by.status)}
        if by.status is Status.RELEASES:
            summary["equation_1"] |= {
                "peak_force_n": by.pull_force,
                "vibration_energy_j": by.vibration_energy,
            }
            if ring is not None:
                summary["peak_force_over_equation_1"] = trace.peak_force / by.pull_force
                summary["difference_from_equation_1"] = self._explain_difference()
        return summary

    def _explain_difference(self) -> str:
        # Say how far the pull is from equation (1), and what each cause does to it, to first order
        trace, probe, settings = self.trace, self.trace.probe, self.trace.settings
        pull, angle, load = self.formula.pull_force, self.formula.angle, settings.normal_load
        depth = probe.find_indentation(load)
        pressed = compute_step_angle(
            max(compute_height_at_angle(angle, self.ball_radius) - depth, 0.0), self.ball_radius
        )
        time, hand = trace.column("time_s"), trace.column("handle_m")
        speed = float(np.interp(trace.release_time, time, np.gradient(hand, time)))
        causes = {
            f"the contact gives way by {format_quantity(depth, 'length')}": (
                compute_pull_force(load, pressed + math.atan2(pull, load) - angle, 0.0) - pull
            ),
            f"the handle goes on at {1e3 * speed:.3g} mm/s while the tip gathers speed": (
                speed * math.sqrt(probe.first_stiffness * probe.mass)
            ),
            "the tool rubs along a wall": settings.tissue_friction,
            f"friction is {settings.friction_at_rest:.3g} at rest and {settings.friction:.3g} as "
            "the tip slides, at most": sum(
                compute_pull_force(load, angle, friction) - pull
                for friction in (settings.friction_at_rest, settings.friction)
            ),
        }
        found = [
            f"{cause} ({1e3 * float(size):+.3g} mN)"
            for cause, size in causes.items()
            if abs(size) > _NOTABLE * pull
        ]
        if trace.asked > 0:
            found.append("the tip still swings from the place before")
        return (
            f"equation (1) {pull:.4g} N, the drag {1e3 * (trace.peak_force - pull):+.3g} mN: "
            f"{', '.join(found)}"
        )

    def write(self, folder: Path) -> None:
        """Write ``trace.csv``, ``events.csv``, ``drag.json`` and ``force.png``.

        After a release, ``spectra.png`` is written too.
        """
        write_table(self.frame, folder / "trace.csv")
        write_table(self.events, folder / "events.csv")
        draw_force(self.trace, folder / "force.png", self.title)
        if self.trace.status is Status.RELEASES:
            draw_spectra(self.trace, folder / "spectra.png", self.title)
        replace_text(
            folder / "drag.json", json.dumps(self.summary, indent=1, sort_keys=True) + "\n"
        )


def drag_over(
    subject: "Scan | Counterface | Part",
    *,
    backward: bool = False,
    stimuli: Sets | None = None,
    setting: str | None = None,
    x_range: tuple[float, float] | None = None,
    contact: ContactLaw | None = None,
    tool: Tool | None = None,
    **values: float | str | FrictionLaw,
) -> Drag:
    """Drag a tip over something in time, until it has passed every edge and rung.

    Parameters
    ----------
    subject : str, Path, Counterface, Part, ScannedProfile, DataFrame or pair of arrays
        A step height such as ``"25 um"``; a CSV with the columns x and z, the unit in their names,
        or its table; a profile in a file that `read_scan` reads, or returned; a declared stimulus
        by ``ID``, ``SET/ID`` or ``FILE.toml/ID``; a counterface, or a part that has one; positions
        and heights [m].
    backward : bool
        Towards falling x: from the crown to the tooth, or down a step.
    stimuli : str, Path, StimulusSet or sequence of them, optional
        Where identities are looked up; by default the folder ``stimuli``.
    setting : str, optional
        ``"figures-3-to-5"``: the load carried as those of the paper need it, and its load, friction
        and damping unless given.
    x_range : tuple of float, optional
        Where on a profile the edge lies that is asked about [m]; by default the edge with the
        greatest critical angle answers. All other events stand in `Drag.events` either way.
    contact : ContactLaw, optional
        `Hertz`, `LinearContact` or a law of your own; by default that of the set, or steel on
        steel by Hertz.
    tool : Tool, optional
        Stiffness, frequency (and so its mass) and decay of the explorer, in the place of the set's
        and of `stiffness` and `frequency`.
    **values : float, str or FrictionLaw
        What differs from the paper, or from the stimulus's set, in SI or as a text with its unit:
        `tip_radius`, `edge_radius`, `step_height` [m], `load` [N], `friction` [1] or a law such as
        `Stribeck`, `stiffness` [N/m], `frequency` [Hz], `damping_ratio`, a share of critical
        damping [1] that is else that of the tool's ring; `hardening`, k3 of ``F = k x + k3 x^3``
        [N/m^3]; `pull`, a force [N] on a handle of `handle_mass` [kg] that else moves at constant
        speed; `speed` [m/s], `static_friction` [1], `stribeck_speed` [m/s], `viscous_friction`
        [s/m], `handle_damping` [N s/m], `lead` [m], `ring_time` [s], `sample_rate` [Hz] and
        `resolution` [steps per period].

    Returns
    -------
    Drag
        Traces as a table in `frame`, every catch in `events`, the release that was asked about
        beside equation (1) in `summary`; `write` puts them in a folder.

    Raises
    ------
    PipelineError
        If the subject cannot be understood, a keyword is unknown, or a value is given that the
        subject declares itself.
    ContactError
        If the tip can never climb, if a value makes no sense or needs more steps than can be
        afforded, or if the energy ledger does not close.

    Examples
    --------
    >>> done = drag_over("25 um", load=0.5, speed=20e-3)
    >>> done.summary["status"], done.summary["ledger_error"] < 1e-3
    ('releases', True)
    >>> done.events.belongs_to.tolist()
    ['feature']
    """
    PipelineError.require(
        setting is None or setting in SETTINGS,
        f"setting must be one of {', '.join(SETTINGS)}, got {setting!r}",
    )
    named = SETTINGS[setting] if setting else None
    usual = {"load": named.normal_load, "friction": named.friction} if named else {}
    given = usual | _read_values(values)
    settings = {name: given[name] for name in _OF_SETTINGS if name in given}
    PipelineError.require(
        "pull" not in given or "speed" not in given,
        "speed must not be given beside pull, which moves the handle",
    )
    if pull := given.get("pull"):
        settings |= {
            "speed": 0.0,
            "pulling_force": pull,
            "handle_mass": given.get("handle_mass", 0.1),
            "handle_damping": settings.get("handle_damping", _GUIDE_DAMPING),
        }
    else:
        PipelineError.require(
            not {"handle_mass", "handle_damping"} & set(given),
            "handle_mass and handle_damping are for a handle that a pull moves",
        )
    found = resolve_subject(subject, given, backward, stimuli)
    point, face = found.point, found.face
    point = replace(point, contact=contact or point.contact, tool=tool or point.tool)
    if x_range is not None:
        if not isinstance(face, Profile):
            raise PipelineError(f"x_range is for a profile; {found.name} has one edge")
        face = replace(face, feature=x_range)
    try:
        formula = face.release(point, backward)
        changes = {
            **(named.changes(point.tool, point.normal_load) if named else {}),
            **{name: given[name] for name in _OF_PROBE if name in given},
        }
        trace = drag_face(face, point, backward, settings=settings, probe=changes)
    except ContactError as error:
        raise (PipelineError(f"{error} {found.place}") if found.place else error) from error
    return Drag(
        f"Drag over {found.name}",
        trace,
        formula,
        point.tool,
        named,
        backward=backward,
        within=face.feature if isinstance(face, Profile) else None,
        ball_radius=point.ball_radius,
    )
