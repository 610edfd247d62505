"""From a scan to a verdict.

Read, evaluate, judge by ISO 14253-1, and say what the part will feel like.
"""

import hashlib
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from stepblocks.contact.domain import read_number
from stepblocks.declaration.read import Sets, load_sets
from stepblocks.declaration.set import StimulusSet
from stepblocks.errors import MetrologyError, PipelineError
from stepblocks.files.text import escape_file_name
from stepblocks.inspect.budget import (
    UNSTATED,
    Component,
    Decision,
    Instrument,
    Measured,
    Outcome,
    combine_verdicts,
    judge,
)
from stepblocks.inspect.grooves import UnlikeError, measure_groove
from stepblocks.inspect.map_levels import is_periodic, measure_dots
from stepblocks.inspect.measure import (
    AS_FOUND,
    Evaluation,
    EvaluationOptions,
    evaluate_each,
    measure_margin,
    measure_tip,
)
from stepblocks.inspect.report import InspectionResult
from stepblocks.inspect.working_edge.energy import describe_energy
from stepblocks.inspect.working_edge.measure import measure_edge
from stepblocks.inspect.working_edge.roughness import add_roughness
from stepblocks.parts.characteristics import Characteristic
from stepblocks.parts.conditions import NO_ORDER, OrderSpec, PredictionGrid
from stepblocks.parts.kind import Part
from stepblocks.records.qif_read import QifResult, match_results, read_qif_results
from stepblocks.records.sheet_read import is_filled_sheet, read_filled_sheet
from stepblocks.scans.read import Scan, load_scan
from stepblocks.scans.scan import HeightMap, ScannedProfile, crop_map

Evaluator = Callable[
    [ScannedProfile | HeightMap, Instrument, Characteristic, EvaluationOptions], Evaluation
]

# What is scanned of a part, by the characteristic that it shows: a part that has one can be
# inspected.
EVALUATIONS: dict[str, Evaluator] = {
    "step_height": lambda scan, instrument, asked, options: measure_edge(scan, instrument, options),
    "groove_depth": lambda scan, instrument, asked, options: measure_groove(
        scan, instrument, options, asked.key, -1.0 if asked.key == "groove_depth" else 0.0
    ),
    "ridge_height": lambda scan, instrument, asked, options: measure_groove(
        scan, instrument, options, asked.key, 1.0
    ),
    "horizontal_discrepancy": lambda scan, instrument, asked, options: measure_margin(
        scan, instrument, options
    ),
    "ball_radius": lambda scan, instrument, asked, options: measure_tip(
        scan, instrument, options, asked.nominal
    ),
    "dot_depth": lambda scan, instrument, asked, options: measure_dots(scan, instrument, options),
}
# what a scan of a feature does not show, and which evaluation a standard of a feature needs
_BESIDE = {"edge": ("groove_depth", "ridge_height"), "groove": ("step_height",)}
# which options an evaluation does not follow and therefore refuses
_FLAT = {"degree": "--level", "edges": "--edges"}
_ALONG = _FLAT | {"along": "--along"}
_UNFOLLOWED: dict[str, dict[str, str]] = {
    "step_height": _FLAT,
    "groove_depth": {},
    "ridge_height": {},
    "horizontal_discrepancy": {"exclusion": "--exclusion"} | _ALONG,
    "ball_radius": {"exclusion": "--exclusion"} | _ALONG,
    "dot_depth": {"degree": "--level", "begin": "--from", "end": "--to", "along": "--along"},
}
_STANDARDS = {
    "groove": "groove_depth",
    "edge": "step_height",
    "ball": "ball_radius",
    "dots": "dot_depth",
}
_FEATURES = ("dots", "groove", "edge")  # in the order of what else may be asked for
_NOTHING_KNOWN = Instrument()
_LEAST_COVERED = 0.8  # of either side of a face that a scan must show to judge its form [1]
_UNITS = ("pm", "nm", "um", "mm", "m")  # each 1000 of the one before
_UNIT_READ = re.compile(r"(?<![a-z])(pm|nm|um|mm|m)(?![a-z])")
# of the logarithm of a size over the declared one, about a power of 1000 [1]: a factor of two
_NEAR_POWER = 0.3


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
    feature : {"edge", "groove"}
        What of a step block was scanned; the groove stands also for a ridge.
    options : EvaluationOptions
        Exclusion, levelling, part of the scan, edges, direction and stylus; what is not given
        follows the data.
    unit, channel : str, optional
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
    PipelineError.require(
        feature in _BESIDE, f"feature must be one of {', '.join(_BESIDE)}, got {feature!r}"
    )
    others: tuple[Part, ...] = ()
    if isinstance(stimulus, str):
        part, declared = find_declared_part(stimulus, stimuli)
        order, prediction = declared.order, declared.prediction
        others = tuple(one for one in declared.stimuli if one is not part)
    else:
        part, order = stimulus, NO_ORDER
        prediction = PredictionGrid()
    listed = list(part.characteristics())
    called = {
        name: one.key
        for number, one in enumerate(listed, start=1)
        for name in (str(number), one.label, one.key)
    }
    wanted = _find_asked_keys(called, characteristics)
    scale = ""
    path = Path(scan) if isinstance(scan, str | Path) else None
    if path is not None and (path.suffix.lower() == ".qif" or is_filled_sheet(path)):
        evaluation = _read_results(path, called)
    else:
        shown = [
            one for one in listed if one.key in EVALUATIONS and one.key not in _BESIDE[feature]
        ]
        PipelineError.require(
            shown, f"a scan of {part.id} cannot be inspected: only blocks, margins and tips can"
        )
        _refuse_unused_options(shown[0].key, options)
        loaded = load_scan(scan, unit, channel)
        scale = loaded.scale
        evaluation = _evaluate(
            EVALUATIONS[shown[0].key], loaded, instrument, shown[0], options, tuple(_BESIDE)
        )
        rough = next((one for one in listed if one.key == "roughness"), None)
        if rough is not None and evaluation.faces:
            evaluation = add_roughness(evaluation, rough.upper, instrument)
    main = [one for one in listed if one.key in EVALUATIONS and one.key in evaluation.values]
    doubts = [
        doubt for one in main for doubt in _describe_size_doubts(one, evaluation, scale, others)
    ]
    read = [f"heights were read as: {scale}"] if scale else []
    evaluation = replace(evaluation, notes=(*doubts, *evaluation.notes, *read))
    result = judge_part(part, evaluation, *identify_source(scan), order, wanted)
    PipelineError.require(
        result.judged,
        f"scan of {part.id} must measure at least one characteristic with limits, got "
        f"{'; '.join(['none', *evaluation.notes])}",
    )
    return replace(result, energy_statement=describe_energy(result, prediction))


