"""What a paper prints of a study: descriptives and tests as the APA asks for them."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from stepblocks.study.analysis.accuracy import Measure
from stepblocks.study.analysis.anova import Interval, Term
from stepblocks.study.analysis.findings import Finding, MeasureTest
from stepblocks.study.analysis.log_error import LogError
from stepblocks.study.analysis.prose import format_apa_p, format_df, format_f_test
from stepblocks.study.analysis.repeated import (
    compute_effect_size_interval,
    compute_null_bayes_factor,
)
from stepblocks.study.analysis.results import StudyResult

_MICROMETRE = 1e6  # per metre
_LATEX = {"&": r"\&", "%": r"\%", "_": r"\_", "#": r"\#", "²": r"$^2$", "η": r"$\eta$"}
_LATEX |= {"−": "$-$", "µ": r"$\mu$", "<": "$<$"}


@dataclass(frozen=True)
class PaperTable:
    """One table of a paper.

    Attributes
    ----------
    title : str
        What it shows.
    heads : tuple of str
        Of the columns.
    rows : tuple of tuple of str
        Cells as they are printed.
    note : str
        What stands below it.
    """

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""


@dataclass(frozen=True)
class Cell:
    """A measure in one condition, on one block.

    Attributes
    ----------
    condition, block : str
        Which cell; the block is empty where the measure is one figure over all blocks.
    mean, deviation : float
        Over the participants' means, in the unit of the measure.
    people : int
        Participants in the cell.
    """

    condition: str
    block: str
    mean: float
    deviation: float
    people: int


def iterate_cells(measure: Measure) -> Iterator[Cell]:
    """Yield mean and standard deviation over participants of every condition and block."""
    keys = ["condition"]
    if "stimulus" in measure.frame:
        keys.append("stimulus")
    by_participant = measure.frame.groupby([*keys, "participant"])["value"].mean()
    for cell, values in by_participant.groupby(level=keys):
        names = cell if isinstance(cell, tuple) else (cell,)
        block = str(names[1]) if len(names) > 1 else ""
        deviation = math.nan
        if len(values) > 1:
            deviation = float(values.std())
        yield Cell(str(names[0]), block, float(values.mean()), deviation, len(values))


def build_paper_tables(result: StudyResult) -> list[PaperTable]:
    """List the tables of a study's measures of accuracy, the primary outcome first."""
    tables = []
    for finding in result.findings():
        if not isinstance(finding.test, MeasureTest):
            continue
        measure = finding.test.measure
        tables.append(_tabulate_cells(measure))
        tables.append(_tabulate_tests(measure, finding))
        if measure.paired:
            tables.append(_tabulate_pairs(measure))
    if result.log_errors:
        tables.append(_tabulate_log_errors(result.log_errors))
    return tables


def _tabulate_log_errors(errors: Sequence[LogError]) -> PaperTable:
    """Lay out mean and root mean square of the error of the logarithm."""
    rows = []
    for error in errors:
        figures = []
        for value, low, high in (error.mean, error.rms):
            figures += [f"{value:.3f}", f"[{low:.3f}, {high:.3f}]"]
        cells = (error.condition or "all", *figures, str(error.people))
        rows.append(tuple(map(_replace_hyphens_by_minus, cells)))
    return PaperTable(
        "Error of the logarithm, ln(estimate / height)",
        ("Condition", "M", "95 % CI", "RMS", "95 % CI", "n"),
        tuple(rows),
        "Over the participants' means, and over their mean squares, with Student's intervals.",
    )


def _get_unit_name(measure: Measure) -> str:
    """Name the unit in which a measure is printed."""
    if measure.is_logarithmic:
        return "ln(m)"
    return "µm"


def _format_measure_value(value: float, measure: Measure) -> str:
    """Write a value of a measure [SI] in its unit."""
    if math.isnan(value):
        return ""
    size = value
    if not measure.is_logarithmic:
        size = value * _MICROMETRE
    return _replace_hyphens_by_minus(f"{size:.2f}")


def _tabulate_cells(measure: Measure) -> PaperTable:
    """Lay out M, SD and n of every cell."""
    rows = []
    for cell in iterate_cells(measure):
        mean = _format_measure_value(cell.mean, measure)
        deviation = _format_measure_value(cell.deviation, measure)
        rows.append((cell.condition, cell.block, mean, deviation, str(cell.people)))
    return PaperTable(
        f"Descriptives of the {measure.name} ({_get_unit_name(measure)})",
        ("Condition", "Block", "M", "SD", "n"),
        tuple(rows),
        "M and SD are over the means of participants.",
    )


