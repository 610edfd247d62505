"""Settings that a next experiment may have: those seen, along columns that can be set."""

import itertools

import numpy as np

from stepblocks.loop.search.forward_model import Trials

SHOWN = ("height_um", "load_n", "speed_mm_s")
_HEIGHTS_UM = (5.0, 10.0, 15.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 90.0)
MOST_SETTINGS = 12  # of a column that is set; one of more is read


def build_grid(trials: Trials, extra: list[str]) -> Trials:
    """Build all combinations of settings, at the middle of what is read."""

    def span(name: str) -> list[object]:
        numbers = trials.numeric(name)
        labels = sorted(set(trials.covariates[name].tolist()))
        if name == "run_order" and numbers is not None:
            return sorted({*np.round(np.linspace(numbers.min(), numbers.max(), 5)).tolist()})
        return labels if numbers is None else np.unique(numbers).tolist()

    seen = trials.covariates["height_um"]
    heights = sorted({*(h for h in _HEIGHTS_UM if seen.min() < h < seen.max()), *seen.tolist()})
    rows = list(itertools.product(heights, *map(span, ("load_n", "speed_mm_s", *extra))))[:20000]
    columns = {
        name: np.array(column)
        for name, column in zip((*SHOWN, *extra), zip(*rows, strict=True), strict=True)
    }
    for name, column in trials.covariates.items():
        numbers = trials.numeric(name)
        middle: object = column[0] if numbers is None else float(np.median(numbers))
        columns.setdefault(name, np.full(len(rows), middle))
    empty = np.full((len(rows), len(trials.channels)), np.nan)
    known = dict(zip(trials.covariates["height_um"].tolist(), trials.block.tolist(), strict=True))
    block = np.array([known.get(float(h), f"step-{h:03.0f}") for h in columns["height_um"]])
    return Trials(columns, trials.channels, empty, empty, block)
