"""From a scan to a verdict.

Read, evaluate, judge by ISO 14253-1, and say what the part will feel like.
"""

import hashlib
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stepblocks.contact.domain import read_number
from stepblocks.declaration.read import Sets, find_declared_part
from stepblocks.errors import MetrologyError, PipelineError
from stepblocks.files.layout import UNDECLARED, TableLayout
from stepblocks.files.text import escape_file_name
from stepblocks.inspect.budget import Instrument
from stepblocks.inspect.conformity import Outcome, combine_verdicts, judge_measured_conformity
from stepblocks.inspect.doubts import (
    note_other_parts_of_measured_size,
    refuse_long_scan,
    refuse_wrong_height_unit,
)
from stepblocks.inspect.evaluation import AS_FOUND, Evaluation, EvaluationOptions
from stepblocks.inspect.feature import (
    EVALUATIONS,
    STANDARDS,
    ScannedFeature,
    evaluate_scan,
    refuse_unused_options,
)
from stepblocks.inspect.judgement import Judgement, NotMeasured
from stepblocks.inspect.layout import DeclaredLayout, build_declared_layout
from stepblocks.inspect.notes import NoteKind, NotMeasuredReason
from stepblocks.inspect.result import InspectionResult
from stepblocks.inspect.results_of_others import has_results_of_others, read_results_of_others
from stepblocks.inspect.two_steps import TwoSteps, WantedEdges, evaluate_two_steps
from stepblocks.inspect.working_edge.energy import describe_energy
from stepblocks.inspect.working_edge.roughness import add_roughness
from stepblocks.parts.characteristics import Characteristic
from stepblocks.parts.conditions import NO_ORDER, OrderSpec, PredictionGrid
from stepblocks.parts.kind import Part
from stepblocks.parts.kinds.step_block import get_second_step
from stepblocks.scans.read import Scan, load_scan
from stepblocks.scans.scan import HeightMap, ScannedProfile

# what of a step block may be scanned
_OF_PARTS = (
    ScannedFeature.EDGE,
    ScannedFeature.GROOVE,
    ScannedFeature.FIRST_EDGE,
    ScannedFeature.SECOND_EDGE,
)
_OF_ONE_STEP = (ScannedFeature.EDGE, ScannedFeature.GROOVE)
_WANTED_EDGES = {
    ScannedFeature.EDGE: WantedEdges.BOTH,
    ScannedFeature.FIRST_EDGE: WantedEdges.FIRST,
    ScannedFeature.SECOND_EDGE: WantedEdges.SECOND,
}
_NOTHING_KNOWN = Instrument()
_LEAST_COVERED = 0.8  # of either side of a face that a scan must show to judge its form [1]


@dataclass(frozen=True)
class _AskedPart:
    """A part that is inspected, and what is asked of it."""

    part: Part
    order: OrderSpec
    prediction: PredictionGrid
    beside: tuple[Part, ...]  # other parts of its set
    characteristics: tuple[Characteristic, ...]

    @property
    def keys_by_name(self) -> dict[str, str]:
        """Keys of the characteristics by number on the drawing, label and key."""
        keys = {}
        for number, characteristic in enumerate(self.characteristics, start=1):
            for name in (str(number), characteristic.label, characteristic.key):
                keys[name] = characteristic.key
        return keys

    def find_keys_by_names(self, names: Sequence[int | str] | None) -> frozenset[str]:
        """Return the keys of characteristics by their names; all where none are named."""
        keys = self.keys_by_name
        if not names:
            return frozenset(keys.values())
        found = set()
        unknown = []
        for name in map(str, names):
            if name in keys:
                found.add(keys[name])
            else:
                unknown.append(name)
        if unknown:
            raise PipelineError(
                f"characteristics must be numbers or names of the {len(set(keys.values()))} on "
                f"the drawing, got {', '.join(unknown)}"
            )
        return frozenset(found)