def _tabulate_tests(measure: Measure, finding: Finding) -> PaperTable:
    """Lay out the F tests of conditions and factors."""
    rows = []
    if measure.corrected is not None:
        rows.append(_format_term_cells(measure.corrected, finding.corrected))
    for term in (*measure.factors, *measure.groups):
        rows.append(_format_term_cells(term, term.p))
    return PaperTable(
        f"Tests of the {measure.name}",
        ("Effect", "F test", "p", "partial η²", "95 % CI"),
        tuple(rows),
        "Degrees of freedom are multiplied by Huynh and Feldt's epsilon; p of the condition is "
        "corrected by Holm's method where the outcome is a secondary one.",
    )


def _format_term_cells(term: Term, p: float) -> tuple[str, ...]:
    """Write an F test as cells."""
    test = format_f_test(term).partition(", p ")[0]
    interval = f"[{term.eta_low:.2f}, {term.eta_high:.2f}]".replace("0.", ".")
    eta = f"{term.eta_squared:.2f}".replace("0.", ".", 1)
    return term.name, test, format_apa_p(p).removeprefix("= "), eta, interval


def _tabulate_pairs(measure: Measure) -> PaperTable:
    """Lay out the paired differences: t, p, d with its interval, and BF01."""
    rows = [_format_pair_cells(interval, measure) for interval in measure.paired]
    return PaperTable(
        f"Pairs of conditions, {measure.name} ({_get_unit_name(measure)})",
        ("Pair", "Difference", "95 % CI", "t", "p", "d", "95 % CI of d", "BF01"),
        tuple(rows),
        "Differences are those of the participants; intervals and p hold together (Games and "
        "Howell); d is the mean over the standard deviation of the differences; BF01 is of a "
        "paired t test with a Cauchy prior of scale 0.707.",
    )


def _format_pair_cells(interval: Interval, measure: Measure) -> tuple[str, ...]:
    """Write a paired difference as cells."""
    t = interval.difference / interval.error
    people = interval.df + 1.0
    low, high = compute_effect_size_interval(t, people)
    lower_bound = _format_measure_value(interval.low, measure)
    upper_bound = _format_measure_value(interval.high, measure)
    return (
        f"{interval.first} − {interval.second}",
        _format_measure_value(interval.difference, measure),
        f"[{lower_bound}, {upper_bound}]",
        _replace_hyphens_by_minus(f"t({format_df(interval.df)}) = {t:.2f}"),
        format_apa_p(interval.p).removeprefix("= "),
        _replace_hyphens_by_minus(f"{interval.effect_size:.2f}"),
        _replace_hyphens_by_minus(f"[{low:.2f}, {high:.2f}]"),
        f"{compute_null_bayes_factor(t, people):.3g}",
    )


def _replace_hyphens_by_minus(text: str) -> str:
    """Write hyphens before numbers as minus signs."""
    return text.replace("-", "−")


def format_markdown(tables: Sequence[PaperTable]) -> str:
    """Write tables as Markdown, numbered."""
    lines = []
    for number, table in enumerate(tables, start=1):
        lines += [f"**Table {number}**", "", f"*{table.title}*", ""]
        lines.append(f"| {' | '.join(table.heads)} |")
        lines.append(f"|{'---|' * len(table.heads)}")
        for row in table.rows:
            lines.append(f"| {' | '.join(row)} |")
        lines += ["", f"*Note.* {table.note}", ""]
    return "\n".join(lines)


def format_latex(tables: Sequence[PaperTable]) -> str:
    """Write tables as LaTeX, for booktabs."""
    lines = [r"% needs \usepackage{booktabs}"]
    for table in tables:
        lines += [
            "",
            r"\begin{table}",
            rf"\caption{{{_escape_latex(table.title)}}}",
            rf"\begin{{tabular}}{{{'l' * len(table.heads)}}}",
            r"\toprule",
            _format_latex_row(table.heads),
            r"\midrule",
        ]
        lines += map(_format_latex_row, table.rows)
        lines += [
            r"\bottomrule",
            r"\end{tabular}",
            "",
            rf"\textit{{Note.}} {_escape_latex(table.note)}",
        ]
        lines.append(r"\end{table}")
    return "\n".join(lines) + "\n"


def _format_latex_row(cells: Sequence[str]) -> str:
    """Write a row of a LaTeX table."""
    return " & ".join(map(_escape_latex, cells)) + r" \\"


def _escape_latex(text: str) -> str:
    """Escape what LaTeX reads as its own."""
    return "".join(_LATEX.get(letter, letter) for letter in text)
