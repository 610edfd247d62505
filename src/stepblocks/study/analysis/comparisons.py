"""Comparisons with a standard, setting by setting: curves, their group, and differences."""

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from scipy.stats import t

from stepblocks.errors import StudyError
from stepblocks.files.tables import Table
from stepblocks.study.analysis.anova import Interval
from stepblocks.study.analysis.population import (
    Estimate,
    Grid,
    Population,
    compare_between_groups,
    compare_within_participants,
)
from stepblocks.study.analysis.psychometric import (
    Psychometric,
    compute_weber_fraction,
    fit_psychometric,
)
from stepblocks.study.columns import PairOrder

_FEWEST_CONSTANT = 8  # trials in which the same answer is no chance


class CurveQuantity(StrEnum):
    """What of a psychometric function is compared between settings."""

    SPREAD = "spread of comparisons"
    EQUALITY = "point of subjective equality"

    @property
    def axis_in_model(self) -> int:
        """Its axis in the model of a group."""
        return 1 if self is CurveQuantity.SPREAD else 0


class GroupMember(NamedTuple):
    """A participant as drawn towards the group by its model.

    Attributes
    ----------
    participant : str
        Name.
    equality : float
        Point of subjective equality [m].
    weber : float
        Weber fraction [1].
    """

    participant: str
    equality: float
    weber: float


@dataclass(frozen=True)
class Curve:
    """Psychometric function of one participant.

    Attributes
    ----------
    who : str
        Participant.
    levels : tuple of float
        Heights compared with the standard [m].
    hits, totals : tuple of int
        Answers "higher", and trials, of each height.
    fit : Psychometric or None
        None where the answers do not determine one.
    reason : str
        Why not; empty with a fit.
    """

    who: str
    levels: tuple[float, ...]
    hits: tuple[int, ...]
    totals: tuple[int, ...]
    fit: Psychometric | None
    reason: str


@dataclass(frozen=True)
class Comparisons:
    """Comparisons with a standard in one setting.

    Attributes
    ----------
    setting : str
        Levels of the declared factors; empty where there are none.
    curves : tuple of Curve
        Of each participant.
    standard : float
        Height of the standard [m].
    equal, spread : Estimate or None
        Means over participants of ln(point of subjective equality / standard) and of ln(sigma);
        None with fewer than two participants.
    people : tuple of GroupMember
        Participants of the model.
    model : Population or None
        Of these participants, in the same order.
    constant : tuple of str
        Participants who always gave the same answer, which says nothing of a threshold: not in the
        model.
    """

    setting: str
    curves: tuple[Curve, ...]
    standard: float
    equal: Estimate | None
    spread: Estimate | None
    people: tuple[GroupMember, ...] = ()
    model: Population | None = None
    constant: tuple[str, ...] = ()

    def drop_participant(self, participant: str) -> "Comparisons":
        """Return what all others say; what the group of all says is not among it."""
        assert self.model is not None
        kept, people = [], []
        for place, member in enumerate(self.people):
            if member.participant != participant:
                kept.append(place)
                people.append(member)
        model = Population(self.model.likelihood[kept], self.model.axes)
        return replace(self, equal=None, spread=None, people=tuple(people), model=model)

    @property
    def participants(self) -> list[str]:
        """Names of the people, in their order."""
        return [member.participant for member in self.people]


