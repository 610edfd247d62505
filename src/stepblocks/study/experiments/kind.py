"""What every kind of experiment answers."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stepblocks.files.tables import Table
from stepblocks.study.analysis.findings import Analysis
from stepblocks.study.columns import Row
from stepblocks.study.design.simulate import Observer

Texts = Sequence[tuple[str, ...]]  # answers to trials, as a participant writes them


@dataclass(frozen=True)
class Experiment:
    """One kind of experiment.

    Attributes
    ----------
    title, sheet_title : str
        Of the report, and of the run sheets, which must not reveal what is varied.
    answers : tuple of str
        Columns that a participant fills in.
    value : str
        Column of the tidy table that holds the answer.
    factors : mapping
        Factors with their levels, where a design declares none.
    read : callable
        Takes a planned trial, its answer, and the ends of the ratings; returns columns of the
        tidy table, in SI.
    simulate : callable
        Takes trials, observer and generator; returns texts for `answers`.
    quantities : tuple of str
        What is tested, beside the ratings.
    list_outcomes : callable
        Takes a tidy table, or the trials of a design; returns the names of the planned tests.
    analyse : callable
        Takes the tidy table and the margin within which conditions count as equivalent [m].
    takes : tuple of str
        Options of `design_study`, `simulate_study` and `analyse_study` that the kind follows.
    default_condition : str
        Of judgements that name none; empty where a condition must be named.
    paired : bool
        Whether each block is compared with a standard.
    adaptive : bool
        Whether each block is chosen by the answers before it.
    """

    title: str
    sheet_title: str
    answers: tuple[str, ...]
    value: str
    factors: Mapping[str, Sequence[str]]
    read: Callable[[Row, Row, tuple[int, int]], dict[str, float]]
    simulate: Callable[[Table, Observer, np.random.Generator], Texts]
    quantities: tuple[str, ...]
    list_outcomes: Callable[[Table], list[str]]
    analyse: Callable[[Table, float], Analysis]
    takes: tuple[str, ...] = ("factors",)
    default_condition: str = ""
    paired: bool = False
    adaptive: bool = False
