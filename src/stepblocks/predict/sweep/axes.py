"""The stimuli of a set as an axis of a sweep: their dimensions, and how far their tolerances let them be off."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from stepblocks.declare import load_declared
from stepblocks.errors import PipelineError
from stepblocks.parts.conditions import PredictionGrid
from stepblocks.parts.kind import Part
from stepblocks.predict.sweep.plan import SURFACES


def stimuli_of(path: Path, wanted: Any, tolerances: bool) -> tuple[str, list[dict[str, Any]], PredictionGrid]:
    """Read the stimuli that a sweep goes over."""
    declared = load_declared(path)
    known = {part.id: part for part in declared.stimuli}
    if wanted is None:
        chosen = [part for part in declared.stimuli if part.crossed]
    else:
        if not isinstance(wanted, list) or not wanted or not all(isinstance(name, str) for name in wanted):
            raise PipelineError(f"stimulus must be a list of identities, got {wanted!r} [parameters]")
        missing = [name for name in wanted if name not in known]
        if missing:
            raise PipelineError(f"stimulus must be declared in {path}, got {missing[0]!r} [parameters]")
        chosen = [known[name] for name in wanted]
    kinds = {_surface(part) for part in chosen}
    if len(kinds) != 1:
        raise PipelineError(
            f"stimulus must be of one kind: step blocks, or crown margins; got {', '.join(sorted(kinds)) or 'none'} in {path}"
        )
    (surface,) = kinds
    if surface not in SURFACES and surface not in ("tip", "sheath"):
        raise PipelineError(f"a sweep goes over blocks or crowns, got a {surface} in {path}")
    if surface not in SURFACES:
        other = "tips as tip_radius" if surface == "tip" else "what a sheath makes of the probe as stiffness"
        raise PipelineError(f"a sweep goes over blocks or crowns; give {other} [parameters]")
    return surface, [_axis_point(part, SURFACES[surface], tolerances) for part in chosen], declared.prediction


def setting_of(grid: PredictionGrid) -> tuple[dict[str, list[float]], dict[str, float], dict[str, float]]:
    """Values of the conditions that a set declares, and the standard uncertainties of its setting, plain and as shares."""
    values = {
        "tip_radius": list(grid.tip_radii),
        "normal_load": list(grid.normal_loads),
        "friction": list(grid.frictions),
        "stiffness": [grid.tool.stiffness],
        "conversion": [grid.tool.conversion],
    }
    off, root = grid.tolerances, math.sqrt(3.0)
    plain = {"tip_radius": off.tip_radius / root, "friction": off.friction / root}
    shares = {name: getattr(off, name) / root for name in ("normal_load", "stiffness", "conversion")}
    return values, {n: v for n, v in plain.items() if v > 0.0}, {n: v for n, v in shares.items() if v > 0.0}


def _surface(part: Part) -> str:
    """Find the surface whose dimensions a part has."""
    if not part.crossed:
        return "tip" if part.ball is not None else "sheath"
    return next((name for name, columns in SURFACES.items() if set(part.sizes) <= set(columns)), part.called)


def _axis_point(part: Part, columns: dict[str, str], tolerances: bool) -> dict[str, Any]:
    named = {columns[name]: part.sizes[name] for name in columns if name in part.sizes}
    if not tolerances:
        return {"id": part.id, "values": {name: one.nominal for name, one in named.items()}, "spreads": {}}
    values = {name: one.nominal + 0.5 * (one.upper + one.lower) for name, one in named.items()}
    spreads = {name: 0.5 * (one.upper - one.lower) / math.sqrt(3.0) for name, one in named.items()}
    return {"id": part.id, "values": values, "spreads": spreads}