def inspect_scan(
    scan: Scan,
    stimulus: str | Part,
    *,
    stimuli: Sets = "stimuli",
    instrument: Instrument = _NOTHING_KNOWN,
    feature: str = "edge",
    options: EvaluationOptions = AS_FOUND,
    unit: str | None = None,
    channel: str | None = None,
    layout: TableLayout = UNDECLARED,
    characteristics: Sequence[int | str] | None = None,
) -> InspectionResult:
    """Evaluate a scan of a machined stimulus and judge it by ISO 14253-1.

    Parameters
    ----------
    scan : str, Path, DataFrame, ScannedProfile, HeightMap, Profile or pair of arrays
        A profile or a height map: a file of any format that `read_scan` reads, a table with the
        columns of such a file (``x_um``, ``z_um``), an object in memory, or positions and heights
        [m], each of shape (n,). Or results of others: ``*.qif``, or an inspection sheet that is
        filled in, ``*.csv`` or ``*.xlsx``.
    stimulus : str or part
        Identity of the part, such as ``"step-050"``, or the part itself.
    stimuli : str, Path, StimulusSet or sequence of them
        Stimulus file, folder of them, or set, that declares it.
    instrument : Instrument
        Calibration and resolution; for a scale that is not stated a default of 2 % counts.
    feature : {"edge", "groove", "first-edge", "second-edge"}
        What of a step block was scanned; the groove stands also for a ridge. Of a block with two
        steps ``"edge"`` stands for both of its edges in one scan.
    options : EvaluationOptions
        Exclusion, levelling, part of the scan, edges, direction and stylus; what is not given
        follows the data.
    unit, channel, layout
        As `read_scan` takes them.
    characteristics : sequence of int or str, optional
        Numbers on the drawing, or names, of those that the order asks for; all by default.

    Returns
    -------
    InspectionResult
        Values with their budgets, verdicts, what was not measured, and the energy;
        `write_inspection` writes it.

    Raises
    ------
    MetrologyError
        If the scan cannot be read or evaluated.
    PipelineError
        If the stimulus is not declared there, there is no evaluation for it or none that follows
        `options`, or the feature or a characteristic is unknown.
    """
    scanned = _parse_feature_name(feature, _OF_PARTS)
    asked = _look_up_asked_part(stimulus, stimuli)
    wanted = asked.find_keys_by_names(characteristics)
    scale = ""
    if has_results_of_others(scan):
        _refuse_unit_and_channel(Path(scan), unit, channel)
        evaluation = read_results_of_others(Path(scan), asked.keys_by_name, layout)
        source, digest = identify_file(Path(scan))
    else:
        _refuse_feature_of_other_parts(asked, scanned)
        main = _find_scanned_characteristic(asked, scanned)
        refuse_unused_options(main.key, options)
        loaded = load_scan(scan, unit, channel, layout)
        scale = loaded.scale
        source, digest = identify_source(scan, loaded)
        refuse_long_scan(asked.characteristics, _measure_scan_length(loaded), source.name)
        evaluation = _evaluate_part(asked, scanned, main, loaded, instrument, options)
        evaluation = _drop_gap_under_bevel(asked, evaluation)
        evaluation = _add_roughness_where_asked(asked, evaluation, instrument)
    evaluation = _add_notes_on_reading(asked, evaluation, scale, source.name)
    result = judge_part(asked.part, evaluation, source, digest, asked.order, wanted)
    if not result.judged:
        raise PipelineError(
            f"scan of {asked.part.id} must measure at least one characteristic with limits, got "
            f"{'; '.join(['none', *evaluation.notes])}"
        )
    return replace(result, energy_statement=describe_energy(result, asked.prediction))


def _evaluate_part(
    asked: _AskedPart,
    scanned: ScannedFeature,
    main: Characteristic,
    scan: ScannedProfile | HeightMap,
    instrument: Instrument,
    options: EvaluationOptions,
) -> Evaluation:
    """Evaluate a scan of a part; of a block with two steps at the edges that it shows."""
    second = get_second_step(asked.part)
    if second is None:
        options = replace(options, layout=build_declared_layout(asked.characteristics))
        return evaluate_scan(main.key, scan, instrument, main, options, _OF_ONE_STEP)

    def evaluate_at_layout(layout: DeclaredLayout) -> Evaluation:
        """Evaluate the edge of a layout."""
        at_edge = replace(options, layout=layout)
        return evaluate_scan(main.key, scan, instrument, main, at_edge, ())

    return evaluate_two_steps(
        TwoSteps(main.nominal, second), _WANTED_EDGES[scanned], evaluate_at_layout
    )


