"""A sweep as it is asked for: a TOML file to a table of which every row follows from its number alone."""

from __future__ import annotations

import hashlib
import json
import math
import tomllib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from stepblocks.errors import PipelineError, QuantityError
from stepblocks.quantities import parse_quantity

__all__ = ["PARAMETERS", "SweepPlan", "design_row", "load_sweep"]

PARAMETERS: dict[str, tuple[str, float | None]] = {
    "height": ("length", None),
    "edge_radius": ("length", 0.0),
    "tip_radius": ("length", 125e-6),
    "normal_load": ("force", 1.0),
    "friction": ("ratio", None),
    "stiffness": ("stiffness", 9.81e3),
    "conversion": ("ratio", 0.20),
    "speed": ("speed", 5e-3),
    "frequency": ("frequency", 300.0),
    "damping_ratio": ("ratio", 0.02),
}
"""Each parameter's dimension and the value where a sweep does not name it (None: it must)."""

_MOST_ROWS = 10**10
_MOST_VALUES = 10_000
_LARGEST_FILE = 1_000_000  # bytes


@dataclass(frozen=True)
class SweepPlan:
    """A sweep, resolved.

    Attributes
    ----------
    kind : str
        ``"grid"`` or ``"random"``.
    mode : str
        ``"static"`` (equations 1 and 2) or ``"drag"`` (in time as well).
    points : int
        Points of the design.
    draws : int
        Tolerance draws of each point.
    seed : int
        Every row draws from its own stream, seeded by this and the row's number.
    rows_per_partition : int
        Rows of one file of the result.
    values : dict
        Name to the list of values [SI] of a grid, or of the choices of a random design.
    ranges : dict
        Name to (low, high) [SI] of a random design.
    spreads : dict
        Name to the standard uncertainty [SI] of a draw.
    """

    kind: str
    mode: str
    points: int
    draws: int
    seed: int
    rows_per_partition: int
    values: dict[str, list[float]]
    ranges: dict[str, list[float]]
    spreads: dict[str, float]

    @property
    def rows(self) -> int:
        """Number of rows of the result."""
        return self.points * self.draws

    @property
    def partitions(self) -> int:
        """Number of files of the result."""
        return math.ceil(self.rows / self.rows_per_partition)

    @property
    def digest(self) -> str:
        """Hash of everything that the rows and their files depend on."""
        return hashlib.sha256(json.dumps(asdict(self), sort_keys=True).encode()).hexdigest()


def design_row(plan: SweepPlan, row: int) -> dict[str, float]:
    """Draw the inputs [SI] of one row; they depend on the plan and the row's number alone.

    Examples
    --------
    >>> plan = SweepPlan("grid", "static", 2, 1, 0, 10, {"height": [1e-5, 2e-5]}, {}, {})
    >>> design_row(plan, 1)["height"]
    2e-05
    """
    point = row // plan.draws
    inputs: dict[str, float] = {}
    random = np.random.default_rng([plan.seed, point])
    left = point
    for name in PARAMETERS:
        if name in plan.ranges:
            inputs[name] = float(random.uniform(plan.ranges[name][0], plan.ranges[name][1]))
        elif name in plan.values:
            choices = plan.values[name]
            if plan.kind == "grid":
                left, index = divmod(left, len(choices))
            else:
                index = int(random.integers(len(choices)))
            inputs[name] = choices[index]
    if plan.spreads:
        noise = np.random.default_rng([plan.seed, row, 1])
        for name in PARAMETERS:
            if name in plan.spreads:
                inputs[name] = max(inputs[name] + plan.spreads[name] * float(noise.standard_normal()), 0.0)
    return inputs


def load_sweep(path: Path) -> SweepPlan:
    """Read a sweep from a TOML file.

    Parameters
    ----------
    path : Path
        File with the tables ``[sweep]`` (kind, mode, rows, seed, rows_per_partition), ``[parameters]`` and, for
        tolerance draws, ``[draws]`` (count, and standard uncertainties).

    Returns
    -------
    SweepPlan
        Values in SI.

    Raises
    ------
    PipelineError
        If the file cannot be read, or a name, value or number in it is wrong; the message says where.
    """
    try:
        if path.stat().st_size > _LARGEST_FILE:
            raise PipelineError(f"sweep must be smaller than {_LARGEST_FILE} bytes [{path}]")
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise PipelineError(f"sweep cannot be read: {error.strerror} [{path}]") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise PipelineError(f"sweep is not TOML: {error} [{path}]") from error
    try:
        return _resolved(data)
    except (PipelineError, QuantityError) as error:
        raise PipelineError(f"{error} [{path}]") from error


