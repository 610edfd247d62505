"""Compare published figures with the model's answers: a table, a page and pictures."""

from __future__ import annotations

import html
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from literature.contradiction import BAND, HEIGHTS, Explanation, fit_explanations
from literature.questions import AT, QUESTIONS, Answers, find_dimension
from stepblocks.files.atomic import replace_text
from stepblocks.files.pages import render_page
from stepblocks.quantities import format_quantity, parse_quantity

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Value:
    """One published figure as a range, in SI."""

    label: str
    low: float
    high: float
    at: Mapping[str, Any]  # condition under which the model is asked
    spread: str = ""  # whose the range is, where the publication gives none


def _read_value(question: str, raw: Mapping[str, Any]) -> Value:
    at = {
        key: parse_quantity(text, AT[key]) if AT[key] else text
        for key, text in raw.get("at", {}).items()
    }
    ends = {end: parse_quantity(raw[end], find_dimension(question, at)) for end in ("low", "high")}
    return Value(**{**raw, **ends, "at": at})


@dataclass(frozen=True)
class Published:
    """What one publication says."""

    name: str  # of its file
    order: int  # on the page
    topic: str
    citation: str
    says: str
    question: str  # what the model is asked: a key of `literature.questions.QUESTIONS`
    values: tuple[Value, ...]
    note: str = ""  # how it is asked


def load_published() -> list[Published]:
    """All publications of the package, in the order of the page."""
    found = []
    for path in Path(__file__).with_name("published").glob("*.toml"):
        raw = tomllib.loads(path.read_text(encoding="utf-8"))
        values = tuple(_read_value(raw["question"], one) for one in raw.pop("value"))
        found.append(Published(path.stem, values=values, **raw))
    return sorted(found, key=lambda one: (one.order, one.name))


class Verdict(StrEnum):
    """Whether the model says what was published."""

    AGREES = "agrees"  # every answer lies in the published range
    DISAGREES = "disagrees"
    NOT_SAID = "not said"


@dataclass(frozen=True)
class Row:
    """One published figure and what the model says to it."""

    publication: Published
    value: Value
    answers: Answers

    @property
    def verdict(self) -> Verdict:
        """Agrees only where every answer lies in the published range."""
        known = self.answers.known()
        if not known:
            return Verdict.NOT_SAID
        inside = all(
            self.value.low * (1.0 - 1e-9) <= one <= self.value.high * (1.0 + 1e-9)
            for one in known.values()
        )
        return Verdict.AGREES if inside else Verdict.DISAGREES

    def texts(self) -> dict[str, str]:
        """Say the row in words, units in the values."""
        dimension = find_dimension(self.publication.question, self.value.at)
        known = {
            name: format_quantity(value, dimension, 3)
            for name, value in self.answers.known().items()
        }
        low, high = (
            format_quantity(value, dimension, 3) for value in (self.value.low, self.value.high)
        )
        return {
            "topic": self.publication.topic,
            "figure": self.value.label,
            "published": f"{low} to {high}",
            **{name: known.get(name, "") for name in ("formula", "drag", "rod")},
            "verdict": str(self.verdict),
            "said": self.answers.said,
        }


@dataclass(frozen=True)
class Evidence:
    """What others published, beside what the model says."""

    rows: tuple[Row, ...]
    # of the paper's contradiction: equation (1) as it stands, then its rivals
    explanations: tuple[Explanation, ...]

    @property
    def table(self) -> pd.DataFrame:
        """One row per published figure."""
        import pandas as pd

        return pd.DataFrame([row.texts() for row in self.rows])

    @property
    def resolutions(self) -> pd.DataFrame:
        """What would resolve the contradiction: error before (first row) and after, best first."""
        import pandas as pd

        rows = [
            {
                "explanation": one.name,
                "fitted": str(one.numbers),
                "setting": one.setting,
                "energies": ", ".join(f"{energy * 1e6:.3g}" for energy in one.energies) + " uJ",
                "misses the band by a factor of": f"{one.missed:.2f}",
                "other statements kept": "{} of {}".format(*one.facts()),
            }
            for one in self.explanations
        ]
        return pd.DataFrame(rows)

    def finding(self) -> str:
        """Say the outcome in two sentences."""
        counts = {verdict: sum(row.verdict is verdict for row in self.rows) for verdict in Verdict}
        before, best = self.explanations[0], self.explanations[1]
        held, of = best.facts()
        return (
            f"Of {len(self.rows)} published figures the model agrees with "
            f"{counts[Verdict.AGREES]}, disagrees with "
            f"{counts[Verdict.DISAGREES]} and says nothing of {counts[Verdict.NOT_SAID]}. The "
            "paper's energies miss equation (1) "
            f"at one load by a factor of {before.missed:.1f}; {best.name} leaves "
            f"{best.missed:.2f}, with {best.numbers} "
            f"fitted, and keeps {held} of {of} of its other statements."
        )

    def _repr_html_(self) -> str:
        tables = (one.to_html(index=False) for one in (self.table, self.resolutions))
        return f"<p>{html.escape(self.finding())}</p>{''.join(tables)}"