def _refuse_feature_of_other_parts(asked: _AskedPart, scanned: ScannedFeature) -> None:
    """Refuse a feature that a part does not have: a second edge, or a groove beside one."""
    features: Collection[ScannedFeature] = _OF_ONE_STEP
    whose = "a part with one working edge"
    if get_second_step(asked.part) is not None:
        features = _WANTED_EDGES
        whose = "a block with two steps"
    if scanned not in features:
        raise PipelineError(
            f"feature must be one of {', '.join(features)} of {whose}, got {scanned.value!r} "
            f"[{asked.part.id}]"
        )


def _parse_feature_name(name: str, allowed_features: Sequence[ScannedFeature]) -> ScannedFeature:
    """Return the feature of a name, which must be one of some."""
    for feature in allowed_features:
        if feature.value == name:
            return feature
    raise PipelineError(f"feature must be one of {', '.join(allowed_features)}, got {name!r}")


def _look_up_asked_part(stimulus: str | Part, stimuli: Sets) -> _AskedPart:
    """Return a part by its identity in sets, or the part itself, with what is asked of it."""
    if not isinstance(stimulus, str):
        listed = tuple(stimulus.characteristics())
        return _AskedPart(stimulus, NO_ORDER, PredictionGrid(), (), listed)
    part, declared = find_declared_part(stimulus, stimuli)
    beside = tuple(twin for twin in declared.stimuli if twin is not part)
    listed = tuple(part.characteristics())
    return _AskedPart(part, declared.order, declared.prediction, beside, listed)


def _find_scanned_characteristic(asked: _AskedPart, feature: ScannedFeature) -> Characteristic:
    """Return the characteristic that a scan of a feature shows of a part."""
    for characteristic in asked.characteristics:
        key = characteristic.key
        if key in EVALUATIONS and key not in feature.not_shown:
            return characteristic
    raise PipelineError(
        f"a scan of {asked.part.id} cannot be inspected: only blocks, margins and tips can"
    )


def _drop_gap_under_bevel(asked: _AskedPart, evaluation: Evaluation) -> Evaluation:
    """Leave the marginal gap out where the part states an opening of another width."""
    keys = {characteristic.key for characteristic in asked.characteristics}
    if not {"marginal_gap", "vertical_discrepancy"} <= keys:
        return evaluation
    values = dict(evaluation.values)
    values.pop("marginal_gap", None)
    reason = NotMeasuredReason.GAP_UNDER_BEVEL.format_message()
    return replace(
        evaluation, values=values, missing={**evaluation.missing, "marginal_gap": reason}
    )


def _add_roughness_where_asked(
    asked: _AskedPart, evaluation: Evaluation, instrument: Instrument
) -> Evaluation:
    """Add the roughness of the faces, where a part has a limit of it and the scan shows them."""
    for characteristic in asked.characteristics:
        if characteristic.key == "roughness" and evaluation.faces:
            return add_roughness(evaluation, characteristic.upper, instrument)
    return evaluation


def _add_notes_on_reading(
    asked: _AskedPart, evaluation: Evaluation, scale_description: str, file_name: str
) -> Evaluation:
    """Put doubts before all notes, and how heights were read, `scale_description`, behind them.

    A unit that cannot be right refuses the file at `file_name`.
    """
    notes = list(evaluation.notes)
    doubts = []
    for characteristic in asked.characteristics:
        if characteristic.key in EVALUATIONS and characteristic.key in evaluation.values:
            value = evaluation.values[characteristic.key].value
            refuse_wrong_height_unit(characteristic, value, scale_description, file_name)
            doubts += note_other_parts_of_measured_size(characteristic, value, asked.beside)
    if scale_description:
        notes.append(NoteKind.HEIGHTS_READ_AS.make_note(scale=scale_description))
    return replace(evaluation, notes=(*doubts, *notes))


