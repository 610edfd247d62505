"""What a session came to: fits, errors on held-out trials, and the model that was learned."""

from dataclasses import asdict, dataclass, replace
from html import escape
from typing import Any

import numpy as np
import pandas as pd

from stepblocks.files.figures import Axes
from stepblocks.lawsearch.findings import Explanation, Verdict
from stepblocks.lawsearch.holdout import Holdout
from stepblocks.lawsearch.problem import Fit
from stepblocks.loop.bench_model import convert_laws_to_dicts
from stepblocks.loop.figures import plot_agreement
from stepblocks.loop.finding import format_summary
from stepblocks.loop.record import LoopRecord, RecordChoice, UnusedScan
from stepblocks.loop.session_table import SessionTable
from stepblocks.loop.words import capitalise_first_letter
from stepblocks.records.model import LearnedFit, LearnedModel
from stepblocks.rig.effects.grammar.covariates import CovariateRange


@dataclass(frozen=True)
class LoopResult:
    """All that a session came to.

    Attributes
    ----------
    title : str
    table : SessionTable
        Trials analysed and excluded.
    found : Explanation
        Verdict, findings, fits.
    within : Holdout
        Errors on trials held out within blocks.
    between : Holdout
        Errors on blocks held out.
    record : LoopRecord
        Contents of result.json as objects.
    model : LearnedModel
        Contents of model.json.
    """

    title: str
    table: SessionTable
    found: Explanation
    within: Holdout
    between: Holdout
    record: LoopRecord
    model: LearnedModel

    @property
    def verdict(self) -> Verdict:
        """How it ended."""
        return self.found.verdict

    @property
    def document(self) -> dict[str, Any]:
        """Contents of result.json as plain values, without the number of the schema."""
        return self.record.as_document()

    def add_unused_scans(self, reasons: dict[str, str]) -> "LoopResult":
        """Return the result with the blocks whose scans could not be used, and why."""
        unused = [UnusedScan(block, reason) for block, reason in reasons.items()]
        scans = replace(self.record.scans, left_out=unused)
        return replace(self, record=replace(self.record, scans=scans))

    def add_record_choice(self, choice: RecordChoice, sentence: str) -> "LoopResult":
        """Return the result with what was chosen between features and whole records."""
        headline = (*self.record.headline, capitalise_first_letter(sentence))
        record = replace(self.record, record_choice=choice, headline=headline)
        return replace(self, record=record)

    def __repr__(self) -> str:
        return f"LoopResult({format_summary(self.record)})"

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw energies as measured against both models, into `ax` or new axes; return these."""
        return plot_agreement(self.found, ax)

    def _repr_html_(self) -> str:
        """Write title, verdict, finding and held-out errors for a notebook."""
        errors = pd.DataFrame(
            {
                "nominal": asdict(self.record.nominal.error),
                "extended": asdict(self.record.extended.error),
            }
        )
        rows = errors.drop(index="noise_floor").rename_axis("held-out error")
        table = str(rows.to_html(float_format="{:.3g}".format))
        finding = f"<b>{self.verdict}</b>. {escape(self.record.finding)}."
        return f"<p>{escape(self.title)}: {finding}</p>{table}"


def build_learned_model(
    table: SessionTable, explanation: Explanation, ranges: tuple[CovariateRange, ...]
) -> LearnedModel:
    """Build the model that was learned, from which trials are predicted without the session.

    Parameters
    ----------
    table : SessionTable
    explanation : Explanation
    ranges : tuple of CovariateRange
        Where the data lay.
    """
    model = table.model
    scatter = explanation.problem.noise.scatter
    return LearnedModel(
        verdict=str(explanation.verdict),
        tool=model.tool,
        tip_radius_um=table.tip_radius_um,
        height_std=model.height_std,
        scanned=model.scanned or {},
        blocks=tuple(np.unique(table.trials.block).tolist()),
        ranges=ranges,
        quantity_std=np.sqrt(scatter.quantities),
        channel_std=np.sqrt(scatter.channels),
        nominal=_make_learned_fit(explanation.nominal),
        extended=_make_learned_fit(explanation.extended),
        known_laws=convert_laws_to_dicts(model.laws),
    )


def _make_learned_fit(fitted: Fit) -> LearnedFit:
    """Keep of a fit what predictions need."""
    units = tuple(p.unit for p in fitted.parameters)
    return LearnedFit(fitted.values, units, fitted.covariance, fitted.effects)
