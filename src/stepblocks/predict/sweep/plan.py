"""The plan of a sweep: a TOML file to a table whose rows follow from their numbers alone."""

import hashlib
import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from stepblocks.contact.laws import build_laws
from stepblocks.contact.operating_point import PAPER, SHIPPED_LIMITS, Tool
from stepblocks.contact.uncertainty import convert_half_widths
from stepblocks.declaration.read import load_set
from stepblocks.errors import PipelineError, QuantityError
from stepblocks.files.text import Document, read_document
from stepblocks.mistakes import Mistake, collect_mistakes, find_unknown_names, format_mistakes
from stepblocks.parts.conditions import PredictionGrid
from stepblocks.parts.kind import Part
from stepblocks.predict.predictions import find_half_width, find_zone_middle
from stepblocks.quantities import parse_quantity

# dimensions of a counterface, and the parameters of a sweep that stand for them
SURFACES: dict[str, dict[str, str]] = {
    "step": {"height": "height", "edge_radius": "edge_radius"},
    "margin": {
        "gap": "marginal_gap",
        "rise": "horizontal_discrepancy",
        "opening": "vertical_discrepancy",
    },
}
_GIVEN_OTHERWISE = {
    "tip": "give tips as tip_radius",
    "sheath": "give what a sheath makes of the probe as stiffness",
}
# ways of a drag over a margin; a plan holds their places
DIRECTIONS = (
    "tooth-to-crown",
    "crown-to-tooth",
)
_SQUARE = math.inf  # stands for "as the gap": the end of the crown is square

# each parameter's dimension, and its value where a sweep does not name it (None: it must)
_Parameters = dict[str, tuple[str, float | None]]
_SETTING: _Parameters = {
    "tip_radius": ("length", PAPER.ball_radius),
    "normal_load": ("force", PAPER.normal_load),
    "friction": ("ratio", None),
    "stiffness": ("stiffness", PAPER.tool.stiffness),
    "conversion": ("ratio", PAPER.tool.conversion),
    "speed": ("speed", PAPER.speed),
    "frequency": ("frequency", PAPER.tool.frequency),
    "damping_ratio": ("ratio", PAPER.tool.damping_ratio),
}
PARAMETERS: dict[str, _Parameters] = {
    "step": {"height": ("length", None), "edge_radius": ("length", 0.0), **_SETTING},
    "margin": {
        "marginal_gap": ("length", None),
        "vertical_discrepancy": ("length", _SQUARE),
        "horizontal_discrepancy": ("length", 0.0),
        **_SETTING,
        "direction": ("direction", 0.0),
    },
}


_MOST_ROWS = 10**10
_ROWS_OF_PARTITION = {"static": 100_000, "drag": 1000}  # some ten seconds at most
_MOST_ROWS_OF_PARTITION = 1_000_000  # a worker holds one partition in memory
_MOST_VALUES = 10_000
_LARGEST_FILE = 1_000_000  # bytes


@dataclass(frozen=True)
class SweepPlan:
    """A sweep, resolved."""

    kind: str  # ``"grid"`` or ``"random"``
    mode: str  # ``"static"`` (equations 1 and 2) or ``"drag"`` (in time as well)
    surface: str  # ``"step"`` or ``"margin"``
    points: int  # of the design
    draws: int  # within the tolerances of each point
    seed: int  # every row draws from its own stream, seeded by this and the row's number
    rows_per_partition: int  # of one file of the result
    values: dict[str, list[float]]  # by name: values of a grid, or choices of a random design [SI]
    ranges: dict[str, list[float]]  # by name: low and high of a random design [SI]
    spreads: dict[str, float]  # by name: standard uncertainty of a draw [SI]
    shares: dict[str, float]  # by name: standard uncertainty of a draw as a share of the value [1]
    # of a set that the sweep goes over, see `axes.stimuli_of`; empty without a set
    stimuli: list[Document]
    limits: dict[str, float]  # tangential forces beyond which a tip does not slip, by name [N]
    laws: dict[str, Document]  # as declared, by kind

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
        """Hash of all that the rows and their files depend on, the program's version included."""
        from stepblocks import __version__

        content = json.dumps({**asdict(self), "stepblocks": __version__}, sort_keys=True)
        return hashlib.sha256(content.encode()).hexdigest()