def _measure_scan_length(scan: ScannedProfile | HeightMap) -> float:
    """Return how far a scan reaches, a map along its longer side [m]."""
    if isinstance(scan, ScannedProfile):
        return float(np.ptp(scan.position))
    return max(float(np.ptp(scan.x)), float(np.ptp(scan.y)))


def _refuse_unit_and_channel(path: Path, unit: str | None, channel: str | None) -> None:
    """Refuse a unit or a channel for results of others, which state theirs."""
    for name, value in (("unit", unit), ("channel", channel)):
        if value is not None:
            raise MetrologyError(
                f"{name} must not be given for results of others, got {value!r} [{path.name}]"
            )


class SourceIdentity(NamedTuple):
    """What was inspected: its path or name, and the SHA-256 of its bytes."""

    path: Path
    sha256: str


def identify_source(scan: Scan, loaded: ScannedProfile | HeightMap) -> SourceIdentity:
    """Return the name of a scan and the SHA-256 of its file, or of its heights."""
    if isinstance(scan, str | Path):
        return identify_file(Path(scan))
    heights = np.ascontiguousarray(loaded.height).tobytes()
    return SourceIdentity(Path(loaded.source or "arrays"), hashlib.sha256(heights).hexdigest())


def identify_file(path: Path) -> SourceIdentity:
    """Return the name of a file and its SHA-256."""
    return SourceIdentity(path, hashlib.sha256(path.read_bytes()).hexdigest())


def inspect_standard(
    scan: Scan,
    depth: float | None = None,
    tolerance: float = 0.0,
    *,
    feature: str = "groove",
    instrument: Instrument = _NOTHING_KNOWN,
    options: EvaluationOptions = AS_FOUND,
    unit: str | None = None,
    channel: str | None = None,
    layout: TableLayout = UNDECLARED,
) -> InspectionResult:
    """Evaluate a depth standard, a grating or a ball.

    It proves an instrument before blocks are measured with it.

    Parameters
    ----------
    scan, instrument, options, unit, channel, layout
        As `inspect_scan` takes them.
    depth, tolerance : float
        Certified depth or radius and its tolerance [m]; with a tolerance of 0 nothing can be proven
        but a deviation. Without a depth the scan is measured and nothing is judged.
    feature : {"groove", "edge", "ball", "dots"}
        What was scanned; grooves stand also for ridges, single steps and gratings, dots for holes
        and craters.

    Returns
    -------
    InspectionResult
        Depth by type A1 or A2, by a masked polynomial or a masked step; or radius of a ball.

    Raises
    ------
    MetrologyError
        If the scan cannot be read or evaluated, or does not show a feature that a smooth curve does
        not explain.
    """
    scanned = _parse_feature_name(feature, STANDARDS)
    if scanned is ScannedFeature.BALL and depth is None:
        raise MetrologyError("a ball needs its radius as the standard, such as '500 um'")
    refuse_unused_options(scanned.key, options)
    asked = _make_standard_characteristic(scanned, depth, tolerance)
    loaded = load_scan(scan, unit, channel, layout)
    evaluation = evaluate_scan(scanned.key, loaded, instrument, asked, options)
    source, digest = identify_source(scan, loaded)
    result = InspectionResult(
        identity=escape_file_name(source.stem),
        stimulus=None,
        evaluation=evaluation,
        judged=(),
        verdict=None,
        source=source,
        digest=digest,
    )
    if depth is None:
        return result
    if asked.key not in evaluation.values:
        sizes = [f"{measured.value * 1e6:.4g} um" for measured in evaluation.values.values()]
        raise MetrologyError(
            "features are unlike, so name the one that the certificate is of by --edges, "
            f"got {', '.join(sizes)} [{source.name}]"
        )
    value = evaluation.values[asked.key].value
    refuse_wrong_height_unit(asked, value, loaded.scale, source.name)
    return judge_standard(result, asked)