def identify_source(scan: Scan) -> tuple[Path, str]:
    """Return the name of a scan and the SHA-256 of its file, or of its heights."""
    if isinstance(scan, str | Path):
        return Path(scan), hashlib.sha256(Path(scan).read_bytes()).hexdigest()
    loaded = load_scan(scan)
    return (
        Path(loaded.source or "arrays"),
        hashlib.sha256(np.ascontiguousarray(loaded.height).tobytes()).hexdigest(),
    )


def _find_asked_keys(
    called: Mapping[str, str], names: Sequence[int | str] | None
) -> frozenset[str]:
    # Return the keys of the characteristics that the order asks for; all where none are named.
    asked = [str(name) for name in names or ()]
    unknown = [name for name in asked if name not in called]
    PipelineError.require(
        not unknown,
        f"characteristics must be numbers or names of the {len({*called.values()})} on the "
        f"drawing, got {', '.join(unknown)}",
    )
    return frozenset(called[name] for name in asked) or frozenset(called.values())


def _read_results(path: Path, called: Mapping[str, str]) -> Evaluation:
    # Take what others measured, found by key, label or number on the drawing, with the uncertainty
    # that they state.
    qif = path.suffix.lower() == ".qif"
    results: list[QifResult] = read_qif_results(path) if qif else read_filled_sheet(path)
    found = match_results(results, called)
    names = ", ".join(dict.fromkeys(one.name or one.designator or "?" for one in results))
    PipelineError.require(
        found,
        "results must measure a characteristic by its name or number on the drawing, got "
        f"{names:.120} [{path}]",
    )
    values = {}
    for key, one in found.items():
        origin = (
            "combined standard uncertainty" if one.std == one.std else f"{UNSTATED} in the file"
        )
        stated = Component("as stated in the file", one.std, how=origin, decisive=True)
        values[key] = Measured(key.replace("_", " "), one.value, (stated,))
    other = [key for key, one in found.items() if qif and one.status not in ("PASS", "FAIL")]
    notes = [f"{len(results)} measured in the file, {len(found)} of them asked for"]
    notes += [f"the file itself passes no judgement on {', '.join(other)}"] if other else []
    notes += [
        f"serial number {one}, as the sheet states it"
        for one in dict.fromkeys(one.serial for one in results if one.serial)
    ]
    form = "as another program measured it, QIF 3.0" if qif else "as the inspection sheet states it"
    return Evaluation(values, f"{form}, {path.name}", tuple(notes))


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
) -> InspectionResult:
    """Evaluate a depth standard, a grating or a ball.

    It proves an instrument before blocks are measured with it.

    Parameters
    ----------
    scan, instrument, options, unit, channel
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
    PipelineError.require(
        feature in _STANDARDS, f"feature must be one of {', '.join(_STANDARDS)}, got {feature!r}"
    )
    MetrologyError.require(
        feature != "ball" or depth is not None,
        "a ball needs its radius as the standard, such as '500 um'",
    )
    _refuse_unused_options(_STANDARDS[feature], options)
    key = _STANDARDS[feature].removeprefix("groove_")
    width = read_number("tolerance", tolerance, "length")
    asked = Characteristic(
        key,
        key.replace("_", " "),
        "distance",
        0.0 if depth is None else read_number("depth", depth, "length"),
        -width,
        width,
    )
    evaluation = _evaluate(
        EVALUATIONS[_STANDARDS[feature]], load_scan(scan, unit, channel), instrument, asked, options
    )
    source, digest = identify_source(scan)
    result = InspectionResult(
        escape_file_name(source.stem), None, evaluation, (), None, source, digest
    )
    if depth is None:
        return result
    sizes = ", ".join(f"{one.value * 1e6:.4g} um" for one in evaluation.values.values())
    MetrologyError.require(
        key in evaluation.values,
        "features are unlike, so name the one that the certificate is of by --edges, "
        f"got {sizes} [{source.name}]",
    )
    decision = judge(evaluation.values[key], asked.nominal, asked.lower, asked.upper)
    return replace(result, judged=((asked, decision),), verdict=decision.verdict)


def find_declared_part(identity: str, stimuli: Sets) -> tuple[Part, StimulusSet]:
    """Find a stimulus by its identity, also as engraved, and the set that declares it."""
    known = [(part, declared) for declared, _ in load_sets(stimuli) for part in declared.stimuli]
    found = [pair for pair in known if pair[0].id.lower() == identity.strip().lower()]
    PipelineError.require(
        found,
        f"stimulus must be declared in {stimuli}, got {identity!r}; declared are "
        f"{', '.join(part.id for part, _ in known):.400}",
    )
    return found[0]


def _describe_size_doubts(
    size: Characteristic, evaluation: Evaluation, scale: str, others: Iterable[Part]
) -> list[str]:
    # Say that a size is off by a factor of 1000, and which unit would explain it; or that another
    # part of the set is of this size, so that the scan does not say which of the two it shows.
    value = evaluation.values[size.key].value
    ratio = value / size.nominal if size.nominal else 1.0
    power = round(math.log10(ratio) / 3.0) if ratio > 0.0 else 0
    if power and abs(math.log10(ratio) - 3.0 * power) < _NEAR_POWER:
        read = _UNIT_READ.findall(scale.split(";")[0].replace("µ", "u"))
        found = _UNITS.index(read[-1]) - power if read else -1
        likely = f"{_UNITS[found]}, not {read[-1]}" if 0 <= found < len(_UNITS) else "another one"
        return [
            f"{size.label} of {value * 1e6:.4g} um is about {1000.0**power:g} times the declared "
            f"{size.nominal * 1e6:.4g} um: the unit of the heights is likely {likely}"
        ]
    like = [
        part.id
        for part in others
        for one in part.characteristics()
        if one.key == size.key and one.nominal + one.lower <= value <= one.nominal + one.upper
    ]
    if like:
        return [
            f"{size.label} of {value * 1e6:.4g} um is that of {', '.join(like)}, declared in the "
            "same set"
            f"{'' if size.lower <= value - size.nominal <= size.upper else ', not its own'}: "
            "make sure which part was scanned"
        ]
    return []


def _refuse_unused_options(key: str, options: EvaluationOptions) -> None:
    # Refuse options that an evaluation would ignore.
    idle = [
        option
        for name, option in _UNFOLLOWED[key].items()
        if getattr(options, name) != getattr(AS_FOUND, name)
    ]
    PipelineError.require(
        not idle,
        f"an evaluation of {key.replace('_', ' ')} must leave out {', '.join(idle)}, which "
        "this evaluation does not follow",
    )


def _evaluate(
    evaluate: Evaluator,
    scan: ScannedProfile | HeightMap,
    instrument: Instrument,
    characteristic: Characteristic,
    options: EvaluationOptions,
    features: Iterable[str] = _FEATURES,
) -> Evaluation:
    # Evaluate a scan by an instrument that resolves no less than one count of it; `features` are
    # what else may be asked for.
    if options.area is not None:
        scan = crop_map(scan, options.area)
    place = f" [{scan.source}]" if scan.source else ""
    try:
        return evaluate(
            scan,
            replace(instrument, resolution=max(instrument.resolution, scan.count or 0.0)),
            characteristic,
            options,
        )
    except UnlikeError as error:
        raise UnlikeError(f"{error}{place}") from error
    except MetrologyError as error:
        message = str(error).removesuffix(place)
        message += _suggest_other_evaluation(
            evaluate, scan, instrument, characteristic, options, features
        )
        raise MetrologyError(f"{message}{place}") from error


def _suggest_other_evaluation(
    evaluate: Evaluator,
    scan: ScannedProfile | HeightMap,
    instrument: Instrument,
    characteristic: Characteristic,
    options: EvaluationOptions,
    features: Iterable[str] = _FEATURES,
) -> str:
    # Say what may be tried with a scan of an edge, a groove or dots that was refused.
    ways = {EVALUATIONS[_STANDARDS[name]]: name for name in features}
    if ways.pop(evaluate, None) is None:
        return ""
    others = evaluate_each(lambda one: one(scan, instrument, characteristic, options), ways)[0]
    if others:
        return f"; --feature {ways[others[0][0]]} measures it"
    if isinstance(scan, ScannedProfile):
        return ""
    return (
        "; the map repeats itself: of a grating only level ridges and grooves have a depth"
        if is_periodic(scan.height)
        else "; a part that shows one kind of feature may do: --from, --to, --along, --area"
    )


def judge_part(
    part: Part,
    evaluation: Evaluation,
    source: Path,
    digest: str,
    order: OrderSpec,
    wanted: Iterable[str],
) -> InspectionResult:
    """Judge what was measured of a part, and say why the rest was not.

    Form is judged only where a scan shows nearly the whole face; a part of a face that is less flat
    than the whole may be does not conform.
    """
    judged, missing = list[tuple[Characteristic, Decision]](), list[tuple[Characteristic, str]]()
    asked = frozenset(wanted)
    for one in part.characteristics():
        reason = evaluation.missing.get(one.key, one.method)
        measured = evaluation.values.get(one.key)
        if measured is not None:
            whole = not (one.extent and one.key in evaluation.covered)
            if not whole:
                seen = evaluation.covered[one.key]
                pairs = zip(sorted(seen), sorted(one.extent), strict=True)
                whole = all(have >= _LEAST_COVERED * need for have, need in pairs)
                sizes = [
                    " x ".join(f"{size * 1e3:.3g}" for size in both) for both in (seen, one.extent)
                ]
                reason = (
                    f"scanned {sizes[0]} mm of {sizes[1]} mm; a map of {_LEAST_COVERED:.0%} "
                    f"of either side, or {one.method}"
                )
            found = judge(measured, one.nominal, one.lower, one.upper)
            if whole or (one.kind == "flatness" and found.verdict is Outcome.DOES_NOT_CONFORM):
                judged.append((one, found))
                continue
        missing.append((one, reason))
    verdict = combine_verdicts(found.verdict for one, found in judged if one.key in asked)
    if verdict is Outcome.CONFORMS and any(one.key in asked for one, _ in missing):
        verdict = Outcome.NOT_PROVEN
    return InspectionResult(
        part.id,
        part,
        evaluation,
        tuple(judged),
        verdict,
        source,
        digest,
        order=order,
        missing=tuple(missing),
        asked=asked,
    )
