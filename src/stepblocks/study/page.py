"""The page of a study: figures, tables, checks; one file that needs no network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from stepblocks.study.figures import study_figures

_TITLES = {
    "estimates": "Errors of height estimates",
    "virtual": "Virtual blocks: errors and realism",
    "constant": "Comparison with a standard",
    "magnitude": "Magnitude estimation",
}
_WHAT = {
    "f-test": "The paper's analysis: an F-test on the errors of the estimates, blocks as second factor. It takes every judgement for "
    "independent of all others, which judgements of one participant are not; the mixed model below does not.",
    "tukey": "Tukey's family: all intervals hold together with 95 %.",
    "mixed model": "Participants and their response to each condition are random; restricted maximum likelihood; the F-test of the "
    "condition has (participants - 1)(conditions - 1) degrees of freedom, its intervals hold together with 95 %.",
    "check": "No objection is no proof. A doubt says what to look at, not that the analysis is void.",
    "ordinal model": "Proportional odds, each participant with an own level; intervals and the F-test take the participants as "
    "clusters. Read the F-test: the likelihood ratio keeps its level only where all participants take to the vibration alike.",
    "psychometric function": "Cumulative normal in the logarithm of the height, maximum likelihood, one lapse rate for both ends. The "
    "Weber fraction is the step from the middle to three quarters of the rise.",
    "power law": "Straight lines through logarithms, each participant with an own modulus.",
}


def render_study(result: Any, rows: Sequence[Mapping[str, str]]) -> str:
    """Draw the page of a study."""
    tables: dict[str, list[Mapping[str, str]]] = {}
    for row in rows:
        tables.setdefault(row["analysis"], []).append(row)
    said = result.mixed.remarks if result.mixed is not None else ()
    return _render(
        "study.html",
        title=_TITLES[result.experiment],
        notes=[*result.notes, *said],
        figures=study_figures(result),
        tables=[(name, _WHAT[name], [_shown(row) for row in own]) for name, own in tables.items()],
        checks=result.checks,
    )


def render_table(rows: Sequence[Mapping[str, str]]) -> str:
    """Write a table for a terminal."""
    columns = list(rows[0])
    widths = {name: max(len(name), *(len(row[name]) for row in rows)) for name in columns}
    lines = [{name: name for name in columns}, *rows]
    return "".join("  ".join(row[name].ljust(widths[name]) for name in columns).rstrip() + "\n" for row in lines)


def _shown(row: Mapping[str, str]) -> dict[str, str]:
    """Four digits are read; all of them stand in the table."""
    figures = ("estimate", "low_95", "high_95", "statistic", "p")
    return {name: f"{float(text):.4g}" if name in figures and text else text for name, text in row.items()}


def _render(template: str, **values: object) -> str:
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("stepblocks.study", "templates"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
    )
    return environment.get_template(template).render(**values)
