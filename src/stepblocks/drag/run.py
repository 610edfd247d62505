"""One drag, from what is dragged over to traces, figures and a summary."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any

import pandas as pd

from stepblocks.contact.counterface import Counterface, Profile
from stepblocks.contact.domain import read_number
from stepblocks.contact.energy import Status
from stepblocks.contact.laws import ContactLaw, FrictionLaw
from stepblocks.contact.operating_point import Limits, Tool
from stepblocks.declaration.read import Sets
from stepblocks.drag.events import drag_face
from stepblocks.drag.figures import draw_forces, draw_spectra, plot_force_with_events
from stepblocks.drag.kernels import COLUMNS
from stepblocks.drag.probe import SETTINGS, Setting
from stepblocks.drag.record import build_drag_record
from stepblocks.drag.result import DragResult
from stepblocks.drag.subject import resolve_subject
from stepblocks.errors import ContactError, PipelineError
from stepblocks.files.atomic import replace_text
from stepblocks.files.figures import Axes, get_or_make_axes
from stepblocks.files.layout import UNDECLARED, TableLayout
from stepblocks.files.tables import write_table
from stepblocks.parts.kind import Part
from stepblocks.quantities import Measure
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
_HANDLE_MASS = 0.1  # of a pulled handle [kg]; assumed
_GUIDE_DAMPING = 20.0  # of a pulled handle [N s/m]; assumed


def _read_quantities_in_si(keywords: Mapping[str, object]) -> dict[str, Any]:
    """Read the keywords of a drag in SI, also texts with units; a law of friction stays one."""
    unknown = [name for name in keywords if name not in _DIMENSIONS]
    if unknown:
        raise PipelineError(
            f"{', '.join(unknown)} must be one of {', '.join(_DIMENSIONS)}, contact, tool, "
            f"x_range{_format_name_suggestion(unknown[0])}"
        )
    values: dict[str, Any] = {}
    for name, value in keywords.items():
        if isinstance(value, FrictionLaw):
            values[name] = value  # the operating point takes it in place of a number
        else:
            values[name] = read_number(name, value, _DIMENSIONS[name] or "ratio")
    return values


def _format_name_suggestion(word: str) -> str:
    """Suggest the keyword that was probably meant; an empty text where none is near."""
    near = get_close_matches(word, _DIMENSIONS, 1)
    if not near:
        return ""
    return f"; did you mean {near[0]}?"


@dataclass(frozen=True, repr=False)
class Drag(DragResult):
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

    def __repr__(self) -> str:
        return (
            f"Drag({self.title!r}, {self.trace.status}, {self.trace.peak_force:.4g} N, "
            f"{len(self.trace.events)} events)"
        )

    def _repr_html_(self) -> str:
        table = self.events.to_html(index=False, float_format="{:.4g}".format)
        return f"<p>{escape(repr(self))}</p>{table}"

    @property
    def frame(self) -> pd.DataFrame:
        """Traces [SI], one column each, its unit in its name."""
        modes = self.trace.rows.shape[1] - len(COLUMNS)
        of_modes = [f"mode_{number}_n" for number in range(1, modes + 1)]
        return pd.DataFrame(self.trace.rows, columns=[*COLUMNS, *of_modes])

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
        axes = plot_force_with_events(self.trace, get_or_make_axes(ax))
        axes.set_xlabel("time [ms]")
        axes.set_title(self.title, fontsize=10)
        return axes

    @cached_property
    def summary(self) -> dict[str, Any]:
        """What ``drag.json`` says of the release that was asked about, units in the names."""
        return build_drag_record(self).to_json()

    def write(self, folder: Path) -> None:
        """Write ``trace.csv``, ``events.csv``, ``drag.json`` and ``force.png``.

        After a release, ``spectra.png`` is written too.
        """
        write_table(self.frame, folder / "trace.csv")
        write_table(self.events, folder / "events.csv")
        draw_forces(self.trace, folder / "force.png", self.title)
        if self.trace.status is Status.RELEASES:
            draw_spectra(self.trace, folder / "spectra.png", self.title)
        summary = json.dumps(self.summary, indent=1, sort_keys=True)
        replace_text(folder / "drag.json", summary + "\n")


def drag_over(
    subject: "Scan | Counterface | Part",
    *,
    backward: bool = False,
    stimuli: Sets | None = None,
    setting: str | None = None,
    x_range: tuple[Measure, Measure] | None = None,
    contact: ContactLaw | None = None,
    tool: Tool | None = None,
    layout: TableLayout = UNDECLARED,
    **values: "Measure | FrictionLaw",
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
    layout : TableLayout
        What is declared of a CSV or another text of numbers.
    **values : float, str, quantity of Pint or FrictionLaw
        What differs from the paper, or from the stimulus's set, in SI or with its unit:
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
    named = _get_named_setting(setting)
    keywords = _read_quantities_in_si(values)
    if named is not None:
        keywords = {"load": named.normal_load, "friction": named.friction} | keywords
    settings = _select_drag_settings(keywords)
    target = resolve_subject(subject, keywords, backward, stimuli, layout)
    chosen_contact = contact or target.point.contact
    chosen_tool = tool or target.point.tool
    point = replace(target.point, contact=chosen_contact, tool=chosen_tool)
    face = target.face
    if x_range is not None:
        if not isinstance(face, Profile):
            raise PipelineError(f"x_range is for a profile; {target.name} has one edge")
        face = Profile(face.x, face.z, x_range)
    changes: dict[str, float] = {}
    if named is not None:
        changes = named.list_probe_changes(point.tool, point.normal_load)
    for name in _OF_PROBE:
        if name in keywords:
            changes[name] = keywords[name]
    try:
        # a drag in time knows no limits: it is held against the equations alone
        unlimited = replace(point, tool=replace(point.tool, limits=Limits()))
        formula = face.release(unlimited, backward)
        trace = drag_face(face, point, backward, settings=settings, probe=changes)
    except ContactError as error:
        if target.place:
            raise PipelineError(f"{error} {target.place}") from error
        raise
    within = None
    if isinstance(face, Profile):
        within = face.feature
    return Drag(
        f"Drag over {target.name}",
        trace,
        formula,
        point.tool,
        named,
        backward=backward,
        within=within,
        ball_radius=point.ball_radius,
    )


def _get_named_setting(setting_name: str | None) -> Setting | None:
    """Find a named setting."""
    if setting_name is None:
        return None
    if setting_name not in SETTINGS:
        raise PipelineError(f"setting must be one of {', '.join(SETTINGS)}, got {setting_name!r}")
    return SETTINGS[setting_name]


def _select_drag_settings(keywords: Mapping[str, float]) -> dict[str, float]:
    """Choose the fields of `DragSettings` from the keywords; a pull moves the handle by a force."""
    if "pull" in keywords and "speed" in keywords:
        raise PipelineError("speed must not be given beside pull, which moves the handle")
    settings = {name: keywords[name] for name in _OF_SETTINGS if name in keywords}
    if keywords.get("pull"):
        settings["speed"] = 0.0
        settings["pulling_force"] = keywords["pull"]
        settings["handle_mass"] = keywords.get("handle_mass", _HANDLE_MASS)
        settings["handle_damping"] = keywords.get("handle_damping", _GUIDE_DAMPING)
    elif "handle_mass" in keywords or "handle_damping" in keywords:
        raise PipelineError("handle_mass and handle_damping are for a handle that a pull moves")
    return settings
