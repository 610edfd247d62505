"""Many scans: what repeats and what reproduces, by analysis of variance; what a batch is capable of; a control chart.

A table names the scans (``scan``), their part and block, and every other column is a condition
under which they were taken: day, line, direction, operator. Of a block that was scanned several
times the scatter of its scans takes the place of what each scan says of its own noise; what the
instrument owes and the form of the surface do not average.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stepblocks.atomic import replace_text, resolve_inside
from stepblocks.errors import MetrologyError, PipelineError
from stepblocks.figure_file import make_figure, save_figure
from stepblocks.inspect.budget import Component, Measured, Outcome, combine_verdicts, judge
from stepblocks.inspect.noise import Array
from stepblocks.inspect.run import inspect_scan, inspect_standard
from stepblocks.page_file import render_page
from stepblocks.tables import find_misspelt_columns, read_table, write_table
from stepblocks.text_file import format_file_name

if TYPE_CHECKING:
    import pandas as pd

_OWN = ["scan", "stimulus", "block"]  # columns that are no condition
_LENGTHS = ("value", "u", "u95", "lower", "upper", "centre", "std", "mean", "scatter")
_SCATTER = ("noise", "repeatability", "scatter")  # of one scan, which several show together
_LEAD = (
    "ISO 14253-1. Of a block that was scanned several times the scatter of its scans stands in "
    "the budget: repeatability, and what "
    "each condition adds, by analysis of variance with interactions pooled."
)
_D2 = 2.0 / math.sqrt(math.pi)  # mean range of two normal values over their standard deviation [1]


@dataclass(frozen=True)
class ManyScans:
    """What many scans say together, by table; lengths in micrometres, as their columns say."""

    tables: Mapping[str, pd.DataFrame]  # blocks, variation, capability, chart, scans
    left_out: tuple[str, ...]  # scans that could not be evaluated, and why
    verdict: Outcome  # over all blocks

    def as_record(self) -> dict[str, Any]:
        """Return plain data; what is infinite or does not exist is null."""
        said = self.tables.items()
        tables = {
            name: json.loads(one.to_json(orient="records", double_precision=15))
            for name, one in said
        }
        return {"verdict": self.verdict.value, "left_out": list(self.left_out), **tables}


def inspect_many(
    scans: Sequence[str | Path],
    stimulus: str | None = None,
    *,
    standard: float | None = None,
    **told: Any,
) -> ManyScans:
    """Evaluate many scans of one block or of a batch, and say what repeats, what reproduces and what the batch is capable of.

    Parameters
    ----------
    scans : sequence of str or Path
        Scans of one block; or a folder of them; or one table with a column ``scan`` (and a folder
        that holds ``scans.csv``), beside it ``stimulus`` and ``block`` where they differ, and a
        column for every condition, such as ``day`` or ``direction``.
    stimulus : str, optional
        Identity of the part of every scan whose table does not say it.
    standard : float, optional
        Instead of a stimulus, the certified depth of a standard [m], as `inspect_standard` takes
        it.
    **told
        What `inspect_scan`, or `inspect_standard`, takes besides.

    Returns
    -------
    ManyScans
        Values by block with repeatability and reproducibility in their budgets (AIAG, Measurement
        Systems Analysis, 4th ed., ANOVA with interactions pooled), capability with 95 % intervals
        and limits of a chart of individuals (NIST/SEMATECH e-Handbook of Statistical Methods, 6.1.6
        and 6.3.2.2); `write_many` writes them.

    Raises
    ------
    MetrologyError
        If no scan can be evaluated.
    PipelineError
        If the table does not name its scans, or a stimulus is not declared.
    """
    import pandas as pd

    asked = _list_scans(
        [Path(one) for one in scans], stimulus or ("standard" if standard is not None else None)
    )
    factors = [name for name in asked.columns if name not in _OWN]
    rows, left_out = [], []
    for own in asked.to_dict("records"):
        name = format_file_name(own["scan"].name)
        try:
            if standard is not None:
                result = inspect_standard(own["scan"], standard, **told)
            else:
                result = inspect_scan(own["scan"], own["stimulus"], **told)
        except MetrologyError as error:
            left_out.append(f"{name}: {error}")
            continue
        for one, decision in result.judged:
            found = {"measured": result.inspected.values[one.key], "asked": one}
            verdict = {
                "verdict": decision.verdict.value,
                "value": decision.value,
                "u": decision.std,
            }
            rows.append({**own, "scan": name, "characteristic": one.key, **found, **verdict})
    if not rows:
        raise MetrologyError(f"no scan can be evaluated: {left_out[0]}")
    table = pd.DataFrame(rows)
    said: dict[str, list[dict[str, Any]]] = {
        name: [] for name in ("blocks", "variation", "capability", "chart")
    }
    decisions = []
    for (part, key), own in table.groupby(["stimulus", "characteristic"], sort=False):
        about, one = {"stimulus": part, "characteristic": key}, own["asked"].iloc[0]
        sources = estimate_variance_components(own[["value", "block", *factors]])
        said["variation"] += [about | source for source in sources]
        for block, its in own.groupby("block", sort=False):
            measured = _average_block(key, its, sources)
            decision = judge(measured, one.nominal, one.lower, one.upper)
            decisions.append(decision)
            row = {"block": block, "scans": len(its), "value": decision.value, "u": decision.std}
            row |= {"u95": measured.expanded(), "lower": decision.lower, "upper": decision.upper}
            said["blocks"].append({**about, **row, "verdict": decision.verdict.value})
        means = own.groupby("block", sort=False)["value"].mean()
        if len(means) > 2:
            said["capability"].append(
                about | compute_capability(means.to_numpy(), decision.lower, decision.upper)
            )
        points = means if len(means) > 2 else own.set_index("scan")["value"]
        centre, half = compute_chart_limits(points.to_numpy())
        for name, value in points.items():
            row = {
                "point": name,
                "value": value,
                "centre": centre,
                "lower": centre - half,
                "upper": centre + half,
            }
            said["chart"].append({**about, **row, "outside": bool(abs(value - centre) > half)})
    tables = {name: _convert_to_um(pd.DataFrame(own)) for name, own in said.items()}
    tables["scans"] = _convert_to_um(table).drop(columns=["measured", "asked"])
    return ManyScans(tables, tuple(left_out), combine_verdicts(decisions))


def _convert_to_um(table: pd.DataFrame) -> pd.DataFrame:
    """Give columns of lengths their unit."""
    lengths = [name for name in table if name in _LENGTHS]
    table[lengths] *= 1e6
    return table.rename(columns={name: f"{name}_um" for name in lengths})


def _list_scans(paths: Sequence[Path], stimulus: str | None) -> pd.DataFrame:
    """Name the scans with their parts, blocks and conditions."""
    import pandas as pd

    if len(paths) == 1 and paths[0].is_dir():
        table = paths[0] / "scans.csv"
        within = sorted(
            one for one in paths[0].iterdir() if one.is_file() and not one.name.startswith(".")
        )
        paths = [table] if table.is_file() else within
        if not paths:
            raise PipelineError(f"folder must hold scans, got none [{table.parent}]")
    if is_table(paths):
        frame = read_table(paths[0])
        for column, likely in find_misspelt_columns(frame, _OWN).items():
            raise PipelineError(f"column {column!r} is not known, is it {likely!r}? [{paths[0]}]")
        found = [resolve_inside(paths[0].parent, str(name)) for name in frame["scan"]]
        if None in found:
            name = frame["scan"].iloc[found.index(None)]
            raise PipelineError(
                f"scan must lie in the folder of the table, got {name!r} [{paths[0]}]"
            )
        frame = frame.assign(scan=found)
    else:
        frame = pd.DataFrame({"scan": list(paths)})
    if "stimulus" not in frame:
        if stimulus is None:
            raise PipelineError(
                "stimulus must be said, by --stimulus or by a column of the table, got none"
            )
        frame = frame.assign(stimulus=stimulus)
    return frame if "block" in frame else frame.assign(block=frame["stimulus"])


def is_table(paths: Sequence[Path]) -> bool:
    """Say whether what is given is one table that names scans."""
    if len(paths) != 1 or paths[0].suffix.lower() != ".csv" or not paths[0].is_file():
        return False
    with paths[0].open(encoding="utf-8-sig", errors="replace") as file:
        return "scan" in [name.strip() for name in file.readline(10_000).split(",")]


def estimate_variance_components(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Return the standard deviation by source of variation of ``value``: each other column by itself, and what repeats."""
    # Random effects by their expected mean squares, interactions pooled with the repeatability.
    # Where none is repeated under its own conditions, what these change counts as repeatability;
    # nothing where every block was scanned once.
    import numpy as np
    import pandas as pd
    from statsmodels.formula.api import ols
    from statsmodels.stats.anova import anova_lm

    names = {f"f{index}": name for index, name in enumerate(table.columns.drop("value"))}
    frame = table.rename(columns={name: short for short, name in names.items()})
    varied = [short for short in names if frame[short].nunique() > 1]
    levels = np.hstack(
        [np.ones((len(frame), 1)), *(pd.get_dummies(frame[short]) for short in varied)]
    ).astype(float)
    if np.linalg.matrix_rank(levels) < levels.shape[1] - len(varied):
        named = " and ".join(names[short] for short in varied)
        raise PipelineError(
            f"conditions must not change together, whose effects cannot be told apart, got {named}"
        )
    fit = ols(" + ".join(["value ~ 1", *(f"C({short})" for short in varied)]), frame).fit()
    if fit.df_resid < 1.0:
        return (
            estimate_variance_components(table[["value", "block"]])
            if len(table.columns) > 2
            else []
        )
    squares, error = anova_lm(fit, typ=2), float(fit.mse_resid)
    found = [
        {
            "source": "repeatability",
            "std": math.sqrt(error),
            "dof": float(fit.df_resid),
            "levels": len(frame),
        }
    ]
    for short in varied:
        row = squares.loc[f"C({short})"]
        counts = frame[short].value_counts()
        each = float(len(frame) - (counts**2).sum() / len(frame)) / (len(counts) - 1.0)
        mean = float(row["sum_sq"] / row["df"])
        beyond = max(mean - error, 0.0)
        dof = (
            beyond**2 / (mean**2 / row["df"] + error**2 / fit.df_resid)
            if beyond > 0.0
            else math.inf
        )
        std = math.sqrt(beyond / each)
        found.append({"source": names[short], "std": std, "dof": float(dof), "levels": len(counts)})
    return found


