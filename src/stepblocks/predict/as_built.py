"""As-built records into prediction: the measured height, edge radius and surface instead of the nominal, and how far E_v moves."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

from stepblocks.artefacts.as_built import AsBuilt, AsBuiltValue, read_as_built
from stepblocks.contact.energy import Release, Status, release_at
from stepblocks.contact.felt import scanned_angle
from stepblocks.errors import PipelineError
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.set import StimulusSet
from stepblocks.predict.predictions import Prediction, predictions_of, tool_of


def read_records(paths: Sequence[Path]) -> dict[str, AsBuilt]:
    """Read as-built records."""
    files = [file for path in paths for file in (sorted(path.glob("*.as-built.toml")) if path.is_dir() else [path])]
    records: dict[str, AsBuilt] = {}
    for file in files:
        record = read_as_built(file)
        if record.stimulus in records:
            raise PipelineError(f"records must name each stimulus once, got {record.stimulus} twice [{file}]")
        records[record.stimulus] = record
    if not records:
        raise PipelineError("expected at least one record (*.as-built.toml), got none")
    return records


def with_as_built(stimuli: StimulusSet, records: dict[str, AsBuilt]) -> StimulusSet:
    """Replace the nominal of every step block that has a record by what was measured."""
    return stimuli.with_parts(
        _as_built(part, records) if isinstance(part, StepBlock) else part for part in stimuli.stimuli
    )


def _as_built(block: StepBlock, records: dict[str, AsBuilt]) -> StepBlock:
    record = records.get(block.id)
    if record is None:
        return block
    update = {}
    height = _height_of(record)
    if height is not None:
        update["height"] = replace(block.height, nominal=height.value, source=f"as built, {record.scan}")
    if "edge_radius" in record.values:
        radius = max(record.values["edge_radius"].value, 0.0)
        update["edge_radius"] = replace(block.edge_radius, nominal=radius, source=f"as built, {record.scan}")
    return block.model_copy(update=update)


def _height_of(record: AsBuilt) -> AsBuiltValue | None:
    """Height of the step: measured at the edge itself, or at the feature beside it that is as high."""
    found = (record.values.get(key) for key in ("step_height", "groove_depth", "ridge_height"))
    return next((value for value in found if value is not None), None)


def measured_edges(records: dict[str, AsBuilt]) -> dict[str, dict[str, float]]:
    """List heights and edge radii of inspected blocks for the closed loop."""
    edges: dict[str, dict[str, float]] = {}
    for block, record in records.items():
        height, radius = _height_of(record), record.values.get("edge_radius")
        if height is None:
            continue
        edges[block] = {"height_m": height.value, "height_std_m": height.std}
        if radius is not None:
            edges[block] |= {"edge_radius_m": radius.value, "edge_radius_std_m": radius.std}
    return edges


def surface_releases(stimuli: StimulusSet, records: dict[str, AsBuilt]) -> Callable[[Prediction], Release | None]:
    """Prepare to predict from the scanned surfaces themselves, through the path of the tip over each."""
    tool = tool_of(stimuli.prediction)

    @cache
    def angle(stimulus: str, ball: float) -> float | None:
        record = records.get(stimulus)
        surface = None if record is None else record.surface
        return None if surface is None else scanned_angle(surface.position, surface.height, ball)

    def release(prediction: Prediction) -> Release | None:
        steepest = angle(prediction.stimulus, prediction.tip_radius)
        return None if steepest is None else release_at(steepest, prediction.normal_load, prediction.friction, tool)

    return release


def surface_columns(release: Release | None) -> dict[str, str]:
    """Return the further columns of a table of predictions, empty where there is no scanned surface."""
    names = ("surface_critical_angle_deg", "surface_status", "surface_pull_force_n", "surface_vibration_energy_uj")
    if release is None:
        return dict.fromkeys(names, "")
    numbers = math.degrees(release.angle), release.pull_force, release.vibration_energy * 1e6
    angle, force, energy = ("" if math.isnan(value) else f"{value:.6g}" for value in numbers)
    return dict(zip(names, (angle, release.status.value, force, energy), strict=True))


def moved_energies(stimuli: StimulusSet, records: dict[str, AsBuilt]) -> Iterator[str]:
    """Say for each recorded step block how far the felt energy moved over the conditions of its set."""
    built = with_as_built(stimuli, records)
    asked, made = list(predictions_of(stimuli)), list(predictions_of(built))
    scanned = surface_releases(stimuli, records)
    for before, after in zip(stimuli.step_block, built.step_block, strict=True):
        if before.id not in records:
            continue
        mine = [(a, b) for a, b in zip(asked, made, strict=True) if a.stimulus == before.id]
        pairs = [(a.release, b.release) for a, b in mine]
        verdicts = ", ".join(f"{key} {one.verdict}" for key, one in records[before.id].values.items())
        sentence = (
            f"{before.id} ({verdicts}): as built, {after.height.nominal * 1e6:.2f} um and an edge radius of "
            f"{after.edge_radius.nominal * 1e6:.2g} um, {_moved(pairs) or 'nothing to compare: the probe does not release'}"
        )
        by_surface = _moved([(a.release, release) for a, _ in mine if (release := scanned(a)) is not None])
        if by_surface:
            sentence += f"; by the scanned surface itself {by_surface}"
        other = sum(a.status is not b.status for a, b in pairs)
        yield sentence + (f"; {other} conditions change between releasing and locking" if other else "")


def _moved(pairs: Sequence[tuple[Release, Release]]) -> str:
    changes = [
        b.vibration_energy / a.vibration_energy - 1.0
        for a, b in pairs
        if a.status is Status.RELEASES and b.status is Status.RELEASES
    ]
    if not changes:
        return ""
    return f"E_v {min(changes) * 100:+.1f} % to {max(changes) * 100:+.1f} % over {len(changes)} conditions"
