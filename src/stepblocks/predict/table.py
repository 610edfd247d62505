"""Predict the rows of a table by the equations, with intervals where an uncertainty is given."""

import math
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from stepblocks.contact import Array, kernels
from stepblocks.contact.counterface import Step
from stepblocks.contact.energy import find_release
from stepblocks.contact.operating_point import PAPER, SHIPPED_LIMITS, OperatingPoint, Tool
from stepblocks.contact.uncertainty import estimate_interval
from stepblocks.errors import ContactError, PipelineError
from stepblocks.files.layout import UNDECLARED, TableLayout, refuse_layout
from stepblocks.files.tables import (
    ColumnRule,
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
# inputs that the equations take only above zero; the others from zero on
_POSITIVE = ("height", "ball_radius", "normal_load", "stiffness", "conversion")
_DRAWS = 4000  # of each interval
_FIGURES = (
    "critical_angle_deg",
    "peak_force_n",
    "peak_force_low_n",
    "peak_force_high_n",
    "vibration_energy_j",
    "vibration_energy_low_j",
    "vibration_energy_high_j",
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
        The table with ``critical_angle_deg``, ``status``, ``peak_force_n``, ``vibration_energy_j``
        and their ends ``_low`` and ``_high``, ``held_probability`` and ``problem``, which says why
        a row is ``invalid``, as one that lacks a number is; beyond one of the limits of
        docs/explanation/model.md its ``status`` names it, and there is no energy. Without an
        uncertainty both ends are the value itself.

    Raises
    ------
    PipelineError
        If the table or one of its columns is wrong.
    """
    if not isinstance(table, pd.DataFrame) and hasattr(table, "to_pandas"):  # polars or Arrow
        table = table.to_pandas()
    if isinstance(table, pd.DataFrame):
        refuse_layout(layout, "a table in memory", PipelineError)
        frame, columns = table, _read_columns(table, "table")
    else:
        path = Path(table)
        read = load_table(path, layout=layout)
        warn_of_notes(read.notes, path)
        frame, columns = read.frame, _read_columns(read.frame, read.source)
    predicted = _predict_rows(columns, len(frame)).set_index(frame.index)
    kept = [name for name in frame.columns if name not in predicted.columns]
    result = pd.concat([frame[kept], predicted], axis=1)
    if output is not None:
        write_table(result, Path(output))
    return result


def list_input_columns() -> list[str]:
    """Return the names of all columns that a row may be predicted from, in every unit."""
    names: list[str] = []
    for rule in _COLUMNS.values():
        names += ColumnRule(*rule).list_columns()
    return names


def _read_columns(frame: pd.DataFrame, place: object) -> dict[str, Array]:
    """Read inputs and their standard uncertainties, ``u_`` before their names [SI]."""
    wanted = dict(_COLUMNS)
    for name, (aliases, dimension, _) in _COLUMNS.items():
        wanted[f"u_{name}"] = (tuple(f"u_{alias}" for alias in aliases), dimension, 0.0)
    return read_si_columns(frame, wanted, place, lets_missing=True)


def _predict_rows(columns: dict[str, Array], count: int) -> pd.DataFrame:
    """Predict all rows: those without uncertainties at once, the others one by one."""
    result = pd.DataFrame(
        {name: np.full(count, math.nan) for name in _FIGURES},
    )
    result["status"] = pd.Series("invalid", index=result.index, dtype=object)
    result["problem"] = pd.Series("", index=result.index, dtype=object)
    is_known = _find_known_rows(columns, count)
    if is_known.any():
        known = {name: column[is_known] for name, column in columns.items()}
        for name, values in _predict_known_rows(known).items():
            result.loc[is_known, name] = values
    for row in np.flatnonzero(~is_known):
        inputs = {name: float(column[row]) for name, column in columns.items()}
        for name, cell in _predict_row(inputs, int(row)).items():
            result.loc[row, name] = cell
    return result[list(_RESULT)]


def _find_known_rows(columns: dict[str, Array], count: int) -> NDArray[np.bool_]:
    """Rows whose inputs are known exactly and lie where the equations hold."""
    is_known = np.ones(count, dtype=bool)
    for name in _COLUMNS:
        values = columns[name]
        if name in _POSITIVE:
            is_known &= np.isfinite(values) & (values > 0.0)
        else:
            is_known &= np.isfinite(values) & (values >= 0.0)
        is_known &= columns[f"u_{name}"] == 0.0
    return is_known


def _predict_known_rows(columns: dict[str, Array]) -> dict[str, Array | NDArray[np.str_]]:
    """Predict rows without uncertainties: both ends of each interval are the value itself."""
    forward, _ = Step(PAPER.ball_radius).angles(
        columns["ball_radius"], height=columns["height"], edge_radius=columns["edge_radius"]
    )
    angle = np.asarray(forward, dtype=np.float64)
    load, friction = columns["normal_load"], columns["friction"]
    stiffness, conversion = columns["stiffness"], columns["conversion"]
    release = find_release(angle, load, friction, Tool(limits=SHIPPED_LIMITS))
    is_beyond = np.char.startswith(release.status, "beyond-")
    energy = conversion * kernels.compute_stored_energy(release.pull_force, stiffness)
    force_end, energy_end = kernels.compute_release(angle, friction, load, stiffness, conversion)
    is_held = force_end > SHIPPED_LIMITS.first[1]
    force_end = np.where(is_held, np.inf, force_end)
    energy_end = np.where(is_beyond, math.nan, np.where(is_held, np.inf, energy_end))
    return {
        "critical_angle_deg": np.degrees(angle),
        "status": release.status,
        "peak_force_n": release.pull_force,
        "peak_force_low_n": force_end,
        "peak_force_high_n": force_end,
        "vibration_energy_j": np.where(is_beyond, math.nan, energy),
        "vibration_energy_low_j": energy_end,
        "vibration_energy_high_j": energy_end,
        "held_probability": is_held.astype(np.float64),
    }


def _predict_row(inputs: dict[str, float], row: int) -> dict[str, float | str]:
    """Predict one row with its interval; a row outside the equations says why it is invalid."""
    uncertainties = {name: inputs[f"u_{name}"] for name in _COLUMNS}
    seed = int(np.random.SeedSequence([0, row]).generate_state(1)[0])  # a stream for each row
    try:
        tool = Tool(inputs["stiffness"], inputs["conversion"], limits=SHIPPED_LIMITS)
        point = OperatingPoint(
            inputs["ball_radius"], inputs["normal_load"], inputs["friction"], tool
        )
        face = Step(inputs["height"], inputs["edge_radius"])
        interval = estimate_interval(face, point, uncertainties, draws=_DRAWS, seed=seed)
        angle = face.angles(point.ball_radius)[0]
    except ContactError as error:
        return {"status": "invalid", "problem": str(error)}
    energy_low, energy_high = interval.energy_low, interval.energy_high
    if interval.status.is_beyond_limit:
        energy_low = energy_high = math.nan
    return {
        "critical_angle_deg": math.degrees(angle),
        "status": str(interval.status),
        "peak_force_n": interval.force,
        "peak_force_low_n": interval.force_low,
        "peak_force_high_n": interval.force_high,
        "vibration_energy_j": interval.energy,
        "vibration_energy_low_j": energy_low,
        "vibration_energy_high_j": energy_high,
        "held_probability": interval.held_probability,
        "problem": "",
    }