# defaults first
_CHOICES = {
    "kind": ("grid", "random"),
    "mode": ("static", "drag"),
    "surface": ("step", "margin"),
}
_HEAD = (*_CHOICES, "set", "rows", "seed", "rows_per_partition")


def load_sweep(path: Path) -> SweepPlan:
    """Read a sweep from a TOML file."""
    data = read_document(path, "sweep", PipelineError, _LARGEST_FILE)
    mistakes: list[Mistake] = []
    with collect_mistakes(mistakes):
        plan = _resolve_plan(data, path.parent, mistakes)
    PipelineError.require(not mistakes, format_mistakes(mistakes, path))
    return plan


def _resolve_plan(data: Document, folder: Path, mistakes: list[Mistake]) -> SweepPlan:
    # Read all that can be read, noting what is wrong on the way
    mistakes += find_unknown_names(data, ("sweep", "parameters", "draws", "laws"))
    head, parameters, draws, laws = (
        _read_section(data, name) for name in ("sweep", "parameters", "draws", "laws")
    )
    mistakes += find_unknown_names(head, _HEAD, "[sweep]")
    size, points, count = 1, 0, 1
    chosen = dict(head)
    for name, known in _CHOICES.items():
        if chosen.setdefault(name, known[0]) not in known:
            mistakes.append(
                ("", f"{name} must be {known[0]} or {known[1]}, got {chosen[name]!r} [sweep]")
            )
            chosen[name] = known[0]
    kind, mode, surface = (str(chosen[name]) for name in _CHOICES)
    stimuli: list[Document] = []
    declared: dict[str, list[float]] = {}
    spreads: dict[str, float] = {}
    shares: dict[str, float] = {}
    limits = dict(vars(SHIPPED_LIMITS))
    if "set" in head:
        PipelineError.require(
            "surface" not in head,
            "surface must not be given beside set, which says what its stimuli are [sweep]",
        )
        tolerances = draws.get("tolerances", False)
        PipelineError.require(
            isinstance(head["set"], str) and isinstance(tolerances, bool),
            "set must be the path of a stimulus file and tolerances true or false [sweep], [draws]",
        )
        surface, stimuli, grid = read_sweep_stimuli(
            folder / head["set"], parameters.get("stimulus"), tolerances
        )
        laws = (grid.laws or {}) | laws
        # the values of the conditions that a set declares
        declared = {
            "tip_radius": list(grid.tip_radii),
            "normal_load": list(grid.normal_loads),
            "friction": list(grid.frictions),
            "stiffness": [grid.tool.stiffness],
            "conversion": [grid.tool.conversion],
            "frequency": [grid.tool.frequency],
        }
        limits = dict(vars(grid.as_tool().limits))
        if tolerances:
            shares = convert_half_widths(
                {name: width for name, width in grid.tolerances if width > 0.0}
            )
            spreads = {
                name: shares.pop(name)
                for name in ("tip_radius", "friction", "frequency")
                if name in shares
            }
    elif "tolerances" in draws:
        mistakes.append(("[draws]", "tolerances are those of a set: name it with set"))
    names = PARAMETERS[surface]
    taken = (
        set(stimuli[0]["values"]) | {"height", "edge_radius", "vertical_discrepancy"}
        if stimuli
        else set()
    )
    with collect_mistakes(mistakes, "[laws]"):
        build_laws({kind: _read_section(laws, kind) for kind in laws})
    # a law of friction gives the coefficient
    open_names = [name for name in names if name not in {*taken, *laws}]
    mistakes += [
        *find_unknown_names(
            parameters, (*(["stimulus"] if stimuli else []), *open_names), "[parameters]"
        ),
        *find_unknown_names(draws, ("count", "tolerances", *names), "[draws]"),
    ]
    values: dict[str, list[float]] = {}
    ranges: dict[str, list[float]] = {}
    for name in open_names:
        dimension, default = names[name]
        if name in parameters:
            with collect_mistakes(mistakes):
                _read_parameter(name, parameters[name], dimension, kind, values, ranges)
        elif name in declared:
            values[name] = declared[name]
        elif default is None:
            mistakes.append(("[parameters]", f"{name} must be given"))
        elif default != _SQUARE:
            values[name] = [default]
    with collect_mistakes(mistakes):
        points = math.prod(len(v) for v in values.values()) * max(len(stimuli), 1)
        if kind == "random":
            points = _read_count("rows", head.get("rows"), "sweep")
        else:
            PipelineError.require(
                "rows" not in head,
                "rows must not be given for a grid, its axes say how many there are [sweep]",
            )
    with collect_mistakes(mistakes):
        count = _read_count("count", draws.get("count", 1), "draws")
    for name in (name for name in names if name in draws):
        with collect_mistakes(mistakes):
            spreads[name] = _read_quantity(name, draws[name], names[name][0], "draws")
    if any(value < 0.0 for value in spreads.values()):
        mistakes.append(("[draws]", "standard uncertainties must not be negative"))
    given = {*values, *ranges, *parameters}
    mistakes += [
        ("[draws]", f"{name} cannot be drawn about a value that is not given")
        for name in spreads
        if name in {"direction", *laws} or (not stimuli and name not in given)
    ]
    shares = {name: share for name, share in shares.items() if name not in spreads}
    seed = head.get("seed", 0)
    if not isinstance(seed, int) or isinstance(seed, bool) or not 0 <= seed < 2**63:
        mistakes.append(("[sweep]", f"seed must be a whole number of 0 or more, got {seed!r}"))
    if points * count > _MOST_ROWS:
        mistakes.append(
            ("", f"sweep has {points * count} rows and must not have more than {_MOST_ROWS}")
        )
    with collect_mistakes(mistakes):
        size = _read_count(
            "rows_per_partition",
            head.get("rows_per_partition", _ROWS_OF_PARTITION[mode]),
            "sweep",
            _MOST_ROWS_OF_PARTITION,
        )
    return SweepPlan(
        kind,
        mode,
        surface,
        points,
        count,
        seed,
        size,
        values,
        ranges,
        spreads,
        shares,
        stimuli,
        limits,
        laws,
    )


