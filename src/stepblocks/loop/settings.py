"""Settings that a next experiment may have: those seen, of a trial that is yet to come."""

import itertools

import numpy as np

from stepblocks.lawsearch.forward_model import Trials

SHOWN = ("height_um", "load_n", "speed_mm_s")
_HEIGHTS_UM = (5.0, 10.0, 15.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 90.0)
MOST_SETTINGS = 12  # of a column that is set; one of more is read
COUNTED = ("run_order", "passes_of_block")  # a trial that is yet to come has the next number
CHOSEN = ("trials_since_rest", "pause_s")  # whoever drags may rest, or go on
GONE = ("day", "session")  # their labels do not come again


def build_grid(trials: Trials, extra: list[str]) -> Trials:
    """Build all combinations of settings, at the middle of what is read."""
    seen = trials.covariates["height_um"]
    heights = sorted({*(h for h in _HEIGHTS_UM if seen.min() < h < seen.max()), *seen.tolist()})

    def list_settings(name: str) -> list[object]:
        column = trials.covariates[name]
        numbers = trials.numeric(name)
        if name in COUNTED and numbers is not None:
            return [float(numbers.max()) + 1.0]
        if name in (*SHOWN, *extra):
            found: list[object] = np.unique(column).tolist()
            return [found[0], found[len(found) // 2], found[-1]] if name in CHOSEN else found
        return [column[-1] if numbers is None else float(np.median(numbers))]

    names = dict.fromkeys((*SHOWN, *extra, *trials.covariates))
    settings = {name: list_settings(name) for name in names} | {"height_um": heights}
    rows = list(itertools.islice(itertools.product(*settings.values()), 20000))
    columns = dict(zip(settings, map(np.array, zip(*rows, strict=True)), strict=True))
    empty = np.full((len(rows), len(trials.channels)), np.nan)
    known = dict(zip(trials.covariates["height_um"].tolist(), trials.block.tolist(), strict=True))
    return Trials(
        columns,
        trials.channels,
        empty,
        empty,
        np.array([known.get(float(h), f"step-{h:03.0f}") for h in columns["height_um"]]),
    )
