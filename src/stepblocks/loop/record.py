"""The contents of result.json as typed objects, and their form in JSON.

Keys, their order and their values belong to schema 1. The keys ``unwritten``, ``said`` and
``heaps`` are old names, which stand beside the new ones until version 2.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from typing import Any, Protocol, runtime_checkable

from stepblocks.lawsearch.adequacy import ReplicateTest
from stepblocks.lawsearch.findings import Verdict
from stepblocks.lawsearch.identifiability import Identifiability
from stepblocks.loop.apart_trial import ApartTrial
from stepblocks.loop.experiment import NextExperiment
from stepblocks.loop.usable_trials import ExcludedTrial

SCHEMA = 1


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % interval, all in one unit."""

    value: float
    unit: str
    low: float
    high: float


@dataclass(frozen=True)
class KnownConstant:
    """A constant of a gauge that is known beforehand, with its standard uncertainty."""

    value: float
    std: float


@dataclass(frozen=True)
class NoiseFloor:
    """The least error that noise allows, as root mean squares."""

    ln_energy_rms: float
    ln_peak_force_rms: float


@dataclass(frozen=True)
class ModelErrors:
    """Errors of one model on held-out trials, as root mean squares."""

    ln_energy_rms: float
    ln_peak_force_rms: float
    ln_energy_rms_blocks_left_out: float
    ln_peak_force_rms_blocks_left_out: float
    noise_floor: NoiseFloor


@dataclass(frozen=True)
class ModelRecord:
    """One model: its constants, its errors on held-out trials, and its fit."""

    parameters: Mapping[str, Estimate]
    error: ModelErrors
    twice_negative_log_likelihood: float


@dataclass(frozen=True)
class LeadingTrial:
    """The trial that carries most of an effect's gain."""

    trial: str
    share_of_gain: float


@dataclass(frozen=True)
class LeadingChannel:
    """The channel that carries most of an effect's gain."""

    channel: str
    share_of_gain: float


@dataclass(frozen=True)
class FindingEvidence:
    """On what grounds an effect is claimed."""

    claim: str
    gate_p_value: float
    twice_log_likelihood_gain: float
    law_named: bool
    leading_trial: LeadingTrial
    leading_channel: LeadingChannel


@dataclass(frozen=True)
class RivalEvidence:
    """How far a rival is behind the effect that it may stand for."""

    criterion_behind: float
    instead_of: str


@dataclass(frozen=True)
class EffectRecord:
    """An effect with its fitted parameters, or a rival of one."""

    id: str
    variant: str
    slot: str
    covariate: str
    form: str
    parameters: Mapping[str, Estimate]
    evidence: FindingEvidence | RivalEvidence


@dataclass(frozen=True)
class HintRecord:
    """A difference between trials that no column describes, with the names of its trials."""

    kind: str
    quantity: str
    p_value: float
    text: str
    said: str
    groups: Sequence[Sequence[str]]
    heaps: Sequence[Sequence[str]]


@dataclass(frozen=True)
class DetectableEffect:
    """The smallest effect of a slot that nine such sessions in ten would show."""

    id: str
    slot: str
    covariate: str
    parameter: str
    value: float
    unit: str
    text: str
    said: str


@dataclass(frozen=True)
class CensoredTrials:
    """Trials whose peak is known as a bound alone."""

    trials: Sequence[str]
    predicted_below_their_bound: Sequence[str]


@dataclass(frozen=True)
class ResidualCheckRecord:
    """Test of one channel's residual against one covariate."""

    channel: str
    covariate: str
    holm_p_value: float


@dataclass(frozen=True)
class AdequacyRecord:
    """Whether the extended model is enough."""

    adequate: bool
    last_gate_p_value: float
    gate_level: float
    pure_error: Mapping[str, ReplicateTest]
    residual_against_covariates: Sequence[ResidualCheckRecord]


@dataclass(frozen=True)
class IdentifiabilityRecord(Identifiability):
    """What the design cannot tell apart, and what the equations never can."""

    by_the_equations: Sequence[Sequence[str]]


@dataclass(frozen=True)
class UnusedScan:
    """A block whose scan could not be used, and why."""

    block: str
    reason: str


@dataclass(frozen=True)
class CalibrationRecord:
    """What the records show of a declared quantity, as a ratio to it with its 95 % interval."""

    quantity: str
    shown_over_declared: float
    low: float
    high: float
    contradicts: bool
    explained_by_effect: bool
    near_factor: float | None
    text: str


@dataclass(frozen=True)
class BlockError:
    """Error of ln E_v of held-out trials of a block, as root mean squares, with its noise."""

    block: str
    trials: int
    before: float
    after: float
    noise: float