def _read_parameter(
    name: str,
    raw: object,
    dimension: str,
    kind: str,
    values: dict[str, list[float]],
    ranges: dict[str, list[float]],
) -> None:
    # Read a constant, a list, or a range into `values` or `ranges`
    if not isinstance(raw, dict):
        listed = raw if isinstance(raw, list) else [raw]
        PipelineError.require(
            0 < len(listed) <= _MOST_VALUES,
            f"{name} must list 1 to {_MOST_VALUES} values, got {len(listed)} [parameters]",
        )
        values[name] = [_read_quantity(name, item, dimension, "parameters") for item in listed]
    else:
        if unknown := find_unknown_names(raw, ("from", "to", "count")):
            raise PipelineError(f"{name}: {unknown[0][1]} [parameters]")
        PipelineError.require(
            {"from", "to"} <= set(raw), f"{name} must have from and to [parameters]"
        )
        PipelineError.require(
            dimension != "direction",
            f"direction must be {' or '.join(DIRECTIONS)}, or a list of both [parameters]",
        )
        low, high = (
            _read_quantity(name, raw[end], dimension, "parameters") for end in ("from", "to")
        )
        PipelineError.require(low < high, f"{name} must rise from its from to its to [parameters]")
        if kind == "random":
            ranges[name] = [low, high]
        else:
            values[name] = np.linspace(
                low,
                high,
                _read_count(f"count of {name}", raw.get("count"), "parameters", _MOST_VALUES),
            ).tolist()


