"""The error of the logarithm of estimates: by what factor heights are over- or underestimated."""

# Errors of judged sizes grow with the size (Weber): ln(estimate / height) has the same spread for
# low and high blocks, where micrometres have not.

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import stats

from stepblocks.contact import Array
from stepblocks.files.tables import Table
from stepblocks.study.analysis.bounded import Bounded

_LEVEL = 0.975  # of the upper end of a 95 % interval


@dataclass(frozen=True)
class LogError:
    """Error of the logarithm of estimates over participants.

    Attributes
    ----------
    condition : str
        Empty for all conditions.
    mean : Bounded
        Mean of ln(estimate / height) over the means of participants [1].
    rms : Bounded
        Root of the mean square over participants [1].
    people, zeros : int
        Participants, and estimates of zero, which have no logarithm and are left out.
    """

    condition: str
    mean: Bounded
    rms: Bounded
    people: int
    zeros: int


def compute_log_errors(frame: Table) -> tuple[LogError, ...]:
    """Compute the error of the logarithm over all conditions, then in each.

    Parameters
    ----------
    frame : DataFrame
        participant, condition, height [m], estimate [m].

    Returns
    -------
    tuple of LogError
        A condition in which every estimate is zero is left out.
    """
    return tuple(_iterate_log_errors(frame))


def _iterate_log_errors(frame: Table) -> Iterator[LogError]:
    """Yield the error over all conditions, and in each where there are several."""
    subsets = [("", frame)]
    if frame["condition"].nunique() > 1:
        subsets += [(str(name), part) for name, part in frame.groupby("condition")]
    for condition, part in subsets:
        positive = part[part["estimate"] > 0.0]
        if positive.empty:
            continue
        error = np.log(positive["estimate"] / positive["height"])
        by_participant = positive.assign(error=error, square=error**2).groupby("participant")
        squares = _estimate_mean_of_participants(by_participant["square"].mean().to_numpy(float))
        yield LogError(
            condition,
            _estimate_mean_of_participants(by_participant["error"].mean().to_numpy(float)),
            squares.transform(lambda square: math.sqrt(max(square, 0.0))),
            by_participant.ngroups,
            len(part) - len(positive),
        )


def _estimate_mean_of_participants(participant_means: Array) -> Bounded:
    """Return the mean of participants' values, shape (n,), with Student's interval."""
    mean = float(participant_means.mean())
    if len(participant_means) < 2:
        return Bounded(mean, math.nan, math.nan)
    half = float(
        stats.t.ppf(_LEVEL, len(participant_means) - 1)
        * participant_means.std(ddof=1)
        / len(participant_means) ** 0.5
    )
    return Bounded(mean, mean - half, mean + half)
