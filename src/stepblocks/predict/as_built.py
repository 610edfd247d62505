"""Predict from as-built records: the measured height, edge radius and surface."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

from stepblocks.contact.counterface import find_scanned_angle
from stepblocks.contact.energy import Release, find_release
from stepblocks.contact.energy_change import find_energy_change
from stepblocks.contact.uncertainty import Interval
from stepblocks.declaration.set import StimulusSet
from stepblocks.parts.kind import Part
from stepblocks.predict.columns import Cell
from stepblocks.predict.neighbours import tabulate_predictions
from stepblocks.predict.perception import LITERATURE, Discrimination
from stepblocks.predict.predictions import Prediction, predict_and_drag_set, predict_by_formula
from stepblocks.records.as_built import AsBuilt

Records = Mapping[str, AsBuilt]  # by the identity of the stimulus


@dataclass(frozen=True)
class PredictedSet:
    """A set as it was predicted: measured sizes stand for the nominal ones."""

    stimuli: StimulusSet
    predictions: tuple[Prediction, ...]
    rows: list[dict[str, Cell]]  # of a table, one for each prediction


def predict_as_declared(
    stimuli: StimulusSet,
    dragged: bool | None,
    speed: float,
    discrimination: Discrimination = LITERATURE,
) -> PredictedSet:
    """Predict a set at its nominal sizes; `dragged`, `speed`: see `predict_and_drag_set`."""
    predictions = predict_and_drag_set(stimuli, dragged, speed)
    rows = tabulate_predictions(stimuli, predictions, discrimination)
    return PredictedSet(stimuli, predictions, rows)


def predict_as_built(
    stimuli: StimulusSet,
    records: Records,
    dragged: bool | None,
    speed: float,
    discrimination: Discrimination = LITERATURE,
) -> PredictedSet:
    """Predict what was measured in place of the nominal; with the rows of a table.

    Where any surface was scanned, the rows have the columns of `tabulate_surface`, too.
    """
    built = replace_nominals(stimuli, records)
    nominal = predict_and_drag_set(built, dragged, speed)
    predictions = tuple(predict_from_surfaces(nominal, built, records))
    rows = tabulate_predictions(built, predictions, discrimination)
    if any(record.surface is not None for record in records.values()):
        release_over_surface = prepare_surface_releases(stimuli, records)
        for row, prediction in zip(rows, predictions, strict=True):
            row |= tabulate_surface(release_over_surface(prediction))
    return PredictedSet(built, predictions, rows)


def predict_blocks(
    stimuli: StimulusSet,
    groups: Mapping[str, Records],
    dragged: bool | None,
    speed: float,
    discrimination: Discrimination = LITERATURE,
) -> list[PredictedSet]:
    """Predict the blocks of several serial numbers, of each its recorded stimuli alone.

    Parameters
    ----------
    stimuli : StimulusSet
        What was asked for.
    groups : mapping
        Records by stimulus, by serial number; those without a number stand for the set.
    dragged, speed
        As `predict_and_drag_set` takes them.
    discrimination : Discrimination
        Of the person who compares the blocks of a serial number.

    Returns
    -------
    list of PredictedSet
        Rows have a column ``serial`` where a number is known.
    """
    predicted: list[PredictedSet] = []
    has_serials = any(groups)
    for serial, records in groups.items():
        of_block = select_recorded(stimuli, serial, records)
        if of_block is None:
            continue
        found = predict_as_built(of_block, records, dragged, speed, discrimination)
        if has_serials:
            rows = [{"serial": serial, **row} for row in found.rows]
            found = replace(found, rows=rows)
        predicted.append(found)
    return predicted


def select_recorded(stimuli: StimulusSet, serial: str, records: Records) -> StimulusSet | None:
    """Return the set of the stimuli that a serial number has records of; None of none."""
    if not serial:
        return stimuli
    recorded = [part for part in stimuli.stimuli if part.id in records]
    if not recorded:
        return None
    return stimuli.with_parts(recorded)


def replace_nominals(stimuli: StimulusSet, records: Records) -> StimulusSet:
    """Replace the nominal of every step that has a record by what was measured."""
    return stimuli.with_parts(
        _replace_nominal(part, records.get(part.id)) for part in stimuli.stimuli
    )


def _replace_nominal(part: Part, record: AsBuilt | None) -> Part:
    """Replace the nominal height and edge radius of a part by the measured ones."""
    if record is None or "height" not in part.sizes:
        return part
    measured = {}
    if record.contact_height is not None:
        measured["height"] = record.contact_height
    if "edge_radius" in record.values:
        measured["edge_radius"] = max(record.values["edge_radius"].value, 0.0)
    source = f"as built, {record.scan}"
    dimensions = {}
    for name, value in measured.items():
        dimensions[name] = replace(part.sizes[name], nominal=value, source=source)
    return part.model_copy(update=dimensions)


def prepare_surface_releases(
    stimuli: StimulusSet, records: Records
) -> Callable[[Prediction], Release | None]:
    """Prepare to predict from the scanned surfaces, by the path of the tip over each.

    The function that is returned gives None for a stimulus whose surface was not scanned.
    """
    tool = stimuli.prediction.as_tool()

    @cache  # a path is long to compute and serves every load and friction
    def find_angle(stimulus: str, ball_radius: float) -> float | None:
        """Find the critical angle of a recorded surface [rad]; None without one."""
        record = records.get(stimulus)
        if record is None or record.surface is None:
            return None
        return find_scanned_angle(record.surface.position, record.surface.height, ball_radius)

    def release_over_surface(prediction: Prediction) -> Release | None:
        point = prediction.point
        angle = find_angle(prediction.stimulus, point.ball_radius)
        if angle is None:
            return None
        return find_release(angle, point.normal_load, point.friction, tool)

    return release_over_surface


def predict_from_surfaces(
    predictions: Iterable[Prediction], stimuli: StimulusSet, records: Records
) -> Iterator[Prediction]:
    """Predict a recorded edge that is no arc from its surface: its radius says little."""
    release_over_surface = prepare_surface_releases(stimuli, records)
    for prediction in predictions:
        record = records.get(prediction.stimulus)
        if record is None or record.arc:
            yield prediction
            continue
        release = release_over_surface(prediction)
        if release is None:
            yield prediction
            continue
        interval = prediction.interval
        if interval is not None:
            interval = _shift_interval(interval, release)
        yield replace(prediction, release=release, interval=interval)


def _shift_interval(interval: Interval, release: Release) -> Interval:
    """Move an interval with its value: the tolerances of setting and block move both alike."""
    force = float(release.pull_force)
    energy = float(release.vibration_energy)

    def shift_force(bound: float) -> float:
        return bound * force / interval.force

    def shift_energy(bound: float) -> float:
        return bound * energy / interval.energy

    return replace(
        interval,
        status=release.status,
        force=force,
        energy=energy,
        force_low=shift_force(interval.force_low),
        force_high=shift_force(interval.force_high),
        energy_low=shift_energy(interval.energy_low),
        energy_high=shift_energy(interval.energy_high),
        analytic_energy_low=shift_energy(interval.analytic_energy_low),
        analytic_energy_high=shift_energy(interval.analytic_energy_high),
    )


def tabulate_surface(release: Release | None) -> dict[str, Cell]:
    """Return more columns of a table of predictions, NaN where no surface was scanned."""
    if release is None:
        return {
            "surface_critical_angle_deg": math.nan,
            "surface_status": "",
            "surface_peak_force_n": math.nan,
            "surface_vibration_energy_uj": math.nan,
        }
    return {
        "surface_critical_angle_deg": math.degrees(release.angle),
        "surface_status": release.status.value,
        "surface_peak_force_n": release.pull_force,
        "surface_vibration_energy_uj": release.vibration_energy * 1e6,
    }


def describe_energy_changes(stimuli: StimulusSet, records: Records) -> Iterator[str]:
    """Say for each recorded block how far the felt energy moved over its set's conditions."""
    built = replace_nominals(stimuli, records)
    declared = list(predict_by_formula(stimuli))
    as_built = list(predict_from_surfaces(predict_by_formula(built), stimuli, records))
    release_over_surface = prepare_surface_releases(stimuli, records)
    for part in built.stimuli:
        if part.id not in records or "height" not in part.sizes:
            continue
        changes = [
            (before, after.release)
            for before, after in zip(declared, as_built, strict=True)
            if before.stimulus == part.id
        ]
        sentence = _describe_block(part, records[part.id])
        sentence += _format_energy_change(changes) or (
            "nothing to compare: the probe does not release"
        )
        over_surface = []
        for before, _ in changes:
            release = release_over_surface(before)
            if release is not None:
                over_surface.append((before, release))
        surface_change = _format_energy_change(over_surface)
        if surface_change:
            sentence += f"; by the scanned surface itself {surface_change}"
        switched = sum(before.release.status is not after.status for before, after in changes)
        if switched:
            sentence += f"; {switched} conditions change between releasing and locking"
        yield sentence


def _describe_block(part: Part, record: AsBuilt) -> str:
    """Begin of a sentence: a block, its verdicts, and its dimensions as built."""
    verdicts = ", ".join(f"{name} {found.verdict}" for name, found in record.values.items())
    height = part.sizes["height"].nominal * 1e6
    radius = part.sizes["edge_radius"].nominal * 1e6
    with_burr = ""
    if record.height is not None and record.contact_height != record.height.value:
        with_burr = " with its burr"
    return (
        f"{part.id} ({verdicts}): as built, {height:.2f} um{with_burr} and an edge radius of "
        f"{radius:.2g} um, "
    )


def _format_energy_change(changes: Sequence[tuple[Prediction, Release]]) -> str:
    """Write the range of the relative changes of E_v; nothing where none is known."""
    known = []
    for declared, as_built in changes:
        change = find_energy_change(declared.release, as_built, declared.point)
        if not math.isnan(change):
            known.append(change)
    if not known:
        return ""
    if len(known) == 1:
        return f"E_v {known[0] * 100:+.1f} %"
    return (
        f"E_v {min(known) * 100:+.1f} % to {max(known) * 100:+.1f} % over {len(known)} conditions"
    )