@dataclass(frozen=True)
class ScansRecord:
    """What the scans of the blocks showed.

    Attributes
    ----------
    blocks : Mapping[str, Mapping[str, float]]
        Height and edge radius of each block, with their standard uncertainties [m].
    mean_edge_radius_m : float | None
        Weighted mean over the blocks [m]; None where no edge was scanned.
    left_out : Sequence[UnusedScan] | None
        None where no scans were looked for.
    """

    blocks: Mapping[str, Mapping[str, float]]
    mean_edge_radius_m: float | None = None
    left_out: Sequence[UnusedScan] | None = None

    def as_json(self) -> dict[str, object]:
        """Return the form in JSON, without the keys of what does not exist."""
        form: dict[str, object] = {"blocks": self.blocks}
        if self.mean_edge_radius_m is not None:
            form["mean_edge_radius_m"] = self.mean_edge_radius_m
        if self.left_out is not None:
            form["left_out"] = self.left_out
        return form


@dataclass(frozen=True)
class HeldOutPair:
    """Errors of one channel on the same held-out trials, of features and of whole records.

    Attributes
    ----------
    trials : int
        That both have.
    features_rms, whole_records_rms : float
        Of the logarithm.
    p_better, p_worse : float
        Chance that whole records seem better or worse by so much where they are as good.
    """

    trials: int
    features_rms: float
    whole_records_rms: float
    p_better: float
    p_worse: float


@dataclass(frozen=True)
class RecordChoice:
    """Whether the values of the features or of the whole records stand in the analysis."""

    ln_energy: HeldOutPair
    ln_peak_force: HeldOutPair
    whole_records_stand: bool


@dataclass(frozen=True)
class LoopRecord:
    """Contents of result.json; units stand in keys or beside the values."""

    finding: str
    verdict: Verdict
    nominal: ModelRecord
    extended: ModelRecord
    effects: Sequence[EffectRecord]
    rivals: Sequence[EffectRecord]
    hints: Sequence[HintRecord]
    unwritten: Sequence[HintRecord]
    known_of_the_gauges: Mapping[str, KnownConstant]
    could_have_shown: Sequence[DetectableEffect]
    excluded: Sequence[ExcludedTrial]
    flagged: Sequence[ExcludedTrial]
    apart: Sequence[ApartTrial]
    regimes: Mapping[str, int]
    censored: CensoredTrials
    next_experiment: NextExperiment | None
    adequacy: AdequacyRecord
    identifiability: IdentifiabilityRecord
    scans: ScansRecord
    left_open_on_new_blocks: Sequence[str]
    selected_in_folds: Sequence[Sequence[str]]
    trials_analysed: int
    calibration: Sequence[CalibrationRecord] = ()
    notes: Sequence[str] = ()
    headline: Sequence[str] = ()
    error_by_block: Sequence[BlockError] = ()
    record_choice: RecordChoice | None = None  # None where whole records were not asked for

    def list_calibration_texts(self) -> list[str]:
        """List what is said of the calibration, where something is."""
        return [check.text for check in self.calibration if check.text]

    def as_document(self) -> dict[str, Any]:
        """Return the record in its form in JSON, without the number of the schema."""
        return _convert_fields_to_json_values(self)


@runtime_checkable
class _HasJsonForm(Protocol):
    """A record that says itself which keys it has in JSON."""

    def as_json(self) -> Mapping[str, object]: ...


def convert_to_json_values(value: object) -> Any:
    """Turn records into objects, lists and plain values, as `json.dumps` takes them.

    Not-a-number stays what it is.
    """
    if isinstance(value, _HasJsonForm):
        return convert_to_json_values(value.as_json())
    if is_dataclass(value):
        return _convert_fields_to_json_values(value)
    if isinstance(value, ExcludedTrial):
        return value._asdict()
    if isinstance(value, Mapping):
        return {key: convert_to_json_values(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [convert_to_json_values(item) for item in value]
    if isinstance(value, Enum):
        return value.value
    return value


def _convert_fields_to_json_values(record: Any) -> dict[str, Any]:
    """Turn the fields of a dataclass into plain values by their names."""
    plain = {}
    for field in fields(record):
        plain[field.name] = convert_to_json_values(getattr(record, field.name))
    return plain


def format_json_document(document: Mapping[str, object]) -> str:
    """Write a document as the text of a JSON file.

    Numbers that JSON cannot hold become null.
    """
    plain = json.loads(json.dumps(document), parse_constant=lambda _: None)
    return json.dumps(plain, indent=2, allow_nan=False) + "\n"