def _make_standard_characteristic(
    feature: ScannedFeature, depth: float | None, tolerance: float
) -> Characteristic:
    """Return the characteristic that the certificate of a standard states [m]."""
    key = feature.key.removeprefix("groove_")
    width = read_number("tolerance", tolerance, "length")
    nominal = 0.0
    if depth is not None:
        nominal = read_number("depth", depth, "length")
    return Characteristic(key, key.replace("_", " "), "distance", nominal, -width, width)


def judge_standard(result: InspectionResult, asked: Characteristic) -> InspectionResult:
    """Judge what was measured of a standard by its certified size."""
    measured = result.evaluation.values[asked.key]
    decision = judge_measured_conformity(measured, asked.nominal, asked.lower, asked.upper)
    return replace(result, judged=(Judgement(asked, decision),), verdict=decision.verdict)


def judge_part(
    part: Part,
    evaluation: Evaluation,
    source: Path,
    digest: str,
    order: OrderSpec,
    requested_keys: Iterable[str],
) -> InspectionResult:
    """Judge what was measured of a part, and say why the rest was not.

    Form is judged only where a scan shows nearly the whole face; a part of a face that is less flat
    than the whole may be does not conform.

    Parameters
    ----------
    part : Part
    evaluation : Evaluation
    source : Path
        The scan, or the results of another program.
    digest : str
        SHA-256 of it.
    order : OrderSpec
        Who asks for it.
    requested_keys : iterable of str
        Keys of the characteristics that count for the verdict of the whole.

    Returns
    -------
    InspectionResult
    """
    asked = frozenset(requested_keys)
    judged = []
    missing = []
    for characteristic in part.characteristics():
        entry = _judge_characteristic(characteristic, evaluation)
        if isinstance(entry, Judgement):
            judged.append(entry)
        else:
            missing.append(entry)
    verdicts = []
    for judgement in judged:
        if judgement.characteristic.key in asked:
            verdicts.append(judgement.decision.verdict)
    verdict = combine_verdicts(verdicts)
    is_complete = not any(absent.characteristic.key in asked for absent in missing)
    if verdict is Outcome.CONFORMS and not is_complete:
        verdict = Outcome.NOT_PROVEN
    return InspectionResult(
        identity=part.id,
        stimulus=part,
        evaluation=evaluation,
        judged=tuple(judged),
        verdict=verdict,
        source=source,
        digest=digest,
        order=order,
        missing=tuple(missing),
        asked=asked,
    )


def _judge_characteristic(
    characteristic: Characteristic, evaluation: Evaluation
) -> Judgement | NotMeasured:
    """Judge one characteristic, or say why it was not measured."""
    key = characteristic.key
    measured = evaluation.values.get(key)
    if measured is None:
        reason = evaluation.missing.get(key, characteristic.method)
        return NotMeasured(characteristic, reason)
    decision = judge_measured_conformity(
        measured, characteristic.nominal, characteristic.lower, characteristic.upper
    )
    judgement = Judgement(characteristic, decision)
    if _is_whole_face_scanned(characteristic, evaluation):
        return judgement
    is_failure = decision.verdict is Outcome.DOES_NOT_CONFORM
    if characteristic.kind == "flatness" and is_failure:
        return judgement
    reason = NotMeasuredReason.PART_OF_FACE.format_message(
        scanned=_format_face_sides_mm(evaluation.covered[key]),
        face=_format_face_sides_mm(characteristic.extent),
        least=_LEAST_COVERED,
        method=characteristic.method,
    )
    return NotMeasured(characteristic, reason)


def _is_whole_face_scanned(characteristic: Characteristic, evaluation: Evaluation) -> bool:
    """Tell whether a scan shows nearly the whole face of a form; so it does of anything else."""
    if not characteristic.extent or characteristic.key not in evaluation.covered:
        return True
    scanned = sorted(evaluation.covered[characteristic.key])
    sides = sorted(characteristic.extent)
    pairs = zip(scanned, sides, strict=True)
    return all(seen >= _LEAST_COVERED * side for seen, side in pairs)


def _format_face_sides_mm(sides: Iterable[float]) -> str:
    """Write the sides of a face [m] in millimetres."""
    return " x ".join(f"{side * 1e3:.3g}" for side in sides)