def _read_quantity(name: str, raw: object, dimension: str, place: str) -> float:
    if dimension == "direction":
        PipelineError.require(
            raw in DIRECTIONS,
            f"direction must be {' or '.join(DIRECTIONS)}, got {raw!r} [{place}]",
        )
        return float(DIRECTIONS.index(raw))
    try:
        return parse_quantity(raw, dimension)
    except QuantityError as error:
        raise PipelineError(f"{name} {error} [{place}]") from error


def _read_count(name: str, raw: object, place: str, most: int = _MOST_ROWS) -> int:
    if not isinstance(raw, int) or isinstance(raw, bool) or not 1 <= raw <= most:
        raise PipelineError(
            f"{name} must be a whole number from 1 to {most}, got {raw!r} [{place}]"
        )
    return raw


def _read_section(data: Document, name: str) -> Document:
    table: Document = data.get(name, {})
    PipelineError.require(isinstance(table, dict), f"{name} must be a table, got {table!r}")
    return table


def read_sweep_stimuli(
    path: Path, identities: object, tolerances: bool
) -> tuple[str, list[Document], PredictionGrid]:
    """Read the stimuli that a sweep goes over."""
    declared = load_set(path)
    known = {part.id: part for part in declared.stimuli}
    if identities is None:
        identities = [part.id for part in declared.stimuli if part.crossed]
    elif (
        not isinstance(identities, list)
        or not identities
        or not all(isinstance(name, str) for name in identities)
    ):
        raise PipelineError(
            f"stimulus must be a list of identities, got {identities!r} [parameters]"
        )
    if missing := [name for name in identities if name not in known]:
        raise PipelineError(f"stimulus must be declared in {path}, got {missing[0]!r} [parameters]")
    chosen = [known[name] for name in identities]
    kinds = {_find_surface(part) for part in chosen}
    if len(kinds) != 1:
        got = ", ".join(sorted(kinds)) or "none"
        raise PipelineError(
            f"stimulus must be of one kind: step blocks, or crown margins; got {got} in {path}"
        )
    (surface,) = kinds
    if surface not in SURFACES:
        instead = _GIVEN_OTHERWISE.get(surface, f"got a {surface}")
        raise PipelineError(f"a sweep goes over blocks or crowns; {instead} [{path}]")
    return (
        surface,
        [
            _read_axis_point(part, SURFACES[surface], tolerances, declared.prediction.as_tool())
            for part in chosen
        ],
        declared.prediction,
    )


def _find_surface(part: Part) -> str:
    # Find the surface whose dimensions a part has
    if not part.crossed:
        return "tip" if part.ball is not None else "sheath"
    return next(
        (name for name, columns in SURFACES.items() if set(part.sizes) <= set(columns)),
        part.kind_name,
    )


def _read_axis_point(part: Part, columns: dict[str, str], tolerances: bool, tool: Tool) -> Document:
    named = {columns[name]: part.sizes[name] for name in columns if name in part.sizes}
    values = {
        name: find_zone_middle(one) if tolerances else one.nominal for name, one in named.items()
    }
    spreads = (
        convert_half_widths({name: find_half_width(one) for name, one in named.items()})
        if tolerances
        else {}
    )
    wall = part.tissue(tool)
    # "face" is what no parameter of a sweep stands for: floor of the gap, sides that a scan shows.
    # "tissue" in N/m, N s/m at 1 Hz, N: the damping falls with the frequency of the ring
    return {
        "id": part.id,
        "values": values,
        "spreads": spreads,
        "face": {
            name: size for name, size in vars(part.counterface()).items() if name not in columns
        },
        "tissue": [wall.stiffness, wall.damping * tool.frequency, wall.friction],
    }
