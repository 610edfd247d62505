"""Settings that a next experiment may have: those of the session, for trials yet to come."""

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from stepblocks.lawsearch.forward_model import Floats, Trials

SHOWN = ("height_um", "load_n", "speed_mm_s")
MOST_SETTINGS = 12  # of a column that is set; a column of more values is read
COUNTED = ("run_order", "passes_of_block")  # a trial that is yet to come has the next number
CHOSEN = ("trials_since_rest", "pause_s")  # the person who drags may rest, or go on
GONE = ("day", "session")  # their labels do not come again
_HEIGHTS_UM = (5.0, 10.0, 15.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 90.0)
_MOST_ROWS = 20_000


def build_setting_grid(trials: Trials, extra_covariates: Sequence[str]) -> Trials:
    """Build a grid of all combinations of settings.

    Parameters
    ----------
    trials : Trials
        Trials of the session.
    extra_covariates : sequence of str
        Covariates that vary beside height, load and speed. All others are at their middle.

    Returns
    -------
    Trials
        One row for each combination, with nothing measured. Of more than `_MOST_ROWS` the first
        ones are kept.
    """
    names = dict.fromkeys((*SHOWN, *extra_covariates, *trials.covariates))
    settings: dict[str, list[object]] = {}
    for name in names:
        settings[name] = _list_future_settings(
            trials, name, is_varied=name in (*SHOWN, *extra_covariates)
        )
    settings["height_um"] = [*_list_candidate_heights_um(trials)]
    rows = list(itertools.islice(itertools.product(*settings.values()), _MOST_ROWS))
    columns = {}
    for name, column in zip(settings, zip(*rows, strict=True), strict=True):
        columns[name] = np.array(column)
    nothing = np.full((len(rows), len(trials.channels)), np.nan)
    return Trials(
        columns, trials.channels, nothing, nothing, _name_blocks(trials, columns["height_um"])
    )


def _list_future_settings(trials: Trials, covariate: str, *, is_varied: bool) -> list[object]:
    """List the settings of a covariate for trials that are yet to come.

    A counted one, such as the number of the trial, goes on by one.
    """
    column = trials.covariates[covariate]
    numbers = trials.numeric(covariate)
    if covariate in COUNTED and numbers is not None:
        return [float(numbers.max()) + 1.0]
    if is_varied:
        seen: list[object] = np.unique(column).tolist()
        if covariate in CHOSEN:
            return [seen[0], seen[len(seen) // 2], seen[-1]]
        return seen
    if numbers is None:
        return [column[-1]]
    return [float(np.median(numbers))]


def _list_candidate_heights_um(trials: Trials) -> list[float]:
    """List the heights of the session and round ones between them [um]."""
    seen = trials.covariates["height_um"]
    least, greatest = seen.min(), seen.max()
    between = [height for height in _HEIGHTS_UM if least < height < greatest]
    return sorted({*between, *seen.tolist()})


def _name_blocks(trials: Trials, heights_um: Floats) -> NDArray[np.str_]:
    """Name the block of each height: one of the session, or one that is yet to be made."""
    heights_seen = trials.covariates["height_um"].tolist()
    known = dict(zip(heights_seen, trials.block.tolist(), strict=True))
    names = []
    for height in heights_um:
        names.append(known.get(float(height), f"step-{height:03.0f}"))
    return np.array(names)
