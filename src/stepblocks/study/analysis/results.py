"""The result of a study, as objects, tables and figures."""

import html
from dataclasses import dataclass
from functools import cached_property

import pandas as pd

from stepblocks.files.figures import Axes
from stepblocks.files.tables import format_csv
from stepblocks.study.analysis.figures import draw_main_figure
from stepblocks.study.analysis.findings import Analysis, Finding
from stepblocks.study.analysis.result_table import COLUMNS, ResultRow, iterate_result_rows

# columns of the judgements that are lengths [m]
_LENGTHS = ("height", "estimate", "error", "standard")


@dataclass(frozen=True, kw_only=True)
class StudyResult(Analysis):
    """Findings of a study; what an experiment does not have is empty.

    Attributes
    ----------
    experiment : str
        One of `stepblocks.study.experiments.registry.EXPERIMENTS`.
    notes : tuple of str
        On missing judgements and on participants who differ.
    primary, reference : str
        Outcome that the design names, and the condition that others are compared with.
    frame, measures, remarks, ordinal, comparisons, contrasts, power_laws, exponents, log_errors
        As in `Analysis`.
    """

    experiment: str
    notes: tuple[str, ...] = ()
    primary: str = ""
    reference: str = ""

    @classmethod
    def from_analysis(
        cls,
        analysis: Analysis,
        experiment: str,
        notes: tuple[str, ...] = (),
        primary: str = "",
        reference: str = "",
    ) -> "StudyResult":
        """Make the result of an experiment from what its analysis found."""
        return cls(
            experiment=experiment,
            notes=notes,
            primary=primary,
            reference=reference,
            frame=analysis.frame,
            measures=analysis.measures,
            remarks=analysis.remarks,
            ordinal=analysis.ordinal,
            comparisons=analysis.comparisons,
            contrasts=analysis.contrasts,
            power_laws=analysis.power_laws,
            exponents=analysis.exponents,
            log_errors=analysis.log_errors,
        )

    def findings(self) -> tuple[Finding, ...]:
        """Return the planned tests, the primary one first."""
        return self.summarise_findings(self.primary)

    @cached_property
    def rows(self) -> tuple[ResultRow, ...]:
        """Every figure with its unit."""
        # fits of all but one participant are among them: they are made once
        return tuple(iterate_result_rows(self, self.findings()))

    def table(self) -> pd.DataFrame:
        """Lay out every figure with its unit, in `COLUMNS`; NaN where a row has none."""
        return pd.DataFrame([row.list_cells() for row in self.rows], columns=COLUMNS)

    def results_csv(self) -> str:
        """Write the table."""
        return format_csv(self.table(), float_format="%.8g")

    def judgements_csv(self) -> str:
        """Write the judgements as they were analysed, lengths in micrometres."""
        known = self.frame.columns.intersection(list(_LENGTHS))
        lengths = self.frame[[*known]].map(lambda value: f"{value * 1e6:.9g}")
        names = {name: f"{name}_um" for name in _LENGTHS}
        return format_csv(self.frame.assign(**lengths).rename(columns=names))

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the main figure of the study.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; by default a new figure.

        Returns
        -------
        matplotlib Axes
            That were drawn on.
        """
        return draw_main_figure(self, ax)

    def __repr__(self) -> str:
        outcome = ""
        for finding in self.findings():
            if finding.primary:
                outcome = f", {finding.name}: p = {finding.p:.3g}"
        people = self.frame["participant"].nunique()
        return (
            f"<StudyResult {self.experiment}: {people} participants, "
            f"{len(self.frame)} judgements{outcome}>"
        )

    def _repr_html_(self) -> str:
        notes = "".join(f"<p>{html.escape(note)}</p>" for note in self.notes)
        table = self.table().to_html(index=False, na_rep="", float_format="{:.4g}".format)
        return f"{notes}{table}"
