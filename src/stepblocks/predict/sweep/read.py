"""Read the plan of a sweep from a TOML file; all mistakes of the file are reported at once."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stepblocks.contact.laws import build_declared_laws
from stepblocks.contact.operating_point import PAPER, Tool
from stepblocks.contact.uncertainty import convert_half_widths_to_stds
from stepblocks.declaration.read import load_set
from stepblocks.errors import PipelineError, QuantityError
from stepblocks.files.text import read_document
from stepblocks.mistakes import Mistake, collect_mistakes, format_mistakes, list_unknown_names
from stepblocks.parts.conditions import PredictionGrid
from stepblocks.parts.kind import Part
from stepblocks.predict.predictions import compute_zone_half_width, compute_zone_middle
from stepblocks.predict.sweep.plan import (
    DIRECTIONS,
    PARAMETERS,
    SQUARE,
    SURFACES,
    SweepPlan,
    SweepStimulus,
)
from stepblocks.quantities import parse_quantity

Section = Mapping[str, object]

# what a sweep may be, defaults first
_CHOICES = {
    "kind": ("grid", "random"),
    "mode": ("static", "drag"),
    "surface": ("step", "margin"),
}
_HEAD = (*_CHOICES, "set", "rows", "seed", "rows_per_partition")
_GIVEN_OTHERWISE = {
    "tip": "give tips as tip_radius",
    "sheath": "give what a sheath makes of the probe as stiffness",
}
_MOST_ROWS = 10**10
_ROWS_OF_PARTITION = {"static": 100_000, "drag": 1000}  # some ten seconds at most
_MOST_ROWS_OF_PARTITION = 1_000_000  # a worker holds one partition in memory
_MOST_VALUES = 10_000
_LARGEST_FILE = 1_000_000  # bytes
_LARGEST_SEED = 2**63


def load_sweep(path: Path) -> SweepPlan:
    """Read a sweep from a TOML file."""
    document = read_document(path, "sweep", PipelineError, _LARGEST_FILE)
    mistakes: list[Mistake] = []
    plan = None
    with collect_mistakes(mistakes):
        plan = _PlanReader(document, path.parent, mistakes).read_plan()
    if mistakes or plan is None:
        raise PipelineError(format_mistakes(mistakes, path))
    return plan


@dataclass
class _PlanReader:
    """Reads all that can be read of a plan and notes what is wrong on the way.

    What the file says stands in `head`, `parameters`, `draws` and `laws`; what is resolved so far
    in the other fields.
    """

    document: Section
    folder: Path  # of the plan's file, from which the path of a set counts
    mistakes: list[Mistake]
    head: Section = field(default_factory=dict)
    parameters: Section = field(default_factory=dict)
    draws: Section = field(default_factory=dict)
    laws: dict[str, Section] = field(default_factory=dict)
    kind: str = ""
    mode: str = ""
    surface: str = ""
    stimuli: list[SweepStimulus] = field(default_factory=list)
    # values of the conditions that a set declares, by parameter [SI]
    declared: dict[str, list[float]] = field(default_factory=dict)
    values: dict[str, list[float]] = field(default_factory=dict)
    ranges: dict[str, list[float]] = field(default_factory=dict)
    spreads: dict[str, float] = field(default_factory=dict)
    shares: dict[str, float] = field(default_factory=dict)
    limits: dict[str, float] = field(default_factory=lambda: dict(vars(PAPER.tool.limits)))

    def read_plan(self) -> SweepPlan:
        """Read section after section; the plan is not usable where a mistake was noted."""
        self._read_sections()
        self._read_choices()
        if "set" in self.head:
            self._take_over_set()
        elif "tolerances" in self.draws:
            self._note_mistake("[draws]", "tolerances are those of a set: name it with set")
        open_names = self._list_open_parameters()
        self._read_parameters(open_names)
        points = self._count_points()
        count = self._read_draw_count()
        self._read_spreads()
        seed = self._read_seed()
        if points * count > _MOST_ROWS:
            self._note_mistake(
                "", f"sweep has {points * count} rows and must not have more than {_MOST_ROWS}"
            )
        return SweepPlan(
            kind=self.kind,
            mode=self.mode,
            surface=self.surface,
            points=points,
            draws=count,
            seed=seed,
            rows_per_partition=self._read_rows_per_partition(),
            values=self.values,
            ranges=self.ranges,
            spreads=self.spreads,
            shares=self.shares,
            stimuli=self.stimuli,
            limits=self.limits,
            laws=dict(self.laws),
        )

    def _note_mistake(self, place: str, rule: str) -> None:
        """Note a mistake and go on."""
        self.mistakes.append((place, rule))

    def _read_sections(self) -> None:
        """Take the sections apart and refuse names that none has."""
        self.mistakes += list_unknown_names(self.document, ("sweep", "parameters", "draws", "laws"))
        self.head = _get_section(self.document, "sweep")
        self.parameters = _get_section(self.document, "parameters")
        self.draws = _get_section(self.document, "draws")
        declared_laws = _get_section(self.document, "laws")
        self.mistakes += list_unknown_names(self.head, _HEAD, "[sweep]")
        self.laws = declared_laws  # type: ignore[assignment]  # each is checked where it is built

    def _read_choices(self) -> None:
        """Read kind, mode and surface; a wrong one is noted and counts as the default."""
        chosen = {}
        for name, known in _CHOICES.items():
            choice = self.head.get(name, known[0])
            if choice not in known:
                self._note_mistake(
                    "", f"{name} must be {known[0]} or {known[1]}, got {choice!r} [sweep]"
                )
                choice = known[0]
            chosen[name] = str(choice)
        self.kind = chosen["kind"]
        self.mode = chosen["mode"]
        self.surface = chosen["surface"]

    def _take_over_set(self) -> None:
        """Take stimuli, conditions, limits, laws and tolerances from the set that is named."""
        if "surface" in self.head:
            raise PipelineError(
                "surface must not be given beside set, which says what its stimuli are [sweep]"
            )
        name = self.head["set"]
        with_tolerances = self.draws.get("tolerances", False)
        if not isinstance(name, str) or not isinstance(with_tolerances, bool):
            raise PipelineError(
                "set must be the path of a stimulus file and tolerances true or false "
                "[sweep], [draws]"
            )
        swept = read_swept_set(self.folder / name, self.parameters.get("stimulus"), with_tolerances)
        self.surface, self.stimuli, grid = swept
        self.laws = (grid.laws or {}) | self.laws
        self.declared = {
            "tip_radius": list(grid.tip_radii),
            "normal_load": list(grid.normal_loads),
            "friction": list(grid.frictions),
            "stiffness": [grid.tool.stiffness],
            "conversion": [grid.tool.conversion],
            "frequency": [grid.tool.frequency],
        }
        self.limits = dict(vars(grid.as_tool().limits))
        if with_tolerances:
            self._read_setting_tolerances(grid)

    def _read_setting_tolerances(self, grid: PredictionGrid) -> None:
        """Take the tolerances of the setting: some are widths, some shares of the value."""
        half_widths = {name: width for name, width in grid.tolerances if width > 0.0}
        self.shares = convert_half_widths_to_stds(half_widths)
        for name in ("tip_radius", "friction", "frequency"):
            if name in self.shares:
                self.spreads[name] = self.shares.pop(name)

    def _list_open_parameters(self) -> list[str]:
        """List the parameters that the plan gives: neither the stimuli nor a law give them.

        Names that the plan should not have are added to the mistakes.
        """
        names = PARAMETERS[self.surface]
        taken: set[str] = set()
        if self.stimuli:
            dimensions = {"height", "edge_radius", "vertical_discrepancy"}
            taken = set(self.stimuli[0].values) | dimensions
        with collect_mistakes(self.mistakes, "[laws]"):
            sections = {kind: _get_section(self.laws, kind) for kind in self.laws}
            build_declared_laws(sections)
        # a law of friction gives the coefficient
        open_names = [name for name in names if name not in {*taken, *self.laws}]
        known = [*open_names]
        if self.stimuli:
            known.insert(0, "stimulus")
        self.mistakes += list_unknown_names(self.parameters, known, "[parameters]")
        self.mistakes += list_unknown_names(self.draws, ("count", "tolerances", *names), "[draws]")
        return open_names

    def _read_parameters(self, open_names: list[str]) -> None:
        """Read each parameter from the plan, the set, or its default."""
        for name in open_names:
            dimension, default = PARAMETERS[self.surface][name]
            if name in self.parameters:
                with collect_mistakes(self.mistakes):
                    self._read_parameter(name, dimension)
            elif name in self.declared:
                self.values[name] = self.declared[name]
            elif default is None:
                self._note_mistake("[parameters]", f"{name} must be given")
            elif default != SQUARE:
                self.values[name] = [default]

    def _read_parameter(self, name: str, dimension: str) -> None:
        """Read a constant, a list, or a range."""
        raw = self.parameters[name]
        if isinstance(raw, dict):
            self._read_range(name, raw, dimension)
            return
        listed = [raw]
        if isinstance(raw, list):
            listed = raw
        if not 0 < len(listed) <= _MOST_VALUES:
            raise PipelineError(
                f"{name} must list 1 to {_MOST_VALUES} values, got {len(listed)} [parameters]"
            )
        values = []
        for item in listed:
            values.append(_read_quantity(name, item, dimension, "parameters"))
        self.values[name] = values

    def _read_range(self, name: str, raw: Section, dimension: str) -> None:
        """Read a range: drawn from in a random design, divided evenly in a grid."""
        unknown = list_unknown_names(raw, ("from", "to", "count"))
        if unknown:
            raise PipelineError(f"{name}: {unknown[0][1]} [parameters]")
        if "from" not in raw or "to" not in raw:
            raise PipelineError(f"{name} must have from and to [parameters]")
        if dimension == "direction":
            raise PipelineError(
                f"direction must be {' or '.join(DIRECTIONS)}, or a list of both [parameters]"
            )
        low = _read_quantity(name, raw["from"], dimension, "parameters")
        high = _read_quantity(name, raw["to"], dimension, "parameters")
        if not low < high:
            raise PipelineError(f"{name} must rise from its from to its to [parameters]")
        if self.kind == "random":
            self.ranges[name] = [low, high]
            return
        count = _read_count(f"count of {name}", raw.get("count"), "parameters", _MOST_VALUES)
        self.values[name] = np.linspace(low, high, count).tolist()

    def _count_points(self) -> int:
        """Count the points of the design: of a grid by its axes, else as the plan says."""
        axes = [len(values) for values in self.values.values()]
        points = math.prod(axes) * max(len(self.stimuli), 1)
        with collect_mistakes(self.mistakes):
            if self.kind == "random":
                points = _read_count("rows", self.head.get("rows"), "sweep")
            elif "rows" in self.head:
                raise PipelineError(
                    "rows must not be given for a grid, its axes say how many there are [sweep]"
                )
        return points

    def _read_draw_count(self) -> int:
        """Read the number of draws within the tolerances of each point."""
        count = 1
        with collect_mistakes(self.mistakes):
            count = _read_count("count", self.draws.get("count", 1), "draws")
        return count

    def _read_spreads(self) -> None:
        """Read the standard uncertainties of what is drawn; they replace those of the set."""
        names = PARAMETERS[self.surface]
        for name, (dimension, _) in names.items():
            if name in self.draws:
                with collect_mistakes(self.mistakes):
                    self.spreads[name] = _read_quantity(name, self.draws[name], dimension, "draws")
        if any(spread < 0.0 for spread in self.spreads.values()):
            self._note_mistake("[draws]", "standard uncertainties must not be negative")
        for name in self.spreads:
            self.shares.pop(name, None)
            if not self._is_parameter_drawable(name):
                self._note_mistake(
                    "[draws]", f"{name} cannot be drawn about a value that is not given"
                )

    def _is_parameter_drawable(self, parameter: str) -> bool:
        """Tell whether a parameter has a value, and one that is a number, to draw about."""
        if parameter == "direction" or parameter in self.laws:
            return False
        has_value = (
            parameter in self.values or parameter in self.ranges or parameter in self.parameters
        )
        return bool(self.stimuli) or has_value

    def _read_seed(self) -> int:
        """Read the seed of all draws."""
        seed = self.head.get("seed", 0)
        is_whole = isinstance(seed, int) and not isinstance(seed, bool)
        if not is_whole or not 0 <= seed < _LARGEST_SEED:  # type: ignore[operator]
            self._note_mistake("[sweep]", f"seed must be a whole number of 0 or more, got {seed!r}")
            return 0
        return seed  # type: ignore[return-value]

    def _read_rows_per_partition(self) -> int:
        """Read the number of rows in one file of the result."""
        declared = self.head.get("rows_per_partition", _ROWS_OF_PARTITION[self.mode])
        size = 1
        with collect_mistakes(self.mistakes):
            size = _read_count("rows_per_partition", declared, "sweep", _MOST_ROWS_OF_PARTITION)
        return size


def _get_section(document: Section, name: str) -> dict[str, object]:
    """Take a table of a document by its name; empty where it has none."""
    table = document.get(name, {})
    if not isinstance(table, dict):
        raise PipelineError(f"{name} must be a table, got {table!r}")
    return table


def _read_quantity(name: str, raw: object, dimension: str, place: str) -> float:
    """Read a quantity [SI], or a direction as its place in `DIRECTIONS`."""
    if dimension == "direction":
        if raw not in DIRECTIONS:
            raise PipelineError(
                f"direction must be {' or '.join(DIRECTIONS)}, got {raw!r} [{place}]"
            )
        return float(DIRECTIONS.index(raw))
    try:
        return parse_quantity(raw, dimension)
    except QuantityError as error:
        raise PipelineError(f"{name} {error} [{place}]") from error


def _read_count(name: str, raw: object, place: str, most: int = _MOST_ROWS) -> int:
    """Read a whole number from 1 to `most`."""
    if not isinstance(raw, int) or isinstance(raw, bool) or not 1 <= raw <= most:
        raise PipelineError(
            f"{name} must be a whole number from 1 to {most}, got {raw!r} [{place}]"
        )
    return raw


class SweptSet(NamedTuple):
    """What a sweep goes over.

    Attributes
    ----------
    surface : str
        Kind of surface that all stimuli have, a key of `SURFACES`.
    stimuli : list of SweepStimulus
    setting : PredictionGrid
        Tool, loads and frictions that their set declares.
    """

    surface: str
    stimuli: list[SweepStimulus]
    setting: PredictionGrid


def read_swept_set(set_path: Path, part_ids: object, with_tolerances: bool) -> SweptSet:
    """Read the stimuli of a set that a sweep goes over.

    Parameters
    ----------
    set_path : Path
        File of the set.
    part_ids : object
        Which parts, a list of ids as it stands in the file of the sweep; None for all that a tip
        crosses.
    with_tolerances : bool
        Whether the sizes vary within their limits.
    """
    declared = load_set(set_path)
    known = {part.id: part for part in declared.stimuli}
    parts = _choose_parts_by_id(known, part_ids, set_path)
    surface = _find_common_surface(parts, set_path)
    tool = declared.prediction.as_tool()
    stimuli = [_make_sweep_stimulus(part, surface, with_tolerances, tool) for part in parts]
    return SweptSet(surface, stimuli, declared.prediction)


def _choose_parts_by_id(
    parts_by_id: Mapping[str, Part], identities: object, path: Path
) -> list[Part]:
    """Choose parts of a set by their identities; None for all that a tip crosses."""
    if identities is None:
        return [part for part in parts_by_id.values() if part.crossed]
    refusal = f"stimulus must be a list of identities, got {identities!r} [parameters]"
    if not isinstance(identities, list) or not identities:
        raise PipelineError(refusal)
    if not all(isinstance(name, str) for name in identities):
        raise PipelineError(refusal)
    parts = []
    for name in identities:
        if name not in parts_by_id:
            raise PipelineError(f"stimulus must be declared in {path}, got {name!r} [parameters]")
        parts.append(parts_by_id[name])
    return parts


def _find_common_surface(parts: list[Part], path: Path) -> str:
    """Find the surface that all parts have; several, or one of another kind, are refused."""
    surfaces = set(map(_get_surface_or_kind, parts))
    if len(surfaces) != 1:
        found = ", ".join(sorted(surfaces)) or "none"
        raise PipelineError(
            f"stimulus must be of one kind: step blocks, or crown margins; got {found} in {path}"
        )
    (surface,) = surfaces
    if surface not in SURFACES:
        instead = _GIVEN_OTHERWISE.get(surface, f"got a {surface}")
        raise PipelineError(f"a sweep goes over blocks or crowns; {instead} [{path}]")
    return surface


def _get_surface_or_kind(part: Part) -> str:
    """Find the surface whose dimensions a part has, or else the kind of the part."""
    if not part.is_felt:
        return part.kind_name
    if not part.crossed:
        if part.ball is None:
            return "sheath"
        return "tip"
    for surface, columns in SURFACES.items():
        if set(part.sizes) <= set(columns):
            return surface
    if "relief_width" in part.sizes:
        return f"{part.kind_name} with a relief"
    return part.kind_name


def _make_sweep_stimulus(
    part: Part, surface: str, with_tolerances: bool, tool: Tool
) -> SweepStimulus:
    """Take from a part what a sweep needs: with tolerances about the middle of each zone."""
    columns = SURFACES[surface]
    values = {}
    half_widths = {}
    for name, column in columns.items():
        if name not in part.sizes:
            continue
        dimension = part.sizes[name]
        values[column] = dimension.nominal
        if with_tolerances:
            values[column] = compute_zone_middle(dimension)
            half_widths[column] = compute_zone_half_width(dimension)
    face = dict(vars(part.counterface()))
    for name in columns:
        face.pop(name, None)
    tissue = part.tissue(tool)
    return SweepStimulus(
        id=part.id,
        values=values,
        spreads=convert_half_widths_to_stds(half_widths),
        face=face,
        tissue=[tissue.stiffness, tissue.damping * tool.frequency, tissue.friction],
    )
