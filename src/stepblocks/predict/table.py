"""Predict the rows of a table by the equations, with intervals where an uncertainty is given."""

import math
from dataclasses import astuple, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from stepblocks.contact import Array, kernels
from stepblocks.contact.counterface import Step
from stepblocks.contact.domain import require_not_negative
from stepblocks.contact.energy import find_release
from stepblocks.contact.many_intervals import (
    STEP_INPUTS,
    IntervalEnds,
    estimate_step_intervals,
)
from stepblocks.contact.operating_point import PAPER
from stepblocks.errors import ContactError, PipelineError
from stepblocks.files.layout import UNDECLARED, TableLayout, refuse_declared_layout
from stepblocks.files.tables import (
    ColumnRule,
    convert_dataset_to_table,
    load_table,
    read_si_columns,
    warn_of_notes,
    write_table,
)

# of each input: the names of its column, its dimension, and the value where there is no column
_COLUMNS: dict[str, tuple[tuple[str, ...], str, float | None]] = {
    "height": (("height", "step_height"), "length", None),
    "edge_radius": (("edge_radius",), "length", 0.0),
    "ball_radius": (("tip_radius", "ball_radius"), "length", PAPER.ball_radius),
    "friction": (("friction",), "ratio", None),
    "normal_load": (("normal_load", "load"), "force", None),
    "stiffness": (("stiffness",), "stiffness", PAPER.tool.stiffness),
    "conversion": (("conversion",), "ratio", PAPER.tool.conversion),
}
# what an input usually is [SI]: only values beyond are held against the domain of the equations
_USUAL = {
    "height": (1e-9, 1e-2),
    "edge_radius": (0.0, 1e-2),
    "ball_radius": (1e-6, 1e-2),
    "friction": (0.0, 10.0),
    "normal_load": (1e-4, 1e3),
    "stiffness": (1.0, 1e6),
    "conversion": (1e-4, 1.0),
}
_USUAL_UNCERTAINTY = (0.0, 1e12)
_ANY_STEP = Step(1e-5)  # whose dimensions are given anew
_DRAWS = 4000  # of each interval
_FIGURES = (
    "critical_angle_deg",
    "peak_force_n",
    "peak_force_95_low_n",
    "peak_force_95_high_n",
    "vibration_energy_uj",
    "vibration_energy_95_low_uj",
    "vibration_energy_95_high_uj",
    "held_probability",
)
# columns of the result, in their order
_RESULT = (_FIGURES[0], "status", *_FIGURES[1:], "problem")


def predict_table(
    table: pd.DataFrame | str | Path,
    output: str | Path | None = None,
    *,
    layout: TableLayout = UNDECLARED,
) -> pd.DataFrame:
    """Predict each row of a table, with an interval.

    Parameters
    ----------
    table : pandas.DataFrame, str or Path
        Table, CSV or sheet with ``height_um``, ``normal_load_n`` (or ``load_n``), ``friction``
        and, where they differ from the paper, ``edge_radius_um``, ``tip_radius_um``,
        ``stiffness_n_m``, ``conversion``, in any unit that the name of the column says; standard
        uncertainties in columns of the same names with ``u_`` before them.
    output : str or Path, optional
        CSV to write.
    layout : TableLayout
        What is declared of a file: encoding, signs, missing values; the rest is found.

    Returns
    -------
    pandas.DataFrame
        The table with ``critical_angle_deg``, ``status``, ``peak_force_n``, ``vibration_energy_uj``
        and the ends of their 95 % intervals (``peak_force_95_low_n``), ``held_probability`` and
        ``problem``, which says why a row is ``invalid``, as one that lacks a number is; beyond one
        of the limits of docs/explanation/model.md its ``status`` names it, and there is no energy.
        Without an uncertainty both ends are the value itself; with one, equal rows have equal
        intervals.

    Raises
    ------
    PipelineError
        If the table or one of its columns is wrong.
    """
    given: Any = table
    if hasattr(given, "data_vars"):
        table = convert_dataset_to_table(given)
    elif hasattr(given, "to_pandas"):  # of polars or Arrow
        table = given.to_pandas()
    if isinstance(table, pd.DataFrame):
        refuse_declared_layout(layout, "a table in memory", PipelineError)
        frame, columns = table, _read_input_columns(table, "table")
    else:
        path = Path(table)
        read = load_table(path, layout=layout)
        warn_of_notes(read.notes, path)
        frame, columns = read.frame, _read_input_columns(read.frame, read.source)
    predicted = _predict_all_rows(columns, len(frame)).set_index(frame.index)
    kept = [name for name in frame.columns if name not in predicted.columns]
    result = pd.concat([frame[kept], predicted], axis=1)
    if output is not None:
        write_table(result, Path(output))
    return result


def list_input_columns() -> list[str]:
    """Return the names of all columns that a row may be predicted from, in every unit."""
    names: list[str] = []
    for rule in _COLUMNS.values():
        names += ColumnRule(*rule).list_units_by_column()
    return names