def fit_comparisons_of_setting(setting: str, judgements: Table, standard: float) -> Comparisons:
    """Fit the curve of each participant in one setting, and the population of several.

    Parameters
    ----------
    setting : str
        Levels of the declared factors.
    judgements : DataFrame
        participant, height [m], and higher (0 or 1), one row per comparison.
    standard : float
        Height of the standard [m].
    """
    by_participant = judgements.groupby("participant", sort=False)
    curves = tuple(try_to_fit_curve(str(name), answers) for name, answers in by_participant)
    constant = find_constant_answerers(judgements, standard)
    judgements = judgements[~judgements["participant"].isin(constant)]
    if judgements.empty:
        return Comparisons(setting, curves, standard, None, None, constant=constant)
    tables = judgements.pivot_table(
        index="participant", columns="height", values="higher", aggfunc=["sum", "count"]
    ).fillna(0.0)
    hits = tables["sum"]
    if len(hits) < 2 or hits.shape[1] < 3:
        return Comparisons(setting, curves, standard, None, None, constant=constant)
    heights = hits.columns.to_numpy(float)
    grid = Grid(np.log(heights / standard), hits, tables["count"])
    model = Population(grid.likelihood, grid.axes)
    middles = model.predict_participant_means(CurveQuantity.EQUALITY.axis_in_model)
    widths = model.predict_participant_means(CurveQuantity.SPREAD.axis_in_model)
    people = []
    for who, middle, width in zip(hits.index, middles, widths, strict=True):
        people.append(
            GroupMember(str(who), standard * math.exp(middle), compute_weber_fraction(width))
        )
    return Comparisons(
        setting,
        curves,
        standard,
        model.estimate(CurveQuantity.EQUALITY.axis_in_model),
        model.estimate(CurveQuantity.SPREAD.axis_in_model),
        tuple(people),
        model,
        constant,
    )


def find_constant_answerers(judgements: Table, standard: float) -> tuple[str, ...]:
    """Find who gave the same answer to all blocks, below and above the standard.

    The answer is which block of a pair is higher; with the standard in either place it is also
    whether the second one is.
    """
    found = []
    for name, answers in judgements.groupby("participant", sort=False):
        heights = answers["height"]
        if len(answers) < _FEWEST_CONSTANT or not heights.min() < standard < heights.max():
            continue
        second = answers["higher"]
        if "condition" in answers:
            is_first = answers["condition"] == PairOrder.STANDARD_FIRST.value
            second = (answers["higher"] == 1) == is_first
        if answers["higher"].nunique() == 1 or second.nunique() == 1:
            found.append(str(name))
    return tuple(found)


def try_to_fit_curve(participant: str, judgements: Table) -> Curve:
    """Fit the curve of one participant; without a fit, the curve has the reason."""
    by_level = judgements.groupby("height")["higher"].agg(["sum", "count"])
    levels = tuple(by_level.index.tolist())
    hits = tuple(by_level["sum"].tolist())
    totals = tuple(by_level["count"].tolist())
    try:
        return Curve(participant, levels, hits, totals, fit_psychometric(levels, hits, totals), "")
    except StudyError as error:
        return Curve(participant, levels, hits, totals, None, str(error))


def compare_settings(quantity: CurveQuantity, first: Comparisons, second: Comparisons) -> Interval:
    """Compare the logarithm of a quantity, within participants where they met both settings."""
    assert first.model is not None
    assert second.model is not None
    gap = _compare_model_axis(quantity.axis_in_model, first, second)
    return Interval(
        first.setting,
        second.setting,
        gap.value,
        gap.low,
        gap.high,
        gap.p,
        effect_size=math.nan,
        error=0.5 * (gap.high - gap.low) / float(t.ppf(0.975, gap.df)),
        df=gap.df,
    )


def _compare_model_axis(axis: int, first: Comparisons, second: Comparisons) -> Estimate:
    """Compare an axis of the models of two settings, `first` minus `second`."""
    model, facing = first.model, second.model
    assert model is not None
    assert facing is not None
    people, facing_people = first.participants, second.participants
    common = sorted(set(people) & set(facing_people))
    if len(common) < 2 or not np.array_equal(model.axes[axis], facing.axes[axis]):
        return compare_between_groups(model.estimate(axis), facing.estimate(axis))
    rows = list(map(people.index, common))
    facing_rows = list(map(facing_people.index, common))
    return compare_within_participants(
        model.compute_axis_likelihoods(axis)[rows],
        facing.compute_axis_likelihoods(axis)[facing_rows],
        model.axes[axis],
    )
