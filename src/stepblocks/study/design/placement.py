"""Heights for a study beside equal spacing: what is found, as typed results."""

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from stepblocks.study.analysis.bounded import Bounded
from stepblocks.study.design.information import LOG_SPREAD, MIDDLE, SLOPE


class Target(StrEnum):
    """What is to be known best."""

    THRESHOLD = "threshold"
    JND = "jnd"
    BOTH = "both"  # threshold and JND: the area of their common region
    EXPONENT = "exponent"

    @property
    def parameter_indices(self) -> tuple[int, ...]:
        """Indices of its parameters in a curve, or of the exponent in a line."""
        if self is Target.BOTH:
            return MIDDLE, LOG_SPREAD
        return (_PLACES[self],)

    @property
    def spread_index(self) -> int | None:
        """Index of ln(spread) where its error widens that of the target; else None."""
        if self is Target.THRESHOLD:
            return LOG_SPREAD
        return None


_PLACES = {Target.THRESHOLD: MIDDLE, Target.JND: LOG_SPREAD, Target.EXPONENT: SLOPE}


class ExpectedInterval(NamedTuple):
    """A 95 % interval that is expected of one participant.

    Attributes
    ----------
    quantity : Target
        Threshold [m], just noticeable difference over the threshold [1], or exponent [1].
    bounds : Bounded
        Expected value with the ends of its interval.
    """

    quantity: Target
    bounds: Bounded

    @property
    def width(self) -> float:
        """Distance of its ends, in the unit of the quantity."""
        return self.bounds.high - self.bounds.low


@dataclass(frozen=True)
class Placement:
    """Heights with their trials, and what these tell.

    Attributes
    ----------
    heights : tuple of float
        In rising order [m].
    trials : tuple of int
        At each height.
    intervals : tuple of ExpectedInterval
        Of threshold and JND, or of the exponent.
    needed : int or None
        Trials, in the same shares, whose interval is as narrow as is asked for; None where that
        is not asked, or ten million are not enough.
    """

    heights: tuple[float, ...]
    trials: tuple[int, ...]
    intervals: tuple[ExpectedInterval, ...]
    needed: int | None

    def summarise(self) -> dict[str, object]:
        """Return trials and intervals as a row."""
        row: dict[str, object] = {"trials": sum(self.trials)}
        for interval in self.intervals:
            factor, unit = 1.0, "ratio"
            if interval.quantity is Target.THRESHOLD:
                factor, unit = 1e6, "um"
            row[f"{interval.quantity}_{unit}"] = factor * interval.bounds.value
            row[f"{interval.quantity}_low_95_{unit}"] = factor * interval.bounds.low
            row[f"{interval.quantity}_high_95_{unit}"] = factor * interval.bounds.high
        if self.needed is not None:
            row["trials_for_width"] = self.needed
        return row


@dataclass(frozen=True)
class HeightDesign:
    """Heights for a study, beside equal spacing.

    Attributes
    ----------
    target : Target
        What is to be known best.
    optimal, equal : Placement
        The design, and as many trials at equally spaced heights of the whole range.
    efficiency : float
        Information of a trial of equal spacing over that of a trial of the design [1].
    """

    target: Target
    optimal: Placement
    equal: Placement
    efficiency: float

    def __repr__(self) -> str:
        """Show the target, the numbers of heights and trials, and the efficiency."""
        number = len(self.optimal.heights)
        return (
            f"<HeightDesign of {self.target}: {number} heights, {sum(self.optimal.trials)} trials, "
            f"efficiency of equal spacing {self.efficiency:.2f}>"
        )

    def tabulate(self) -> dict[str, list[dict[str, object]]]:
        """Return the heights and the intervals of both as rows, by the title of their table."""
        heights = []
        intervals = []
        for name, placement in (("optimal", self.optimal), ("equal spacing", self.equal)):
            for height, trials in zip(placement.heights, placement.trials, strict=True):
                heights.append({"design": name, "height_um": height * 1e6, "trials": trials})
            intervals.append({"design": name, **placement.summarise()})
        return {"heights": heights, "expected intervals": intervals}