def _read_input_columns(frame: pd.DataFrame, place: object) -> dict[str, Array]:
    """Read inputs and their standard uncertainties, ``u_`` before their names [SI]."""
    wanted = dict(_COLUMNS)
    for name, (aliases, dimension, _) in _COLUMNS.items():
        names_of_column = tuple(f"u_{alias}" for alias in aliases)
        wanted[f"u_{name}"] = (names_of_column, dimension, 0.0)
    return read_si_columns(frame, wanted, place, allow_missing=True)


def _predict_all_rows(columns: dict[str, Array], count: int) -> pd.DataFrame:
    """Predict all rows at once; one outside the equations says why it is invalid."""
    result = pd.DataFrame(math.nan, index=range(count), columns=list(_FIGURES))
    problems = _describe_row_problems(columns, count)
    is_sound = problems == ""
    result["status"] = pd.Series("invalid", index=result.index, dtype=object)
    result["problem"] = pd.Series(problems, index=result.index, dtype=object)
    if is_sound.any():
        sound = {name: column[is_sound] for name, column in columns.items()}
        for name, values in _predict_sound_rows(sound).items():
            result.loc[is_sound, name] = values
    return result[list(_RESULT)]


def _describe_row_problems(columns: dict[str, Array], count: int) -> NDArray[np.object_]:
    """Say what is wrong with each row, shape (rows,); an empty text where nothing is."""
    problems = np.full(count, "", dtype=object)
    for name, values in columns.items():
        low, high = _USUAL.get(name, _USUAL_UNCERTAINTY)
        is_open = ~((values >= low) & (values <= high)) & (problems == "")
        if not is_open.any():
            continue
        unusual, places = np.unique(values[is_open], return_inverse=True)
        found = [_describe_value_problem(name, float(value)) for value in unusual]
        problems[is_open] = np.array(found, dtype=object)[places]
    return problems


def _describe_value_problem(input_name: str, value: float) -> str:
    """Say why the equations do not take a value [SI] of an input or its uncertainty."""
    changes: dict[str, Any] = {input_name: value}
    try:
        if input_name in ("height", "edge_radius"):
            replace(_ANY_STEP, **changes)
        elif input_name in ("stiffness", "conversion"):
            replace(PAPER.tool, **changes)
        elif input_name in _COLUMNS:
            replace(PAPER, **changes)
        else:
            require_not_negative(f"uncertainty of {input_name.removeprefix('u_')}", value)
    except ContactError as error:
        return str(error)
    return ""


def _predict_sound_rows(columns: dict[str, Array]) -> dict[str, Array | NDArray[np.str_]]:
    """Predict rows inside the equations, with intervals where a row has an uncertainty."""
    forward, _ = _ANY_STEP.angles(
        columns["ball_radius"], height=columns["height"], edge_radius=columns["edge_radius"]
    )
    angle = np.asarray(forward, dtype=np.float64)
    load, friction = columns["normal_load"], columns["friction"]
    stiffness, conversion = columns["stiffness"], columns["conversion"]
    release = find_release(angle, load, friction, PAPER.tool)
    is_beyond = np.char.startswith(release.status, "beyond-")
    energy = conversion * kernels.compute_stored_energy(release.pull_force, stiffness)
    ends = _compute_interval_ends(columns, angle)
    known_energy = np.where(is_beyond, math.nan, energy)
    known_energy_low = np.where(is_beyond, math.nan, ends.energy_low)
    known_energy_high = np.where(is_beyond, math.nan, ends.energy_high)
    return {
        "critical_angle_deg": np.degrees(angle),
        "status": release.status,
        "peak_force_n": release.pull_force,
        "peak_force_95_low_n": ends.force_low,
        "peak_force_95_high_n": ends.force_high,
        "vibration_energy_uj": 1e6 * known_energy,
        "vibration_energy_95_low_uj": 1e6 * known_energy_low,
        "vibration_energy_95_high_uj": 1e6 * known_energy_high,
        "held_probability": ends.held_probability,
    }


def _compute_interval_ends(columns: dict[str, Array], angle: Array) -> IntervalEnds:
    """Compute the ends of all intervals; both are the value itself where a row is known exactly."""
    inputs = {name: columns[name] for name in STEP_INPUTS}
    limit = PAPER.tool.limits.first.force
    force, energy = kernels.compute_release_force_and_energy(
        angle, inputs["friction"], inputs["normal_load"], inputs["stiffness"], inputs["conversion"]
    )
    is_held = force > limit
    force = np.where(is_held, np.inf, force)
    energy = np.where(is_held, np.inf, energy)
    ends = np.array([force, force, energy, energy, is_held.astype(np.float64)])
    is_uncertain = np.zeros(len(angle), dtype=bool)
    for name in STEP_INPUTS:
        is_uncertain |= columns[f"u_{name}"] > 0.0
    if is_uncertain.any():
        middles, stds = {}, {}
        for name, values in inputs.items():
            middles[name] = values[is_uncertain]
            stds[name] = columns[f"u_{name}"][is_uncertain]
        drawn = estimate_step_intervals(middles, stds, limit, draws=_DRAWS)
        ends[:, is_uncertain] = astuple(drawn)
    return IntervalEnds(*ends)
