"""Predict from as-built records: the measured height, edge radius and surface."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache

from stepblocks.contact.counterface import find_scanned_angle
from stepblocks.contact.energy import Release, find_release
from stepblocks.contact.energy_change import find_energy_change
from stepblocks.contact.uncertainty import Interval
from stepblocks.declaration.set import StimulusSet
from stepblocks.parts.kind import Part
from stepblocks.predict.predictions import (
    Prediction,
    predict_all,
    predict_by_formula,
    tabulate_prediction,
)
from stepblocks.records.as_built import AsBuilt


def replace_nominals(stimuli: StimulusSet, records: Mapping[str, AsBuilt]) -> StimulusSet:
    """Replace the nominal of every step that has a record by what was measured."""
    return stimuli.with_parts(
        _replace_nominal(part, records.get(part.id)) for part in stimuli.stimuli
    )


def _replace_nominal(part: Part, record: AsBuilt | None) -> Part:
    if record is None or "height" not in part.sizes:
        return part
    measured = {}
    if record.height is not None:
        measured["height"] = record.height.value
    if "edge_radius" in record.values:
        measured["edge_radius"] = max(record.values["edge_radius"].value, 0.0)
    return part.model_copy(
        update={
            name: replace(part.sizes[name], nominal=value, source=f"as built, {record.scan}")
            for name, value in measured.items()
        }
    )


def prepare_surface_releases(
    stimuli: StimulusSet, records: Mapping[str, AsBuilt]
) -> Callable[[Prediction], Release | None]:
    """Prepare to predict from the scanned surfaces, by the path of the tip over each."""
    tool = stimuli.prediction.as_tool()

    @cache  # a path is long to compute and serves every load and friction
    def angle(stimulus: str, ball: float) -> float | None:
        surface = records[stimulus].surface if stimulus in records else None
        return (
            None if surface is None else find_scanned_angle(surface.position, surface.height, ball)
        )

    def release(prediction: Prediction) -> Release | None:
        point = prediction.point
        steepest = angle(prediction.stimulus, point.ball_radius)
        return (
            None
            if steepest is None
            else find_release(steepest, point.normal_load, point.friction, tool)
        )

    return release


def predict_from_surfaces(
    predictions: Iterable[Prediction], stimuli: StimulusSet, records: Mapping[str, AsBuilt]
) -> Iterator[Prediction]:
    """Predict a recorded edge that is no arc from its surface: its radius says little."""
    scanned = prepare_surface_releases(stimuli, records)
    for one in predictions:
        record = records.get(one.stimulus)
        release = None if record is None or record.arc else scanned(one)
        if release is not None:
            one = replace(
                one,
                release=release,
                interval=one.interval and _shift_interval(one.interval, release),
            )
        yield one


def _shift_interval(interval: Interval, release: Release) -> Interval:
    # Move an interval with its value: the tolerances of setting and block move both alike
    found = {"force": float(release.pull_force), "energy": float(release.vibration_energy)}
    bounds = {"force": "force", "energy": "energy", "analytic_energy": "energy"}
    limits = {
        f"{name}_{end}": getattr(interval, f"{name}_{end}") * found[kind] / getattr(interval, kind)
        for name, kind in bounds.items()
        for end in ("low", "high")
    }
    return replace(interval, status=release.status, **(found | limits))


def tabulate_surface(release: Release | None) -> dict[str, float | str]:
    """Return more columns of a table of predictions, NaN where no surface was scanned."""
    return {
        "surface_critical_angle_deg": math.degrees(release.angle) if release else math.nan,
        "surface_status": release.status.value if release else "",
        "surface_pull_force_n": release.pull_force if release else math.nan,
        "surface_vibration_energy_uj": release.vibration_energy * 1e6 if release else math.nan,
    }


def predict_as_built(
    stimuli: StimulusSet, records: Mapping[str, AsBuilt], dragged: bool | None, speed: float
) -> tuple[tuple[Prediction, ...], list[dict[str, float | str]]]:
    """Predict what was measured in place of the nominal; with the rows of a table.

    Where any surface was scanned, the rows have the columns of `tabulate_surface`, too.
    """
    built = replace_nominals(stimuli, records)
    found = tuple(predict_from_surfaces(predict_all(built, dragged, speed), built, records))
    rows = [tabulate_prediction(one) for one in found]
    if any(record.surface is not None for record in records.values()):
        scanned = prepare_surface_releases(stimuli, records)
        rows = [row | tabulate_surface(scanned(one)) for row, one in zip(rows, found, strict=True)]
    return found, rows


def describe_energy_changes(stimuli: StimulusSet, records: Mapping[str, AsBuilt]) -> Iterator[str]:
    """Say for each recorded block how far the felt energy moved over its set's conditions."""
    built = replace_nominals(stimuli, records)
    asked, predictions = (
        list(predict_by_formula(stimuli)),
        list(predict_from_surfaces(predict_by_formula(built), stimuli, records)),
    )
    scanned = prepare_surface_releases(stimuli, records)
    for part in (one for one in built.stimuli if one.id in records and "height" in one.sizes):
        pairs = [
            (a, b.release) for a, b in zip(asked, predictions, strict=True) if a.stimulus == part.id
        ]
        verdicts = ", ".join(f"{key} {one.verdict}" for key, one in records[part.id].values.items())
        changes = _format_energy_change(pairs) or "nothing to compare: the probe does not release"
        height, radius = (part.sizes[name].nominal * 1e6 for name in ("height", "edge_radius"))
        sentence = (
            f"{part.id} ({verdicts}): as built, {height:.2f} um and an edge radius of "
            f"{radius:.2g} um, {changes}"
        )
        over = _format_energy_change(
            [(a, release) for a, _ in pairs if (release := scanned(a)) is not None]
        )
        if over:
            sentence += f"; by the scanned surface itself {over}"
        other = sum(a.release.status is not b.status for a, b in pairs)
        yield sentence + (
            f"; {other} conditions change between releasing and locking" if other else ""
        )


def _format_energy_change(pairs: Sequence[tuple[Prediction, Release]]) -> str:
    changes = [
        find_energy_change(asked.release, as_built, asked.point) for asked, as_built in pairs
    ]
    known = [change for change in changes if not math.isnan(change)]
    return (
        f"E_v {min(known) * 100:+.1f} % to {max(known) * 100:+.1f} % over {len(known)} conditions"
        if len(known) > 1
        else "".join(f"E_v {one * 100:+.1f} %" for one in known)
    )