def _average_block(key: str, its: pd.DataFrame, sources: Sequence[Mapping[str, Any]]) -> Measured:
    """Mean over the scans of a block: the scatter over all scans in place of their own, and what does not average."""
    budgets: list[Measured] = list(its["measured"])
    if not sources:
        return budgets[0]
    parts = []
    for one in sources:
        if one["source"] == "block":
            continue
        count = len(its) if one["source"] == "repeatability" else its[one["source"]].nunique()
        name = (
            one["source"]
            if one["source"] == "repeatability"
            else f"reproducibility over {one['source']}"
        )
        how = f"analysis of variance, {count} of this block"
        parts.append(Component(name, one["std"] / math.sqrt(count), one["dof"], how))
    shared = [part.name for part in budgets[0].components if part.name not in _SCATTER]
    for name in shared:
        stds = [part.std for one in budgets for part in one.components if part.name == name]
        parts.append(
            Component(name, sum(stds) / len(stds), how="mean of that of the scans, which all share")
        )
    return Measured(key.replace("_", " "), float(its["value"].mean()), tuple(parts))


def compute_capability(
    values: Array, lower: float, upper: float, level: float = 0.95
) -> dict[str, float]:
    """Cp and Cpk of a batch with their intervals (NIST/SEMATECH e-Handbook, 6.1.6); Cp is nan where a limit is infinite."""
    # Blocks that measure alike to the last digit are copies of one scan: their scatter says
    # nothing, and neither index exists.
    from scipy import stats

    count, mean, scatter = len(values), float(values.mean()), float(values.std(ddof=1)) or math.nan
    cp = (upper - lower) / (6.0 * scatter) if math.isfinite(upper - lower) else math.nan
    cpk = min(upper - mean, mean - lower) / (3.0 * scatter)
    tails = 0.5 - 0.5 * level, 0.5 + 0.5 * level
    low, high = (math.sqrt(stats.chi2.ppf(tail, count - 1) / (count - 1)) for tail in tails)
    half = float(stats.norm.ppf(0.5 + 0.5 * level)) * math.sqrt(
        1.0 / (9.0 * count) + cpk**2 / (2.0 * (count - 1))
    )
    found = {
        "count": count,
        "mean": mean,
        "scatter": scatter,
        "cp": cp,
        "cp_low": cp * low,
        "cp_high": cp * high,
    }
    return found | {"cpk": cpk, "cpk_low": cpk - half, "cpk_high": cpk + half}


