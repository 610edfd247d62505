"""What of a part or a standard is scanned, and which evaluation measures it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

from stepblocks.errors import MetrologyError, PipelineError
from stepblocks.inspect.attempts import evaluate_if_possible
from stepblocks.inspect.budget import Instrument
from stepblocks.inspect.dots import measure_dots
from stepblocks.inspect.evaluation import AS_FOUND, Evaluation, EvaluationOptions
from stepblocks.inspect.grooves import UnlikeError, measure_groove
from stepblocks.inspect.map_levels import is_periodic
from stepblocks.inspect.measure import measure_margin, measure_tip
from stepblocks.inspect.working_edge.measure import measure_edge
from stepblocks.parts.characteristics import Characteristic
from stepblocks.scans.scan import HeightMap, ScannedProfile, crop_map

Measure = Callable[
    [ScannedProfile | HeightMap, Instrument, Characteristic, EvaluationOptions], Evaluation
]

# options of the command line by the options that they set
_FLAT = {"degree": "--level", "edges": "--edges"}
_ALONG = _FLAT | {"along": "--along"}
_EXCLUSION_AND_ALONG = {"exclusion": "--exclusion"} | _ALONG
_BY_PROFILES = {"degree": "--level", "begin": "--from", "end": "--to", "along": "--along"}


def _measure_edge(
    scan: ScannedProfile | HeightMap,
    instrument: Instrument,
    asked: Characteristic,
    options: EvaluationOptions,
) -> Evaluation:
    """Measure a step across its edge."""
    return measure_edge(scan, instrument, options)


def _measure_groove_or_ridge(
    scan: ScannedProfile | HeightMap,
    instrument: Instrument,
    asked: Characteristic,
    options: EvaluationOptions,
) -> Evaluation:
    """Measure the grooves of a part, or ridges as well of a standard."""
    sign = -1.0 if asked.key == "groove_depth" else 0.0
    return measure_groove(scan, instrument, options, asked.key, sign)


def _measure_ridge(
    scan: ScannedProfile | HeightMap,
    instrument: Instrument,
    asked: Characteristic,
    options: EvaluationOptions,
) -> Evaluation:
    """Measure the ridges of a part."""
    return measure_groove(scan, instrument, options, asked.key, 1.0)


def _measure_margin(
    scan: ScannedProfile | HeightMap,
    instrument: Instrument,
    asked: Characteristic,
    options: EvaluationOptions,
) -> Evaluation:
    """Measure a margin."""
    return measure_margin(scan, instrument, options)


def _measure_tip(
    scan: ScannedProfile | HeightMap,
    instrument: Instrument,
    asked: Characteristic,
    options: EvaluationOptions,
) -> Evaluation:
    """Measure a tip of about its nominal radius."""
    return measure_tip(scan, instrument, options, asked.nominal)


def _measure_dots(
    scan: ScannedProfile | HeightMap,
    instrument: Instrument,
    asked: Characteristic,
    options: EvaluationOptions,
) -> Evaluation:
    """Measure dots, holes and craters."""
    return measure_dots(scan, instrument, options)


@dataclass(frozen=True)
class Evaluator:
    """How the characteristic that a scan shows is measured."""

    measure: Measure
    unfollowed: dict[str, str]  # options that it does not follow, with those of the command line

    def list_ignored_flags(self, options: EvaluationOptions) -> list[str]:
        """Return the options of the command line that are given and that it does not follow."""
        unused = []
        for name, flag in self.unfollowed.items():
            if getattr(options, name) != getattr(AS_FOUND, name):
                unused.append(flag)
        return unused


# by the key of the characteristic that a scan shows: a part that has one can be inspected
EVALUATIONS = {
    "step_height": Evaluator(_measure_edge, _FLAT),
    "groove_depth": Evaluator(_measure_groove_or_ridge, {}),
    "ridge_height": Evaluator(_measure_ridge, {}),
    "horizontal_discrepancy": Evaluator(_measure_margin, _EXCLUSION_AND_ALONG),
    "ball_radius": Evaluator(_measure_tip, _EXCLUSION_AND_ALONG),
    "dot_depth": Evaluator(_measure_dots, _BY_PROFILES),
}


class ScannedFeature(StrEnum):
    """What was scanned."""

    GROOVE = "groove"
    EDGE = "edge"
    FIRST_EDGE = "first-edge"
    SECOND_EDGE = "second-edge"
    BALL = "ball"
    DOTS = "dots"

    @property
    def key(self) -> str:
        """Key of the characteristic that a scan of it shows."""
        return _KEYS[self]

    @property
    def not_shown(self) -> tuple[str, ...]:
        """Keys of the characteristics of a part that a scan of it does not show."""
        return _NOT_SHOWN.get(self, ())


_KEYS = {
    ScannedFeature.GROOVE: "groove_depth",
    ScannedFeature.EDGE: "step_height",
    ScannedFeature.FIRST_EDGE: "step_height",
    ScannedFeature.SECOND_EDGE: "step_height",
    ScannedFeature.BALL: "ball_radius",
    ScannedFeature.DOTS: "dot_depth",
}
_NOT_SHOWN = {
    ScannedFeature.EDGE: ("groove_depth", "ridge_height"),
    ScannedFeature.FIRST_EDGE: ("groove_depth", "ridge_height"),
    ScannedFeature.SECOND_EDGE: ("groove_depth", "ridge_height"),
    ScannedFeature.GROOVE: ("step_height",),
}
# what of a standard may be scanned
STANDARDS = (
    ScannedFeature.GROOVE,
    ScannedFeature.EDGE,
    ScannedFeature.BALL,
    ScannedFeature.DOTS,
)
# what else may be asked for of a standard, in the order in which it is tried
_OF_STANDARDS = (ScannedFeature.DOTS, ScannedFeature.GROOVE, ScannedFeature.EDGE)


def refuse_unused_options(key: str, options: EvaluationOptions) -> None:
    """Refuse options that the evaluation of a characteristic would ignore."""
    unused = EVALUATIONS[key].list_ignored_flags(options)
    if unused:
        raise PipelineError(
            f"an evaluation of {key.replace('_', ' ')} must leave out {', '.join(unused)}, which "
            "this evaluation does not follow"
        )


def evaluate_scan(
    key: str,
    scan: ScannedProfile | HeightMap,
    instrument: Instrument,
    asked: Characteristic,
    options: EvaluationOptions,
    alternative_features: Sequence[ScannedFeature] = _OF_STANDARDS,
) -> Evaluation:
    """Evaluate a scan by an instrument that resolves no less than one count of it.

    Parameters
    ----------
    key : str
        Of the characteristic that the scan shows, one of `EVALUATIONS`.
    scan : ScannedProfile or HeightMap
    instrument : Instrument
    asked : Characteristic
        What the values are judged by.
    options : EvaluationOptions
    alternative_features : sequence of ScannedFeature
        What else may be asked for.

    Returns
    -------
    Evaluation

    Raises
    ------
    MetrologyError
        If the scan cannot be evaluated, with what may be tried.
    """
    if options.area is not None:
        scan = crop_map(scan, options.area)
    place = f" [{scan.source}]" if scan.source else ""
    resolution = max(instrument.resolution, scan.count or 0.0)
    try:
        resolving = replace(instrument, resolution=resolution)
        return EVALUATIONS[key].measure(scan, resolving, asked, options)
    except UnlikeError as error:
        raise UnlikeError(f"{error}{place}") from error
    except MetrologyError as error:
        message = str(error).removesuffix(place)
        message += describe_alternative_evaluation(
            key, scan, instrument, asked, options, alternative_features
        )
        raise MetrologyError(f"{message}{place}") from error


def describe_alternative_evaluation(
    key: str,
    scan: ScannedProfile | HeightMap,
    instrument: Instrument,
    asked: Characteristic,
    options: EvaluationOptions,
    alternative_features: Sequence[ScannedFeature] = _OF_STANDARDS,
) -> str:
    """Say what may be tried with a scan that was refused, as the end of a message.

    Empty where it was no scan of an edge, a groove or dots, or nothing is known. Takes what
    `evaluate_scan` does.
    """
    keys = [feature.key for feature in alternative_features]
    if key not in keys:
        return ""
    for feature in alternative_features:
        if feature.key == key:
            continue

        def evaluate_as_other_feature(
            shown: ScannedProfile | HeightMap, other: str = feature.key
        ) -> Evaluation:
            """Evaluate a scan as another feature."""
            return EVALUATIONS[other].measure(shown, instrument, asked, options)

        if evaluate_if_possible(evaluate_as_other_feature, scan) is not None:
            return f"; --feature {feature.value} measures it"
    if isinstance(scan, ScannedProfile):
        return ""
    if is_periodic(scan.height):
        return "; the map repeats itself: of a grating only level ridges and grooves have a depth"
    return "; a part that shows one kind of feature may do: --from, --to, --along, --area"
