"""How well both models of a session agree with its trials: what the bench page draws of a loop."""

import math
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from stepblocks.errors import PipelineError
from stepblocks.files.text import read_document
from stepblocks.loop.apart_trial import ApartTrial
from stepblocks.loop.next_block import NextBlock
from stepblocks.window import texts

MODEL_FILE, FEATURES_FILE, RESULT_FILE = "model.json", "features.csv", "result.json"
_LARGEST_RESULT = 20_000_000  # [bytes]


class Figure(Enum):
    """A figure of a trial that is predicted; the value is its column."""

    ENERGY = "vibration_energy_j"
    FORCE = "peak_force_n"

    @property
    def label(self) -> str:
        """What the window calls it."""
        return texts.FIGURES[self.value]


@dataclass(frozen=True)
class TrialAgreement:
    """A trial as measured, over what the two models say of it.

    Attributes
    ----------
    trial, block : str
    nominal, extended : Mapping[Figure, float]
        Measured over predicted [1]; figures without either are left out.
    """

    trial: str
    block: str
    nominal: Mapping[Figure, float]
    extended: Mapping[Figure, float]


@dataclass(frozen=True)
class HeldOutErrors:
    """Errors of a model on trials held out, root mean squares of logarithms [1]."""

    ln_energy_rms: float | None
    ln_peak_force_rms: float | None


@dataclass(frozen=True)
class ModelPart:
    """One of both models in ``result.json``."""

    error: HeldOutErrors


@dataclass(frozen=True)
class FoundEffect:
    """An effect or its rival: its name, and what it follows."""

    variant: str
    covariate: str


@dataclass(frozen=True)
class AskedExperiment:
    """What to measure next, as ``result.json`` has it.

    Attributes
    ----------
    separates : tuple of str
        Names of the effects that it tells apart, or sentences of what differs between trials.
    trials : tuple of mapping
        Settings, best first, each with its expected gain.
    calibration : tuple of str or None
        What to do on the bench.
    note : str
        Why no trials are asked for; empty where they are.
    repeats : int
        Trials at the best setting that are decisive.
    channel : str
        What tells most.
    block : NextBlock or None
        Where the best setting has a height that no block has.
    """

    separates: tuple[str, ...]
    trials: tuple[Mapping[str, float | str], ...] = ()
    calibration: tuple[str, ...] | None = None
    note: str = ""
    repeats: int = 0
    channel: str = ""
    block: NextBlock | None = None


@dataclass(frozen=True)
class LoopFinding:
    """What the window shows of ``result.json``."""

    finding: str
    verdict: str
    nominal: ModelPart
    extended: ModelPart
    apart: tuple[ApartTrial, ...]
    effects: tuple[FoundEffect, ...] = ()
    rivals: tuple[FoundEffect, ...] = ()
    next_experiment: AskedExperiment | None = None

    def has_effect(self, effect_name: str) -> bool:
        """Tell whether an effect of that name was found, or is a rival."""
        return any(found.variant == effect_name for found in (*self.effects, *self.rivals))

    def find_covariate(self, effect_name: str) -> str:
        """Return what an effect follows; empty where it is neither found nor a rival."""
        for found in (*self.effects, *self.rivals):
            if found.variant == effect_name:
                return found.covariate
        return ""


_FINDING = TypeAdapter(LoopFinding)


def read_loop_finding(output: Path) -> LoopFinding:
    """Read what a loop found from the folder that it wrote.

    Raises
    ------
    PipelineError
        If the file is none that the loop writes.
    """
    path = output / RESULT_FILE
    document = read_document(
        path, texts.LOOP_RESULT, PipelineError, most_bytes=_LARGEST_RESULT, file_format="JSON"
    )
    try:
        return _FINDING.validate_python(document)
    except ValidationError as error:
        raise PipelineError(texts.NO_LOOP_RESULT.format(path=path)) from error


def list_trial_agreements(session: Path, output: Path) -> list[TrialAgreement]:
    """List the ratios of measured to predicted figures, by the model of a session's loop.

    Parameters
    ----------
    session : Path
    output : Path
        Folder that the loop wrote, with its features and its model.

    Returns
    -------
    list of TrialAgreement
        In the order of the table of trials; those that were not measured are left out.

    Raises
    ------
    StepblocksError
        If a file cannot be read.
    """
    from stepblocks.files.tables import escape_formula, read_table
    from stepblocks.loop.session_table import read_trial_table
    from stepblocks.predict.learned import predict_trials

    predicted = predict_trials(read_trial_table(session), output / MODEL_FILE)
    features = read_table(output / FEATURES_FILE, ("trial", "block")).set_index("trial")
    measured = features.to_dict("index")
    agreements = []
    for row in predicted.to_dict("records"):
        trial = str(escape_formula(str(row["trial"])))  # as the features name it
        if trial not in measured:
            continue
        nominal = dict(_yield_ratios_to_prediction(measured[trial], row, "nominal_"))
        extended = dict(_yield_ratios_to_prediction(measured[trial], row, ""))
        if nominal or extended:
            block = str(measured[trial].get("block", ""))
            agreements.append(TrialAgreement(trial, block, nominal, extended))
    return agreements


def _yield_ratios_to_prediction(
    measured: Mapping[Hashable, object], predicted: Mapping[Hashable, object], column_prefix: str
) -> Iterator[tuple[Figure, float]]:
    """Yield each figure as measured over as predicted, where both are positive numbers."""
    for figure in Figure:
        numerator = _read_positive_number(measured.get(figure.value))
        denominator = _read_positive_number(predicted.get(f"{column_prefix}{figure.value}"))
        if numerator is not None and denominator is not None:
            yield figure, numerator / denominator


def _read_positive_number(cell: object) -> float | None:
    """Return the number of a cell; None where it holds none, or none above zero."""
    if not isinstance(cell, int | float) or not math.isfinite(cell) or cell <= 0.0:
        return None
    return float(cell)