def compute_chart_limits(values: Array) -> tuple[float, float]:
    """Centre of a chart of individuals, and its limits' distance: three mean moving ranges over d2 (NIST/SEMATECH, 6.3.2.2)."""
    import numpy as np

    return float(np.mean(values)), 3.0 * float(np.mean(np.abs(np.diff(values)))) / _D2 if len(
        values
    ) > 1 else math.inf


def write_many(result: ManyScans, folder: str | Path) -> list[Path]:
    """Write one table and one page of what many scans say.

    Parameters
    ----------
    result : ManyScans
        From `inspect_many`.
    folder : str or Path
        Made where it is missing.

    Returns
    -------
    list of Path
        Scans (CSV), the page with all tables (HTML) and its control chart (SVG).
    """
    base = Path(folder)
    base.mkdir(parents=True, exist_ok=True)
    table, page, chart = (
        base / name for name in ("inspections.csv", "inspections.html", "inspections.svg")
    )
    write_table(result.tables["scans"], table)
    groups = list(result.tables["chart"].groupby(["stimulus", "characteristic"], sort=False))
    figure, _ = make_figure(len(groups), 1, width=9.0, height=0.6 + 2.0 * len(groups))
    for axis, ((part, key), own) in zip(figure.axes, groups, strict=True):
        axis.plot(own["point"], own["value_um"], "o-", color="#1d2a36", ms=4, lw=0.8)
        axis.plot(
            own["point"][own["outside"]],
            own["value_um"][own["outside"]],
            "o",
            color="#b3261e",
            ms=7,
        )
        for name, style in (("centre_um", "-"), ("lower_um", "--"), ("upper_um", "--")):
            axis.axhline(own[name].iloc[0], color="#c8553d", lw=0.8, ls=style)
        axis.set_title(
            f"{part}, {key.replace('_', ' ')} / um: chart of individuals", fontsize=9, loc="left"
        )
        axis.tick_params(axis="x", rotation=30)
    save_figure(figure, chart)
    replace_text(
        page,
        render_page(
            "inspect",
            "inspection.html.j2",
            title=f"Inspection of {len(result.tables['scans'])} measurements",
            said=result.verdict.value,
            lead=_LEAD,
            tables={
                name: one.to_dict("records") for name, one in result.tables.items() if len(one)
            },
            picture=chart.name,
            alt="Control charts of individuals",
            notes=[f"left out: {one}" for one in result.left_out],
        ),
    )
    return [table, page, chart]