def _resolved(data: dict[str, Any]) -> SweepPlan:
    _known("the file", data, ("sweep", "parameters", "draws"))
    head, parameters = _table(data, "sweep"), _table(data, "parameters")
    draws = _table(data, "draws")
    _known("[sweep]", head, ("kind", "mode", "rows", "seed", "rows_per_partition"))
    _known("[parameters]", parameters, tuple(PARAMETERS))
    _known("[draws]", draws, ("count", *PARAMETERS))
    kind, mode = head.get("kind", "grid"), head.get("mode", "static")
    if kind not in ("grid", "random"):
        raise PipelineError(f"kind must be grid or random, got {kind!r} [sweep]")
    if mode not in ("static", "drag"):
        raise PipelineError(f"mode must be static or drag, got {mode!r} [sweep]")
    values: dict[str, list[float]] = {}
    ranges: dict[str, list[float]] = {}
    for name, (dimension, default) in PARAMETERS.items():
        if name not in parameters:
            if default is None:
                raise PipelineError(f"{name} must be given [parameters]")
            values[name] = [default]
        else:
            _read(name, parameters[name], dimension, kind, values, ranges)
    points = math.prod(len(v) for v in values.values())
    if kind == "random":
        points = _count("rows", head.get("rows"), "sweep")
    elif "rows" in head:
        raise PipelineError("rows must not be given for a grid, its axes say how many there are [sweep]")
    count = _count("count", draws.get("count", 1), "draws")
    spreads = {n: _quantity(n, draws[n], PARAMETERS[n][0], "draws") for n in PARAMETERS if n in draws}
    if any(value < 0.0 for value in spreads.values()):
        raise PipelineError("standard uncertainties must not be negative [draws]")
    seed = head.get("seed", 0)
    if not isinstance(seed, int) or isinstance(seed, bool) or not 0 <= seed < 2**63:
        raise PipelineError(f"seed must be a whole number of 0 or more, got {seed!r} [sweep]")
    if points * count > _MOST_ROWS:
        raise PipelineError(f"sweep has {points * count} rows and must not have more than {_MOST_ROWS}")
    size = _count("rows_per_partition", head.get("rows_per_partition", 1000), "sweep")
    return SweepPlan(kind, mode, points, count, seed, size, values, ranges, spreads)


def _read(
    name: str, given: Any, dimension: str, kind: str, values: dict[str, list[float]], ranges: dict[str, list[float]]
) -> None:
    """Read a constant, a list, or a range into `values` or `ranges`."""
    if isinstance(given, list):
        if not 0 < len(given) <= _MOST_VALUES:
            raise PipelineError(f"{name} must list 1 to {_MOST_VALUES} values, got {len(given)} [parameters]")
        values[name] = [_quantity(name, item, dimension, "parameters") for item in given]
    elif isinstance(given, dict):
        _known(f"{name} [parameters]", given, ("from", "to", "count"))
        if not {"from", "to"} <= set(given):
            raise PipelineError(f"{name} must have from and to [parameters]")
        low, high = (_quantity(name, given[end], dimension, "parameters") for end in ("from", "to"))
        if not low < high:
            raise PipelineError(f"{name} must rise from its from to its to [parameters]")
        if kind == "random":
            ranges[name] = [low, high]
        else:
            count = _count(f"count of {name}", given.get("count"), "parameters", _MOST_VALUES)
            values[name] = [float(v) for v in np.linspace(low, high, count)]
    else:
        values[name] = [_quantity(name, given, dimension, "parameters")]


def _quantity(name: str, given: Any, dimension: str, place: str) -> float:
    try:
        return parse_quantity(given, dimension)
    except QuantityError as error:
        raise PipelineError(f"{name} {error} [{place}]") from error


def _count(name: str, given: Any, place: str, most: int = _MOST_ROWS) -> int:
    if not isinstance(given, int) or isinstance(given, bool) or not 1 <= given <= most:
        raise PipelineError(f"{name} must be a whole number from 1 to {most}, got {given!r} [{place}]")
    return given


def _table(data: dict[str, Any], name: str) -> dict[str, Any]:
    table = data.get(name, {})
    if not isinstance(table, dict):
        raise PipelineError(f"{name} must be a table, got {table!r}")
    return table


def _known(place: str, table: dict[str, Any], names: tuple[str, ...]) -> None:
    for key in table:
        if key not in names:
            raise PipelineError(f"{key!r} is not known in {place}; known are {', '.join(names)}")
