"""The way of a scan to a verdict: read, evaluated, judged by ISO 14253-1, and what the part will feel like."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

from stepblocks.artefacts.qif_read import match_results, read_qif_results
from stepblocks.artefacts.scans.read import read_scan
from stepblocks.artefacts.scans.scan import HeightMap, Profile
from stepblocks.contact.counterface import Step, find_scanned_angle
from stepblocks.contact.energy import Status, release_at
from stepblocks.contact.energy_change import energy_change
from stepblocks.errors import MetrologyError, PipelineError
from stepblocks.inspect.budget import (
    Component,
    Instrument,
    Measured,
    Outcome,
    combine_verdicts,
    judge,
)
from stepblocks.inspect.grooves import measure_groove
from stepblocks.inspect.measure import (
    AS_FOUND,
    Evaluation,
    EvaluationOptions,
    measure_edge,
    measure_margin,
    measure_tip,
)
from stepblocks.inspect.report import InspectionResult
from stepblocks.parts.characteristics import Characteristic
from stepblocks.parts.conditions import OrderSpec, PredictionGrid
from stepblocks.parts.kind import Part
from stepblocks.select import find_stimulus_files
from stepblocks.text_file import format_file_name

Evaluator = Callable[
    [Profile | HeightMap, Instrument, Characteristic, EvaluationOptions], Evaluation
]

# What is scanned of a part, by the characteristic that it shows: a part that has one can be
# inspected.
EVALUATIONS: dict[str, Evaluator] = {
    "step_height": lambda scan, instrument, asked, how: measure_edge(scan, instrument, how),
    "groove_depth": lambda scan, instrument, asked, how: measure_groove(
        scan, instrument, how, asked.key
    ),
    "ridge_height": lambda scan, instrument, asked, how: measure_groove(
        scan, instrument, how, asked.key
    ),
    "horizontal_discrepancy": lambda scan, instrument, asked, how: measure_margin(
        scan, instrument, how
    ),
    "ball_radius": lambda scan, instrument, asked, how: measure_tip(
        scan, instrument, how, asked.nominal
    ),
}
# what a scan of a feature does not show, and which evaluation a standard of a feature needs
_BESIDE = {"edge": ("groove_depth", "ridge_height"), "groove": ("step_height",)}
# which options, besides the part of a profile (`--from`, `--to`), an evaluation follows; the others
# are refused
_STYLUS = {"stylus_radius": "--stylus-radius", "stylus_cone": "--stylus-cone"}
_FLAT = {"degree": "--level", "edges": "--edges", "along": "--along"}
_UNFOLLOWED: dict[str, dict[str, str]] = {
    "step_height": _FLAT,
    "groove_depth": _STYLUS,
    "ridge_height": _STYLUS,
    "horizontal_discrepancy": {"exclusion": "--exclusion"} | _FLAT | _STYLUS,
    "ball_radius": {"exclusion": "--exclusion", "stylus_cone": "--stylus-cone"} | _FLAT,
}
_STANDARDS = {"groove": "groove_depth", "edge": "step_height", "ball": "ball_radius"}
_NOTHING_KNOWN = Instrument()
_NO_ORDER = OrderSpec()
_WORTH_SAYING = 0.01  # relative change of the energy from which a cause is named [1]


def inspect_scan(
    scan: str | Path,
    stimulus: str,
    *,
    stimuli: str | Path = "stimuli",
    instrument: Instrument = _NOTHING_KNOWN,
    feature: str = "edge",
    how: EvaluationOptions = AS_FOUND,
    unit: str | None = None,
    channel: str | None = None,
) -> InspectionResult:
    """Evaluate a scan of a machined stimulus and judge it by ISO 14253-1.

    Parameters
    ----------
    scan : str or Path
        Profile or height map, of any format that `read_scan` reads; or results of another program,
        ``*.qif``.
    stimulus : str
        Identity of the part, such as ``"step-050"``.
    stimuli : str or Path
        Stimulus file, or a folder of them, that declares it.
    instrument : Instrument
        Calibration and resolution; what is not stated counts as zero and is named.
    feature : {"edge", "groove"}
        What of a step block was scanned; the groove stands also for a ridge.
    how : How
        Exclusion, levelling, part of the profile, edges, direction and stylus; what is not said
        follows the data.
    unit, channel : str, optional
        As `read_scan` takes them.

    Returns
    -------
    InspectionResult
        Values with their budgets, verdicts, and what is felt; `write_inspection` writes it.

    Raises
    ------
    MetrologyError
        If the scan cannot be read or evaluated.
    PipelineError
        If the stimulus is not declared there, there is no evaluation for it or none that follows
        `how`, or the feature is neither.
    """
    if feature not in _BESIDE:
        raise PipelineError(f"feature must be one of {', '.join(_BESIDE)}, got {feature!r}")
    part, order, prediction = _find_declared(stimulus, Path(stimuli))
    asked = list(part.characteristics())
    if Path(scan).suffix.lower() == ".qif":
        result = _judge_all(part, _evaluate_qif(Path(scan), asked), asked, Path(scan), order)
        return replace(result, felt=_describe_energy(result, prediction))
    shown = [one for one in asked if one.key in EVALUATIONS and one.key not in _BESIDE[feature]]
    if not shown:
        raise PipelineError(
            f"a scan of {part.id} cannot be inspected: only blocks, margins and tips can"
        )
    _require_followed(shown[0].key, how)
    inspected = _evaluate(
        EVALUATIONS[shown[0].key], read_scan(scan, unit, channel), instrument, shown[0], how
    )
    result = _judge_all(part, inspected, asked, Path(scan), order)
    if not result.judged:
        raise PipelineError(
            f"scan of {part.id} must measure at least one characteristic with limits, got none"
        )
    return replace(result, felt=_describe_energy(result, prediction))


def _evaluate_qif(path: Path, asked: list[Characteristic]) -> Evaluation:
    """Take lengths that another program measured, found by key, label or number on the drawing, with the uncertainty it states."""
    called = {
        name: one.key
        for n, one in enumerate(asked, start=1)
        for name in (str(n), one.label, one.key)
    }
    angles = {one.key for one in asked if one.quantity == "angle"}
    results = read_qif_results(path)
    found = {key: one for key, one in match_results(results, called).items() if key not in angles}
    if not found:
        names = ", ".join(dict.fromkeys(one.name or one.designator or "?" for one in results))
        rule = "must measure a characteristic by its name or number on the drawing"
        raise PipelineError(f"QIF results {rule}, got {names:.120} [{path}]")
    values = {}
    for key, one in found.items():
        stated = Component("as stated in the file", one.std, how="combined standard uncertainty")
        values[key] = Measured(key.replace("_", " "), one.value, (stated,))
    other = [key for key, one in found.items() if one.status not in ("PASS", "FAIL")]
    notes = [f"{len(results)} measured in the file, {len(found)} of them asked for"]
    notes += [f"the file itself passes no judgement on {', '.join(other)}"] if other else []
    return Evaluation(values, f"as another program measured it, QIF 3.0, {path.name}", tuple(notes))


def inspect_standard(
    scan: str | Path,
    depth: float | None = None,
    tolerance: float = 0.0,
    *,
    feature: str = "groove",
    instrument: Instrument = _NOTHING_KNOWN,
    how: EvaluationOptions = AS_FOUND,
    unit: str | None = None,
    channel: str | None = None,
) -> InspectionResult:
    """Evaluate a depth standard, a grating or a ball, to prove an instrument before blocks are measured with it.

    Parameters
    ----------
    scan, instrument, how, unit, channel
        As `inspect_scan` takes them.
    depth, tolerance : float
        Certified depth or radius and its tolerance [m]; with a tolerance of 0 nothing can be proven
        but a deviation. Without a depth the scan is measured and nothing is judged.
    feature : {"groove", "edge", "ball"}
        What was scanned; grooves stand also for ridges, single steps and gratings.

    Returns
    -------
    InspectionResult
        Depth by type A1 or A2, by a masked polynomial, a masked step or as a grating; or radius of
        a ball.

    Raises
    ------
    MetrologyError
        If the scan cannot be read or evaluated, or does not show a feature that a smooth curve does
        not explain.
    """
    if feature == "ball" and depth is None:
        raise MetrologyError("a ball needs its radius as the standard, such as '500 um'")
    _require_followed(_STANDARDS[feature], how)
    key = _STANDARDS[feature].removeprefix("groove_")
    asked = Characteristic(
        key, key.replace("_", " "), "distance", depth or 0.0, -tolerance, tolerance
    )
    read = read_scan(scan, unit, channel)
    inspected = _evaluate(EVALUATIONS[_STANDARDS[feature]], read, instrument, asked, how)
    return _judge_all(None, inspected, [asked] if depth is not None else [], Path(scan))


def _find_declared(identity: str, where: Path) -> tuple[Part, OrderSpec, PredictionGrid]:
    """Find a stimulus by its identity in a file or in all files of a folder, and who orders it and what is predicted of it."""
    from stepblocks.declare import load_declared

    for path in find_stimulus_files(where):
        declared = load_declared(path)
        for stimulus in declared.stimuli:
            if stimulus.id == identity:
                return stimulus, declared.order, declared.prediction
    raise PipelineError(f"stimulus must be declared in {where}, got {identity!r}")


def _require_followed(key: str, how: EvaluationOptions) -> None:
    """Refuse what an evaluation would leave aside without a word."""
    idle = [
        option
        for name, option in _UNFOLLOWED[key].items()
        if getattr(how, name) != getattr(AS_FOUND, name)
    ]
    if idle:
        rule = f"leave out {', '.join(idle)}, which this evaluation does not follow"
        raise PipelineError(f"an evaluation of {key.replace('_', ' ')} must {rule}")


def _evaluate(
    evaluate: Evaluator,
    read: Profile | HeightMap,
    instrument: Instrument,
    asked: Characteristic,
    how: EvaluationOptions,
) -> Evaluation:
    """Evaluate a scan by an instrument that resolves no less than one count of it."""
    resolution = max(instrument.resolution, read.count or 0.0)
    return evaluate(read, replace(instrument, resolution=resolution), asked, how)


def _judge_all(
    part: Part | None,
    inspected: Evaluation,
    asked: Iterable[Characteristic],
    source: Path,
    order: OrderSpec = _NO_ORDER,
) -> InspectionResult:
    found = [(one, inspected.values[one.key]) for one in asked if one.key in inspected.values]
    judged = tuple((one, judge(value, one.nominal, one.lower, one.upper)) for one, value in found)
    verdict = combine_verdicts(decision for _, decision in judged) if judged else None
    identity = format_file_name(source.stem) if part is None else part.id
    return InspectionResult(identity, part, inspected, judged, verdict, "", source, order)


def _describe_energy(result: InspectionResult, grid: PredictionGrid) -> str:
    """Say how the energy that the edge releases differs from the nominal block's, and why."""
    # Compared under the first tip, load and friction of the grid: the nominal step, as built, and
    # the scanned surface. Empty where height and edge radius were not both measured.
    values, shown = result.inspected.values, result.inspected.shown
    if not {"step_height", "edge_radius"} <= set(values):
        return ""
    point = grid.first_point()
    nominal = {one.key: one.nominal for one, _ in result.judged}
    asked = Step(nominal["step_height"], nominal["edge_radius"])
    made = Step(values["step_height"].value, max(values["edge_radius"].value, 0.0))
    by_radius, by_height = (
        Step(asked.height, made.edge_radius),
        Step(made.height, asked.edge_radius),
    )
    releases = [face.release(point) for face in (asked, made, by_radius, by_height)]
    verdict = f"{result.identity} {result.said}"
    where = (
        f"(tip {point.ball_radius * 1e6:g} um, {point.normal_load:g} N, friction "
        f"{point.friction:g})"
    )
    if any(release.status is not Status.RELEASES for release in releases):
        return (
            f"{verdict}; nominal {releases[0].status.value}, as built {releases[1].status.value} "
            f"{where}"
        )
    surface = ""
    angle = (
        None
        if shown is None
        else find_scanned_angle(shown.position, shown.height, point.ball_radius)
    )
    if angle is not None:
        scanned = release_at(angle, point.normal_load, point.friction, point.tool)
        if scanned.status is Status.RELEASES:
            surface = (
                "; by the scanned surface itself "
                f"{energy_change(asked, scanned, point) * 100:+.1f} %"
            )
            if not result.inspected.arc:  # its radius says little of it
                energy = float(scanned.vibration_energy) * 1e6
                return f"{verdict}; the edge is no arc{surface}, to {energy:.3g} uJ {where}"
    causes = {
        f"its edge radius of {made.edge_radius * 1e6:.3g} um": energy_change(
            asked, by_radius, point
        ),
        f"its height of {made.height * 1e6:.2f} um": energy_change(asked, by_height, point),
    }
    named = " and ".join(
        f"{cause} {'raises' if change > 0.0 else 'lowers'} E_v by {abs(change) * 100:.1f} %"
        for cause, change in causes.items()
        if abs(change) >= _WORTH_SAYING
    )
    told = f", and E_v is within {100.0 * _WORTH_SAYING:g} % of the nominal block's"
    if named:
        told = f"{', but ' if result.verdict is Outcome.CONFORMS else ': '}{named}"
    change, energy = energy_change(asked, made, point), float(releases[1].vibration_energy)
    return (
        f"{verdict}{told}; together {change * 100:+.1f} %, to {energy * 1e6:.3g} uJ{surface} "
        f"{where}"
    )
