"""What is known of the gauges before the trials: certificates in session.toml, and the unloaded samples of every trace."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from stepblocks.atomic import inside
from stepblocks.errors import PipelineError
from stepblocks.mistakes import validated
from stepblocks.quantities import quantity_parser
from stepblocks.tables import read_table, si_columns

if TYPE_CHECKING:
    import pandas as pd

LOAD = "load_bias_n"  # the parameter of a load that is other than set
Known = Mapping[str, tuple[float, float]]  # a parameter of the instrument to its value and standard uncertainty

_Force = Annotated[float, BeforeValidator(quantity_parser("force"))]
_Ratio = Annotated[float, BeforeValidator(quantity_parser("ratio"))]
_PositiveForce = Annotated[_Force, Field(gt=0.0)]
_PositiveRatio = Annotated[_Ratio, Field(gt=0.0)]
_FEWEST = 5  # traces with unloaded samples
_LEAST_STD = 1e-4  # N, of a zero: a gauge creeps by more between two tares


class _Calibration(BaseModel):
    """Value and standard uncertainty of each constant; what is not given is not known."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    tangential_zero: tuple[_Force, _PositiveForce] | None = None
    normal_zero: tuple[_Force, _PositiveForce] | None = None
    tangential_gain: tuple[_PositiveRatio, _PositiveRatio] | None = None
    normal_gain: tuple[_PositiveRatio, _PositiveRatio] | None = None
    cross_talk: tuple[_Ratio, _PositiveRatio] | None = None
    load_table: str | None = None  # of the apparatus, ``*.loads.csv`` in the folder of the session


class _Session(BaseModel):
    calibration: _Calibration = _Calibration()


# the parameter of a law of the sensor that each constant is; of gains the law has the logarithm
_PARAMETERS = {
    "tangential_zero": "zero_n",
    "normal_zero": "normal_zero_n",
    "tangential_gain": "ln_gain",
    "normal_gain": "normal_ln_gain",
    "cross_talk": "cross_talk",
}


def read_calibration(session: Path) -> dict[str, tuple[float, float]]:
    """Read the optional table ``[calibration]`` of a session, all mistakes told at once, each in a line."""
    path = session / "session.toml"
    known = validated(_Session, tomllib.loads(path.read_text(encoding="utf-8")), path, PipelineError).calibration
    given = {_PARAMETERS[name]: pair for name, pair in known if name in _PARAMETERS and pair is not None}
    found = {
        name: (float(np.log(value)), std / value) if name.endswith("gain") else (value, std)
        for name, (value, std) in given.items()
    }
    return found if known.load_table is None else found | {LOAD: (0.0, _load_std(session, known.load_table))}


def _load_std(session: Path, name: str) -> float:
    """Largest standard uncertainty of what the weights of an apparatus put on the tip [N]; it is common to all trials."""
    path = inside(session, name)
    if path is None:
        raise PipelineError(f"load_table must be a file in the folder of the session, got {name!r} [{session}]")
    table = read_table(path)
    if "axis" not in table or "normal" not in set(table["axis"]):
        raise PipelineError(f"load_table must have a column axis with a row normal [{path}]")
    stds = si_columns(table[table["axis"] == "normal"], {"std": (("std",), "force", None)}, path)["std"]
    return max(float(stds.max()), _LEAST_STD)


def unloaded_zeros(features: pd.DataFrame) -> dict[str, tuple[float, float]]:
    """Zeros of both gauges from the samples before contact, where traces have such; their spread counts as creep."""
    found = {}
    for column, name in (("tangential_zero_n", "zero_n"), ("normal_zero_n", "normal_zero_n")):
        values = features[column].to_numpy(dtype=np.float64) if column in features else np.empty(0)
        values = values[np.isfinite(values)]
        if values.size >= _FEWEST:
            spread = 1.4826 * float(np.median(np.abs(values - np.median(values))))
            found[name] = (float(np.median(values)), max(spread, _LEAST_STD))
    return found
