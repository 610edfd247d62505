"""Predict a table of trials or blocks, one row each, with intervals."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stepblocks.contact.counterface import Step
from stepblocks.contact.operating_point import PAPER, SHIPPED_LIMITS, OperatingPoint, Tool
from stepblocks.contact.uncertainty import interval_of
from stepblocks.errors import ContactError
from stepblocks.tables import read_table, si_columns, write_table

if TYPE_CHECKING:
    import pandas as pd

_COLUMNS: dict[str, tuple[tuple[str, ...], str, float | None]] = {
    "height": (("height", "step_height"), "length", None),
    "edge_radius": (("edge_radius",), "length", 0.0),
    "ball_radius": (("tip_radius", "ball_radius"), "length", PAPER.ball_radius),
    "friction": (("friction",), "ratio", None),
    "normal_load": (("normal_load", "load"), "force", None),
    "stiffness": (("stiffness",), "stiffness", PAPER.tool.stiffness),
    "conversion": (("conversion",), "ratio", PAPER.tool.conversion),
}
_DRAWS = 4000  # of each interval


def predict_table(table: pd.DataFrame | str | Path, output: str | Path | None = None) -> pd.DataFrame:
    """Predict each row of a table, with an interval.

    Parameters
    ----------
    table : pandas.DataFrame, str or Path
        Table or CSV with ``height_um``, ``normal_load_n`` (or ``load_n``), ``friction`` and, where they differ from the
        paper, ``edge_radius_um``, ``tip_radius_um``, ``stiffness_n_m``, ``conversion``, in any unit that the name of the
        column says; standard uncertainties in columns of the same names with ``u_`` before them.
    output : str or Path, optional
        CSV to write.

    Returns
    -------
    pandas.DataFrame
        The table with ``critical_angle_deg``, ``status``, ``peak_force_n``, ``vibration_energy_j`` and their ends ``_low``
        and ``_high``, ``held_probability`` and ``problem``, which says why a row is ``invalid``; beyond one of the limits
        of docs/model.md its ``status`` names it, and there is no energy.
    """
    import numpy as np
    import pandas as pd

    place = "table" if isinstance(table, pd.DataFrame) else Path(table)
    frame = table if isinstance(table, pd.DataFrame) else read_table(Path(table))
    uncertain = {f"u_{name}": ([f"u_{n}" for n in names], of, 0.0) for name, (names, of, _) in _COLUMNS.items()}
    columns = si_columns(frame, {**_COLUMNS, **uncertain}, place)
    rows: list[dict[str, Any]] = []
    for k in range(len(frame)):
        at = {name: float(columns[name][k]) for name in _COLUMNS}
        spread = {name: float(columns[f"u_{name}"][k]) for name in _COLUMNS}
        stream = int(np.random.SeedSequence([0, k]).generate_state(1)[0])
        try:
            tool = Tool(at["stiffness"], at["conversion"], limits=SHIPPED_LIMITS)
            point = OperatingPoint(at["ball_radius"], at["normal_load"], at["friction"], tool)
            face = Step(at["height"], at["edge_radius"])
            interval = interval_of(face, point, spread, draws=_DRAWS, seed=stream)
            angle = face.angles(point.ball_radius)[0]
        except ContactError as error:
            rows.append({"status": "invalid", "problem": str(error)})
            continue
        rows.append(
            {
                "critical_angle_deg": math.degrees(angle),
                "status": str(interval.status),
                "peak_force_n": interval.force,
                "peak_force_low_n": interval.force_low,
                "peak_force_high_n": interval.force_high,
                "vibration_energy_j": interval.energy,
                "vibration_energy_low_j": math.nan if interval.status.beyond else interval.energy_low,
                "vibration_energy_high_j": math.nan if interval.status.beyond else interval.energy_high,
                "held_probability": interval.held_probability,
                "problem": "",
            }
        )
    added = pd.DataFrame(rows, index=frame.index)
    result = pd.concat([frame.drop(columns=[c for c in added.columns if c in frame.columns]), added], axis=1)
    if output is not None:
        write_table(result, Path(output))
    return result