def hold_against_evidence(output: str | Path | None = None) -> Evidence:
    """Compare the model with what others published.

    Parameters
    ----------
    output : str or Path, optional
        Folder for ``evidence.html``, ``evidence.csv``, ``resolutions.csv`` and their pictures.

    Returns
    -------
    Evidence
        A row per published figure with verdict, and what would resolve the paper's own
        contradiction.

    Raises
    ------
    StepblocksError
        If the folder cannot be written.

    Examples
    --------
    >>> before, *rivals = hold_against_evidence().explanations
    >>> f"one load spreads the paper's four energies by a factor of {before.spread:.0f}"
    "one load spreads the paper's four energies by a factor of 353"
    """
    rows = [
        Row(one, value, QUESTIONS[one.question][0](value.at))
        for one in load_published()
        for value in one.values
    ]
    found = Evidence(tuple(rows), tuple(fit_explanations()))
    if output is not None:
        write_evidence(found, Path(output))
    return found


def write_evidence(found: Evidence, folder: Path) -> None:
    """Write tables, pictures and the page."""
    from stepblocks.files.figures import save_figure
    from stepblocks.files.tables import write_table

    folder.mkdir(parents=True, exist_ok=True)
    write_table(found.table, folder / "evidence.csv")
    write_table(found.resolutions, folder / "resolutions.csv")
    save_figure(_draw_ratios(found), folder / "evidence.svg")
    save_figure(_draw_energies(found), folder / "resolutions.svg")
    publications = {id(row.publication): row.publication for row in found.rows}.values()
    topics = [(one, [row for row in found.rows if row.publication is one]) for one in publications]
    told = {
        "finding": found.finding(),
        "publications": topics,
        "resolutions": found.resolutions.to_dict("records"),
    }
    replace_text(folder / "evidence.html", render_page("literature", "evidence.html.j2", **told))


_MARKS = {"formula": ("o", "#1d2a36"), "drag": ("s", "#1f6f8b"), "rod": ("^", "#c8553d")}


def _draw_ratios(found: Evidence) -> Any:
    """Draw every answer over the middle of its published range, which is a bar."""
    from stepblocks.files.figures import make_figure_and_axes

    rows = [row for row in found.rows if row.answers.known() and row.value.low > 0.0][::-1]
    figure, axis = make_figure_and_axes(width=9.0, height=0.32 * len(rows) + 1.2)
    for place, row in enumerate(rows):
        middle = (row.value.low * row.value.high) ** 0.5
        ends = [row.value.low / middle, row.value.high / middle]
        axis.plot(ends, [place, place], lw=7, color="#b9c6d2", solid_capstyle="butt")
        for name, value in row.answers.known().items():
            mark, colour = _MARKS[name]
            axis.plot(value / middle, place, mark, color=colour, ms=5, label=name)
    axis.set_xscale("log")
    axis.set_yticks(
        range(len(rows)),
        [f"{row.publication.topic}: {row.value.label}" for row in rows],
        fontsize=7,
    )
    axis.set_xlabel("over the middle of the published range (bar)")
    handles = {
        label: handle for handle, label in zip(*axis.get_legend_handles_labels(), strict=True)
    }
    axis.legend(handles.values(), handles.keys(), fontsize=8, loc="lower right")
    return figure


def _draw_energies(found: Evidence) -> Any:
    """Draw the energies of the four blocks by every explanation, and the paper's band."""
    from stepblocks.files.figures import make_figure_and_axes

    figure, axis = make_figure_and_axes(width=8.0, height=4.2)
    axis.axhspan(BAND[0] * 1e6, BAND[1] * 1e6, color="#dfe7ee", label="the paper: 10 to 20 uJ")
    for number, one in enumerate(found.explanations):
        style = {"lw": 2.4, "color": "#1d2a36"} if number == 0 else {"lw": 1.3}
        axis.plot(
            [h * 1e6 for h in HEIGHTS],
            [e * 1e6 for e in one.energies],
            "o-",
            ms=4,
            label=one.name,
            **style,
        )
    axis.set_yscale("log")
    axis.set_xlabel("step height, um")
    axis.set_ylabel("vibration energy, uJ")
    axis.legend(fontsize=7)
    return figure
