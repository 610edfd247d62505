"""What is known of the gauges before the trials.

It comes from certificates in session.toml and from the unloaded samples of every trace.
"""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
from pydantic import AfterValidator, BaseModel, BeforeValidator, Field

from stepblocks.atomic import resolve_inside
from stepblocks.bench.session import Frequency, Stiffness, Strict
from stepblocks.errors import PipelineError
from stepblocks.mistakes import validate_data
from stepblocks.quantities import make_quantity_parser
from stepblocks.tables import read_si_columns, read_table

LOAD = "load_bias_n"  # the parameter of a load that is other than set
Known = Mapping[
    str, tuple[float, float]
]  # a parameter of the instrument to its value and standard uncertainty

_Force = Annotated[float, BeforeValidator(make_quantity_parser("force"))]
_Ratio = Annotated[float, BeforeValidator(make_quantity_parser("ratio"))]
_Gain = Annotated[_Ratio, Field(gt=0.0)]
_FEWEST = 5  # traces with unloaded samples
_LEAST_STD = 1e-4  # N, of a zero: a gauge creeps by more between two tares


def _convert_to_logarithm(pair: tuple[float, float]) -> tuple[float, float]:
    value, std = pair
    return float(np.log(value)), std / value


def _convert_to_time_constant(pair: tuple[float, float]) -> tuple[float, float]:
    corner, std = pair
    return 1.0 / (2.0 * np.pi * corner), std / (2.0 * np.pi * corner**2)


_KnownZero = tuple[_Force, Annotated[_Force, Field(gt=0.0)]] | None
_KnownShare = tuple[_Ratio, _Gain] | None
# of gains the law has the logarithm
_KnownGain = Annotated[tuple[_Gain, _Gain], AfterValidator(_convert_to_logarithm)] | None
_KnownBandwidth = (
    Annotated[tuple[Frequency, Frequency], AfterValidator(_convert_to_time_constant)] | None
)


class _Calibration(Strict):
    # Value and standard uncertainty of each constant, by its parameter in the laws; None where it
    # is not known.
    tangential_zero: _KnownZero = Field(default=None, serialization_alias="zero_n")
    normal_zero: _KnownZero = Field(default=None, serialization_alias="normal_zero_n")
    tangential_gain: _KnownGain = Field(default=None, serialization_alias="ln_gain")
    normal_gain: _KnownGain = Field(default=None, serialization_alias="normal_ln_gain")
    cross_talk: _KnownShare = None  # normal force in the tangential gauge
    normal_cross_talk: _KnownShare = None  # tangential force in the normal one
    bandwidth: _KnownBandwidth = Field(default=None, serialization_alias="time_constant_s")
    clock: _KnownGain = Field(default=None, serialization_alias="ln_clock")  # shown over true time
    spring_constant: tuple[Stiffness, Stiffness] | None = (
        None  # with the error of the handle's speed
    )
    load_table: str | None = None  # of the apparatus, ``*.loads.csv`` in the folder of the session


class _Session(BaseModel):
    calibration: _Calibration = _Calibration()


def read_calibration(session: Path) -> dict[str, tuple[float, float]]:
    """Read the optional table ``[calibration]`` of a session.

    All mistakes are listed at once, one a line.
    """
    path = session / "session.toml"
    declared = validate_data(
        _Session, tomllib.loads(path.read_text(encoding="utf-8")), path, PipelineError
    )
    known = declared.calibration.model_dump(by_alias=True, exclude_none=True)
    if table := known.pop("load_table", None):
        known[LOAD] = 0.0, _read_load_std(session, table)
    return known


def _read_load_std(session: Path, name: str) -> float:
    # Largest standard uncertainty of what the weights of an apparatus put on the tip [N]. It is
    # common to all trials.
    path = resolve_inside(session, name)
    if path is None:
        raise PipelineError(
            f"load_table must be a file in the folder of the session, got {name!r} [{session}]"
        )
    table = read_table(path)
    if "axis" not in table or "normal" not in set(table["axis"]):
        raise PipelineError(f"load_table must have a column axis with a row normal [{path}]")
    stds = read_si_columns(
        table[table["axis"] == "normal"], {"std": (("std",), "force", None)}, path
    )["std"]
    return max(float(stds.max()), _LEAST_STD)


def estimate_unloaded_zeros(features: pd.DataFrame) -> dict[str, tuple[float, float]]:
    """Zeros of both gauges from the samples before contact, where traces have such.

    Their spread counts as creep.
    """
    found = {}
    for column, name in (("tangential_zero_n", "zero_n"), ("normal_zero_n", "normal_zero_n")):
        values = features[column].to_numpy(dtype=np.float64) if column in features else np.empty(0)
        values = values[np.isfinite(values)]
        if values.size >= _FEWEST:
            spread = 1.4826 * float(np.median(np.abs(values - np.median(values))))
            found[name] = (float(np.median(values)), max(spread, _LEAST_STD))
    return found
