"""Predict from as-built records: the measured height, edge radius and surface."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

from stepblocks.contact.counterface import FurtherStep, find_critical_angle_of_scan
from stepblocks.contact.energy import Release, find_release
from stepblocks.contact.energy_change import find_energy_change
from stepblocks.contact.relieved_step import RelievedStep, format_least_riding_ball
from stepblocks.contact.uncertainty import Interval
from stepblocks.declaration.set import StimulusSet
from stepblocks.errors import PipelineError
from stepblocks.parts.kind import Part
from stepblocks.parts.kinds.step_block import get_second_step
from stepblocks.parts.second_step import SECOND
from stepblocks.parts.tolerance import Dimension
from stepblocks.predict.columns import Cell
from stepblocks.predict.neighbours import make_prediction_rows
from stepblocks.predict.perception import LITERATURE, Discrimination
from stepblocks.predict.predictions import Prediction, predict_and_drag_set, predict_by_formula
from stepblocks.records.as_built import AsBuilt, AsBuiltValue

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
    rows = make_prediction_rows(stimuli, predictions, discrimination)
    return PredictedSet(stimuli, predictions, rows)


def predict_as_built(
    stimuli: StimulusSet,
    records: Records,
    dragged: bool | None,
    speed: float,
    discrimination: Discrimination = LITERATURE,
) -> PredictedSet:
    """Predict what was measured in place of the nominal; with the rows of a table.

    Where any surface was scanned, the rows have the columns of `make_surface_columns`, too.
    """
    built = replace_nominal_sizes(stimuli, records)
    nominal = predict_and_drag_set(built, dragged, speed)
    predictions = tuple(predict_from_surfaces(nominal, built, records))
    rows = make_prediction_rows(built, predictions, discrimination)
    if any(record.surface is not None for record in records.values()):
        release_over_surface = make_surface_release_function(stimuli, records)
        for row, prediction in zip(rows, predictions, strict=True):
            row |= make_surface_columns(release_over_surface(prediction))
    return PredictedSet(built, predictions, rows)


def predict_blocks_by_serial(
    stimuli: StimulusSet,
    records_by_serial: Mapping[str, Records],
    dragged: bool | None,
    speed: float,
    discrimination: Discrimination = LITERATURE,
) -> list[PredictedSet]:
    """Predict the blocks of several serial numbers, of each its recorded stimuli alone.

    Parameters
    ----------
    stimuli : StimulusSet
        What was asked for.
    records_by_serial : mapping
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
    has_serials = any(records_by_serial)
    for serial, records in records_by_serial.items():
        of_block = select_recorded_stimuli(stimuli, serial, records)
        if of_block is None:
            continue
        found = predict_as_built(of_block, records, dragged, speed, discrimination)
        if has_serials:
            rows = [{"serial": serial, **row} for row in found.rows]
            found = replace(found, rows=rows)
        predicted.append(found)
    return predicted


def select_recorded_stimuli(
    stimuli: StimulusSet, serial: str, records: Records
) -> StimulusSet | None:
    """Return the set of the stimuli that a serial number has records of; None of none."""
    if not serial:
        return stimuli
    recorded = [part for part in stimuli.stimuli if part.id in records]
    if not recorded:
        return None
    return stimuli.with_parts(recorded)


def replace_nominal_sizes(stimuli: StimulusSet, records: Records) -> StimulusSet:
    """Replace the nominal of every step that has a record by what was measured."""
    parts = [_replace_nominal_sizes_of_part(part, records.get(part.id)) for part in stimuli.stimuli]
    return stimuli.with_parts(parts)


def _replace_nominal_sizes_of_part(part: Part, record: AsBuilt | None) -> Part:
    """Replace nominal height and edge radius of all edges of a part by the measured ones."""
    if record is None or "height" not in part.sizes:
        return part
    source = f"as built, {record.scan}"
    first = _collect_measured_sizes(record.contact_height, record.values.get("edge_radius"))
    update: dict[str, object] = {**_make_measured_dimensions(part.sizes, first, source)}
    second_step = get_second_step(part)
    if second_step is not None:
        radius = record.values.get("second_edge_radius")
        second = _collect_measured_sizes(record.second_contact_height, radius)
        sizes = {"height": second_step.height, "edge_radius": second_step.edge_radius}
        replaced = _make_measured_dimensions(sizes, second, source)
        update["second_step"] = second_step.model_copy(update=replaced)
    return part.model_copy(update=update)


def _collect_measured_sizes(
    height: float | None, edge_radius: AsBuiltValue | None
) -> dict[str, float]:
    """Return the sizes that were measured of an edge, by the names of a counterface [m]."""
    measured = {}
    if height is not None:
        measured["height"] = height
    if edge_radius is not None:
        measured["edge_radius"] = max(edge_radius.value, 0.0)
    return measured


def _make_measured_dimensions(
    sizes: Mapping[str, Dimension], measured: Mapping[str, float], source: str
) -> dict[str, Dimension]:
    """Make the measured sizes, with the tolerances of the nominal ones and their source."""
    replaced = {}
    for name, value in measured.items():
        replaced[name] = replace(sizes[name], nominal=value, source=source)
    return replaced


