"""Comparisons of each block with a standard: constant stimuli, and adaptive placement."""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pandas as pd

from stepblocks.errors import StudyError
from stepblocks.files.tables import Table
from stepblocks.study.analysis.anova import Interval
from stepblocks.study.analysis.comparisons import (
    Comparisons,
    CurveQuantity,
    compare_settings,
    fit_comparisons_of_setting,
)
from stepblocks.study.analysis.findings import Analysis, format_contrast_name
from stepblocks.study.columns import FACTOR, NO, YES, PairOrder, Row, read_number_or_nan
from stepblocks.study.design.simulate import Observer, simulate_comparison
from stepblocks.study.experiments.kind import Experiment, Texts


def read_comparison(planned: Row, answer: Row, ratings: tuple[int, int]) -> dict[str, float]:
    """Read whether a block was called higher than the standard (0 or 1), and its height [m]."""
    orders = PairOrder.list_names()
    if planned["condition"] not in orders:
        raise StudyError(
            f"condition must be one of {', '.join(orders)}, got {planned['condition']!r}"
        )
    text = answer["second_is_higher"].lower()
    if text not in (*YES, *NO):
        raise StudyError(f"second_is_higher must be y or n, got {answer['second_is_higher']!r}")
    second_is_higher = text in YES
    standard_is_first = planned["condition"] == PairOrder.STANDARD_FIRST
    return {
        "higher": int(second_is_higher == standard_is_first),
        "standard": read_number_or_nan(planned["standard_height_um"]) / 1e6,
    }


def _simulate_comparisons(
    trials: Table, observer: Observer, generator: np.random.Generator
) -> Texts:
    """Simulate answers to which block of each pair is higher."""
    texts = []
    pairs = zip(trials["energy"], trials["standard_energy"], trials["condition"], strict=True)
    for energy, standard, order in pairs:
        higher = simulate_comparison(energy, standard, observer, generator)
        second_is_higher = higher == (order == PairOrder.STANDARD_FIRST)
        text = "n"
        if second_is_higher:
            text = "y"
        texts.append((text,))
    return texts


def _analyse_comparisons(frame: Table, margin: float) -> Analysis:
    """Fit the psychometric functions of each setting, and compare every two settings.

    Parameters
    ----------
    frame : DataFrame
        participant, height [m], standard [m], higher (0 or 1); factors and groups, if any.
    margin : float
        Of no meaning here.

    Raises
    ------
    StudyError
        If there are several standards.
    """
    standards = sorted(frame["standard"].unique())
    if len(standards) != 1:
        heights = [f"{height * 1e6:g} um" for height in standards]
        raise StudyError(f"pairs of one study must have one standard, got {', '.join(heights)}")
    settings = []
    for name, judgements in frame.groupby(format_setting_names(frame)):
        settings.append(fit_comparisons_of_setting(str(name), judgements, float(standards[0])))
    fitted = [setting for setting in settings if setting.model is not None]
    pairs = list(itertools.combinations(fitted, 2))
    contrasts = dict[CurveQuantity, tuple[Interval, ...]]()
    if pairs:
        for quantity in CurveQuantity:
            intervals = []
            for first, second in pairs:
                intervals.append(compare_settings(quantity, first, second))
            contrasts[quantity] = tuple(intervals)
    return Analysis(
        frame=frame,
        comparisons=tuple(settings),
        contrasts=contrasts,
        remarks=tuple(_describe_constant_answerers(settings)),
    )


def _describe_constant_answerers(settings: Sequence[Comparisons]) -> Iterator[str]:
    """Name participants who always gave the same answer, and say that no mean has them."""
    for setting in settings:
        where = ""
        if setting.setting:
            where = f" with {setting.setting}"
        for name in setting.constant:
            yield (
                f"Participant {name} always gave the same answer{where}, which says nothing of a "
                "threshold: left out of the means of the group."
            )


def format_setting_names(frame: Table) -> pd.Series:
    """Name the setting of each comparison: group, and levels of declared factors."""
    parts = []
    for name in frame:
        if name == "group" or FACTOR in str(name):
            parts.append(frame[name].astype(str))
    if not parts:
        return pd.Series("", frame.index)
    settings = parts[0]
    for levels in parts[1:]:
        settings = settings.str.cat(levels, sep="/")
    return settings


def _list_outcomes(frame: Table) -> list[str]:
    """Name the planned tests of every quantity between every two settings."""
    settings = sorted(set(format_setting_names(frame)))
    outcomes = []
    for quantity in CurveQuantity:
        for first, second in itertools.combinations(settings, 2):
            outcomes.append(format_contrast_name(quantity, first, second))
    return outcomes


CONSTANT = Experiment(
    title="Comparison with a standard",
    sheet_title="Which of the two is higher",
    answers=("second_is_higher",),
    value="higher",
    factors={},
    read=read_comparison,
    simulate=_simulate_comparisons,
    quantities=tuple(quantity.value for quantity in CurveQuantity),
    list_outcomes=_list_outcomes,
    analyse=_analyse_comparisons,
    takes=("probes", "factors", "interleaved", "standard", "repetitions"),
    default_condition=PairOrder.STANDARD_FIRST.value,
    paired=True,
)

ADAPTIVE = replace(
    CONSTANT,
    title="Adaptive comparison with a standard",
    takes=("probes", "factors", "standard", "trials", "prior"),
    adaptive=True,
)
