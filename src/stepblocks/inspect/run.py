"""Inspect a machined stimulus: scan in; measured characteristics, verdicts, plot and as-built record out."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from stepblocks.artefacts.as_built import AsBuilt, AsBuiltValue, write_as_built
from stepblocks.artefacts.inspection_sheet import write_sheet_csv
from stepblocks.artefacts.scans.read import read_scan
from stepblocks.artefacts.scans.scan import HeightMap, Profile
from stepblocks.atomic import replace_text
from stepblocks.declare import load_declared
from stepblocks.errors import PipelineError
from stepblocks.inspect.budget import Instrument
from stepblocks.inspect.conformity import Decision, Outcome
from stepblocks.inspect.felt import felt_sentence
from stepblocks.inspect.inspection import Inspected, judge, verdict_of
from stepblocks.inspect.report import draw_inspection, inspection_table
from stepblocks.inspect.shapes import measure_margin, measure_tip
from stepblocks.inspect.step import measure_edge, measure_groove
from stepblocks.parts.characteristics import Characteristic, characteristics_of
from stepblocks.parts.conditions import PredictionGrid
from stepblocks.parts.kind import Part
from stepblocks.parts.kinds.margin_block import MarginBlock
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.kinds.tips import HookTip, StraightTip


@dataclass(frozen=True)
class InspectionResult:
    """A judged scan."""

    identity: str  # Identity of the part
    stimulus: Part | None  # What was asked for; None for a depth standard
    inspected: Inspected  # What was measured
    judged: tuple[tuple[Characteristic, Decision], ...]  # Each value that has limits
    verdict: Outcome  # Over all of them
    felt: str  # How far the felt energy moved; empty where it does not follow from the values
    source: Path  # The scan


def find_stimulus(identity: str, where: Path) -> tuple[Part, PredictionGrid]:
    """Find a stimulus by its identity in a file or in all files of a folder."""
    files = sorted(where.glob("*.toml")) if where.is_dir() else [where]
    for path in files:
        declared = load_declared(path)
        for stimulus in declared.stimuli:
            if stimulus.id == identity:
                return stimulus, declared.prediction
    raise PipelineError(f"stimulus must be declared in {where}, got {identity!r}")


def inspect_scan(
    path: Path,
    stimulus: Part,
    grid: PredictionGrid,
    instrument: Instrument,
    *,
    feature: str = "edge",
    exclusion: float | None = None,
    unit: str | None = None,
) -> InspectionResult:
    """Evaluate and judge one scan.

    Parameters
    ----------
    path : Path
        The scan.
    stimulus : Part
        What was asked for.
    grid : PredictionGrid
        Conditions under which the felt energy is compared: the first tip, load and friction.
    instrument : Instrument
        Calibration and resolution.
    feature : str
        ``"edge"`` or ``"groove"`` (also for a ridge) of a step block.
    exclusion : float, optional
        Edge exclusion of the two-plane convention [m].
    unit : str, optional
        Unit of a text table that does not say it.

    Returns
    -------
    InspectionResult
        Values, verdicts, and what is felt.

    Raises
    ------
    MetrologyError
        If the scan cannot be read or evaluated.
    PipelineError
        If there is no evaluation for this part.
    """
    scan = read_scan(path, unit)
    resolution = max(instrument.resolution, scan.count or 0.0)
    known = replace(instrument, resolution=resolution)
    inspected = _measured(scan, stimulus, known, feature, exclusion)
    judged = []
    for one in characteristics_of(stimulus):
        if one.key in inspected.values:
            judged.append((one, judge(inspected.values[one.key], one.nominal, one.lower, one.upper)))
    if not judged:
        raise PipelineError(f"scan of {stimulus.id} must measure at least one characteristic with limits, got none")
    verdict = verdict_of([decision for _, decision in judged])
    felt = ""
    if isinstance(stimulus, StepBlock) and feature == "edge":
        felt = felt_sentence(stimulus, verdict, inspected, grid)
    return InspectionResult(stimulus.id, stimulus, inspected, tuple(judged), verdict, felt, path)


def inspect_standard(
    path: Path, depth: float, tolerance: float, instrument: Instrument, *, unit: str | None = None
) -> InspectionResult:
    """Evaluate a depth standard or grating, to prove an instrument before blocks are measured with it.

    Parameters
    ----------
    path : Path
        The scan.
    depth, tolerance : float
        Certified depth and its tolerance [m]; with a tolerance of 0 nothing can be proven but a deviation.
    instrument : Instrument
        Calibration and resolution.
    unit : str, optional
        Unit of a text table that does not say it.

    Returns
    -------
    InspectionResult
        Depth by type A1, or by a masked step where profiles cross several features.

    Raises
    ------
    MetrologyError
        If the scan cannot be read or evaluated.
    """
    scan = read_scan(path, unit)
    known = replace(instrument, resolution=max(instrument.resolution, scan.count or 0.0))
    inspected = measure_groove(scan, known, "depth")
    one = Characteristic("depth", "depth", "distance", depth, -tolerance, tolerance)
    decision = judge(inspected.values["depth"], depth, -tolerance, tolerance)
    return InspectionResult(path.stem, None, inspected, ((one, decision),), decision.verdict, "", path)


def _measured(
    scan: Profile | HeightMap, stimulus: Part, instrument: Instrument, feature: str, exclusion: float | None
) -> Inspected:
    match stimulus:
        case StepBlock() if feature == "edge":
            return measure_edge(scan, instrument, exclusion)
        case StepBlock():
            key = "groove_depth" if stimulus.metrology.kind == "groove" else "ridge_height"
            return measure_groove(scan, instrument, key)
        case MarginBlock():
            return measure_margin(scan, instrument)
        case StraightTip() | HookTip():
            return measure_tip(scan, instrument, stimulus.ball_radius.nominal)
    raise PipelineError(f"a scan of {stimulus.id} cannot be inspected: only blocks, margins and tips can")


def write_inspection(result: InspectionResult, folder: Path) -> list[Path]:
    """Write table, plot, JSON and as-built record of an inspection."""
    folder.mkdir(parents=True, exist_ok=True)
    base = folder / result.identity
    values = {}
    for one, decision in result.judged:
        values[one.key] = AsBuiltValue(decision.value, decision.std, decision.verdict.value)
    digest = hashlib.sha256(result.source.read_bytes()).hexdigest()
    shown = result.inspected.shown
    surface = Profile(shown.position, shown.height) if result.felt else None
    record = AsBuilt(result.identity, result.source.name, digest, result.inspected.convention, values, surface)
    paths = write_as_built(base.with_name(f"{base.name}.as-built.toml"), record)
    paths += [base.with_name(f"{base.name}.inspection.{ending}") for ending in ("json", "txt", "svg")]
    replace_text(paths[-3], json.dumps(as_json(result), indent=2, allow_nan=False) + "\n")
    replace_text(paths[-2], table_of(result) + "\n")
    draw_inspection(paths[-1], result.identity, result.inspected, list(result.judged), result.verdict)
    if result.stimulus is not None:
        paths.append(_filled_sheet(base, result.stimulus, values))
    return paths


def _filled_sheet(base: Path, stimulus: Part, values: dict[str, AsBuiltValue]) -> Path:
    filled = {key: (one.value, one.std, one.verdict) for key, one in values.items()}
    path = base.with_name(f"{base.name}.inspection-sheet.csv")
    write_sheet_csv(path, stimulus, filled)
    return path


def table_of(result: InspectionResult) -> str:
    """Return the table that a person reads."""
    return inspection_table(result.identity, result.inspected, list(result.judged), result.verdict, result.felt)


def as_json(result: InspectionResult) -> dict[str, Any]:
    """Return the result as plain data; every number has its unit in its name, infinities are null."""

    def plain(value: float) -> float | None:
        return value if math.isfinite(value) else None

    characteristics = []
    for one, decision in result.judged:
        measured = result.inspected.values[one.key]
        half = measured.expanded(0.95)
        budget = [
            {"name": part.name, "std_m": plain(part.std), "dof": plain(part.dof), "how": part.how}
            for part in measured.components
        ]
        characteristics.append(
            {
                "key": one.key,
                "label": one.label,
                "nominal_m": one.nominal,
                "lower_limit_m": plain(decision.lower),
                "upper_limit_m": plain(decision.upper),
                "value_m": decision.value,
                "std_m": decision.std,
                "dof": plain(measured.dof),
                "interval_95_m": [decision.value - half, decision.value + half],
                "guard_band_m": decision.guard,
                "conformance_probability": decision.probability,
                "verdict": decision.verdict.value,
                "budget": budget,
            }
        )
    return {
        "stimulus": result.identity,
        "scan": result.source.name,
        "verdict": result.verdict.value,
        "convention": result.inspected.convention,
        "notes": list(result.inspected.notes),
        "felt": result.felt,
        "others_m": {
            key: asdict(one)["value"]
            for key, one in result.inspected.values.items()
            if key not in {c.key for c, _ in result.judged}
        },
        "characteristics": characteristics,
    }