def make_surface_release_function(
    stimuli: StimulusSet, records: Records
) -> Callable[[Prediction], Release | None]:
    """Prepare to predict from the scanned surfaces, by the path of the tip over each.

    The function that is returned gives None for a stimulus whose surface was not scanned.
    """
    tool = stimuli.prediction.as_tool()

    @cache  # a path is long to compute and serves every load and friction
    def find_surface_angle(stimulus: str, ball_radius: float) -> float | None:
        """Find the critical angle of a recorded surface [rad]; None without one."""
        record = records.get(stimulus)
        if record is None or record.surface is None:
            return None
        return find_critical_angle_of_scan(
            record.surface.position, record.surface.height, ball_radius
        )

    def release_over_surface(prediction: Prediction) -> Release | None:
        """Return the release over the scanned surface; None of a second edge or without a scan."""
        if prediction.is_second_edge:  # a record keeps the surface of the first
            return None
        point = prediction.point
        angle = find_surface_angle(prediction.stimulus, point.ball_radius)
        if angle is None:
            return None
        return find_release(angle, point.normal_load, point.friction, tool)

    return release_over_surface


def predict_from_surfaces(
    predictions: Iterable[Prediction], stimuli: StimulusSet, records: Records
) -> Iterator[Prediction]:
    """Predict a recorded edge that is not an arc from its surface: its radius says little."""
    release_over_surface = make_surface_release_function(stimuli, records)
    for prediction in predictions:
        record = records.get(prediction.stimulus)
        if record is None or record.arc:
            yield prediction
            continue
        release = release_over_surface(prediction)
        if release is None:
            yield prediction
            continue
        _refuse_relief_before_slope(prediction)
        interval = prediction.interval
        if interval is not None:
            interval = _scale_interval(interval, release)
        yield replace(prediction, release=release, interval=interval)


def _refuse_relief_before_slope(prediction: Prediction) -> None:
    """Refuse a ball that sinks into a relief before a riser that was measured to slope."""
    face = prediction.face
    if isinstance(face, RelievedStep) and prediction.point.ball_radius < face.least_riding_ball:
        raise PipelineError(
            f"a ball must have {format_least_riding_ball(face)} to be predicted from the record "
            f"of {prediction.stimulus}, whose riser slopes beside its relief, got "
            f"{prediction.point.ball_radius * 1e6:g} um"
        )


def _scale_interval(interval: Interval, release: Release) -> Interval:
    """Move an interval with its value: the tolerances of setting and block move both alike."""
    force = float(release.pull_force)
    energy = float(release.vibration_energy)

    def scale_force(bound: float) -> float:
        """Move a bound of the force by the ratio of the forces [N]."""
        return bound * force / interval.force

    def scale_energy(bound: float) -> float:
        """Move a bound of the energy by the ratio of the energies [J]."""
        return bound * energy / interval.energy

    return replace(
        interval,
        status=release.status,
        force=force,
        energy=energy,
        force_low=scale_force(interval.force_low),
        force_high=scale_force(interval.force_high),
        energy_low=scale_energy(interval.energy_low),
        energy_high=scale_energy(interval.energy_high),
        analytic_energy_low=scale_energy(interval.analytic_energy_low),
        analytic_energy_high=scale_energy(interval.analytic_energy_high),
    )


def make_surface_columns(release: Release | None) -> dict[str, Cell]:
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
    built = replace_nominal_sizes(stimuli, records)
    declared = list(predict_by_formula(stimuli))
    as_built = list(predict_from_surfaces(predict_by_formula(built), stimuli, records))
    release_over_surface = make_surface_release_function(stimuli, records)
    for part in built.stimuli:
        if part.id not in records or "height" not in part.sizes:
            continue
        for edge in part.list_felt_edges():
            changes = _pair_declared_and_built_releases(edge, declared, as_built)
            sentence = _describe_block_as_built(edge, records[part.id])
            sentence += _describe_energy_range(changes)
            over_surface = []
            switched = 0
            for before, after in changes:
                release = release_over_surface(before)
                if release is not None:
                    over_surface.append((before, release))
                if before.release.status is not after.status:
                    switched += 1
            surface_change = _format_energy_change(over_surface)
            if surface_change:
                sentence += f"; by the scanned surface itself {surface_change}"
            if switched:
                sentence += f"; {switched} conditions change between releasing and locking"
            yield sentence


def _pair_declared_and_built_releases(
    edge: Part, declared: Sequence[Prediction], as_built: Sequence[Prediction]
) -> list[tuple[Prediction, Release]]:
    """List what an edge of a block was declared to release, and what it releases as built."""
    ways = edge.counterface().ways
    changes = []
    for before, after in zip(declared, as_built, strict=True):
        if before.stimulus == edge.id and before.drag_direction in ways:
            changes.append((before, after.release))
    return changes


def _describe_energy_range(changes: Sequence[tuple[Prediction, Release]]) -> str:
    """Say how far the energy moved, or that nothing can be compared."""
    change = _format_energy_change(changes)
    if change:
        return change
    return "nothing to compare: the probe does not release"


def _describe_block_as_built(edge: Part, record: AsBuilt) -> str:
    """Begin a sentence: an edge of a block, its verdicts, and its dimensions as built."""
    is_second = isinstance(edge.counterface(), FurtherStep)
    verdicts = []
    for name, found in record.values.items():
        if name.startswith(SECOND) is is_second:
            verdicts.append(f"{name} {found.verdict}")
    height = edge.sizes["height"].nominal * 1e6
    radius = edge.sizes["edge_radius"].nominal * 1e6
    with_burr = ""
    measured, contact = record.height, record.contact_height
    if is_second:
        measured, contact = record.second_height, record.second_contact_height
    if measured is not None and contact != measured.value:
        with_burr = " with its burr"
    name = edge.id
    if is_second:
        name = f"{edge.id}, second step"
    known = ""
    if verdicts:
        known = f" ({', '.join(verdicts)})"
    return (
        f"{name}{known}: as built, {height:.2f} um{with_burr} and an edge radius of "
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
