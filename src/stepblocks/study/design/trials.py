"""Experiments as lists of trials: blocks, crossed factors, balanced orders, blinding codes."""

import itertools
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stepblocks.errors import StudyError
from stepblocks.study.columns import FACTOR, WHEN, PairOrder
from stepblocks.study.design.blocks import Codes, Item, assign_codes
from stepblocks.study.design.orders import (
    Balance,
    Orders,
    allocate_orders,
    measure_balance,
)

REPETITIONS = 3  # of experiment 1
MAX_TRIALS = 200_000
_FEWEST_COMPARED = 2  # participants whose differences have a standard deviation
_SHUFFLES = 5000  # orders of a set that are tried until no block follows itself

_BLOCK = ("stimulus", "engraved", "code", "height_um")
_STANDARD = ("standard", "standard_engraved", "standard_code", "standard_height_um")
# Columns of design.csv, which hides nothing; those of declared factors follow
DESIGN_COLUMNS = ("experiment", *WHEN, *_BLOCK, *_STANDARD)

Factors = Mapping[str, Sequence[str]]  # levels of each factor
Levels = tuple[str, ...]  # one of each factor


@dataclass(frozen=True)
class Design:
    """A whole experiment.

    Attributes
    ----------
    experiment : str
        A name of `stepblocks.study.experiments.registry.EXPERIMENTS`.
    trials : sequence of mapping
        Rows of design.csv, by participant, in the order in which they are run.
    blocks : mapping
        Block by participant and code. Codes differ between participants, and a standard has as
        many as there are blocks to compare it with. Each block has one more for practice.
    balance : Balance
        Of the order of conditions over participants.
    """

    experiment: str
    trials: Sequence[Mapping[str, str]]
    blocks: Mapping[str, Mapping[str, Item]]
    balance: Balance

    @property
    def detectable(self) -> float:
        """Difference over its standard deviation that a paired t-test finds in 80 % of studies.

        Infinite with one participant, who has no standard deviation.
        """
        if len(self.blocks) < _FEWEST_COMPARED:
            return math.inf
        from statsmodels.stats.power import TTestPower

        return float(TTestPower().solve_power(nobs=len(self.blocks), alpha=0.05, power=0.8))

    def __repr__(self) -> str:
        return (
            f"<Design {self.experiment}: {len(self.blocks)} participants, "
            f"{len(self.trials)} trials>"
        )


@dataclass(frozen=True)
class _TrialPlan:
    """What every participant meets.

    Attributes
    ----------
    experiment : str
        Its kind.
    judged, standards : sequence of Item
        Blocks that are judged, and the standard that each is compared with; empty without one.
    practised : sequence of Item
        Blocks of practice trials.
    repetitions : int
        How often each block is judged in each condition.
    within, between : sequence of str
        Names of factors of which each participant meets all levels, and one.
    settings : sequence of tuple of str
        Crossed levels of the factors within participants.
    interleaved : bool
        Whether settings change from trial to trial.
    """

    experiment: str
    judged: Sequence[Item]
    standards: Sequence[Item]
    practised: Sequence[Item]
    repetitions: int
    within: Sequence[str]
    between: Sequence[str]
    settings: Sequence[Levels]
    interleaved: bool

    def group_settings_into_turns(self, setting_order: Sequence[int]) -> list[list[int]]:
        """Return the settings that are run together, in the order of a participant."""
        if self.interleaved:
            return [[*setting_order]]
        return [[setting] for setting in setting_order]

    def list_conditions_of_setting(self, setting_index: int) -> list[str]:
        """Return the conditions of a setting: of pairs, which block is given first."""
        if self.standards:
            return PairOrder.list_names()
        return ["/".join(self.settings[setting_index])]


@dataclass(frozen=True)
class _Cell:
    """A trial of a set: code of its block, condition, and number of its setting."""

    code: str
    condition: str
    setting: int


def design_trials(
    experiment: str,
    participants: int,
    items: Sequence[Item],
    repetitions: int,
    seed: int,
    *,
    factors: Factors,
    between: Sequence[str] = (),
    standard: str = "",
    interleaved: bool = False,
) -> Design:
    """Cross declared factors with the blocks; with a standard, compare each block with it.

    Every participant meets all levels of a factor but of those that are named as `between`, of
    which each meets one. Settings follow each other in balanced orders, or are `interleaved`. Each
    repetition, of a setting or of all, is a set of its own order in which no block follows itself.

    Parameters
    ----------
    experiment : str
        Its kind.
    participants, repetitions : int
        How many, and how often each judges each block in each condition.
    items : sequence of Item
        The blocks, with the standard.
    seed : int
        Of all chance.
    factors : mapping of sequence of str
        Levels of each factor.
    between : sequence of str
        Factors of which each participant meets one level.
    standard : str
        Identity of the block that all others are compared with.
    interleaved : bool
        Whether settings change from trial to trial.

    Raises
    ------
    StudyError
        If such a design is impossible, or has more than `MAX_TRIALS` trials.
    """
    _check_design_names(items, factors, between, standard)
    within = [name for name in factors if name not in between]
    settings = _cross_levels(factors, within)
    groups = _cross_levels(factors, between)
    pair_orders = 1
    if standard:
        pair_orders = len(PairOrder)
    trials_of_each = len(settings) * len(items) * repetitions * pair_orders
    _check_design_size(participants, repetitions, seed, len(groups), trials_of_each)
    generator = np.random.default_rng(seed)
    group = generator.permutation(participants) % len(groups)
    orders = _allocate_setting_orders(group, len(groups), len(settings), generator)
    judged, standards = [], []
    for item in items:
        if item.identity == standard:
            standards.append(item)
        else:
            judged.append(item)
    plan = _TrialPlan(
        experiment,
        judged,
        standards * len(judged),
        items,
        repetitions,
        within,
        between,
        settings,
        interleaved,
    )
    trials = list[dict[str, str]]()
    blocks = dict[str, dict[str, Item]]()
    for person in range(participants):
        codes = assign_codes([*judged, *plan.standards], generator, items)
        blocks[str(person + 1)] = codes.get_items_by_code()
        levels = groups[group[person]]
        trials += _iterate_trial_rows(
            plan, str(person + 1), codes, orders[person], levels, generator
        )
    balance = replace(measure_balance(orders), interleaved=interleaved, groups=len(groups))
    return Design(experiment, trials, blocks, balance)


def _cross_levels(factors: Factors, names: Iterable[str]) -> list[tuple[str, ...]]:
    """Return all combinations of the levels of some factors."""
    levels = [factors[name] for name in names]
    return list(itertools.product(*levels))


def _check_design_names(
    items: Sequence[Item], factors: Factors, between: Sequence[str], standard: str
) -> None:
    """Reject names of factors, levels and blocks that a design cannot have."""
    known = [item.identity for item in items]
    for name, levels in factors.items():
        _check_levels(name, levels)
    _check_levels("blocks", known)
    unknown = [name for name in between if name not in factors]
    if unknown:
        raise StudyError(f"between must name factors ({', '.join(factors)}), got {unknown}")
    if not standard:
        return
    if standard not in known:
        raise StudyError(f"standard must be one of {', '.join(known)}, got {standard!r}")
    compared = len(known) - 1
    if compared < 2:
        raise StudyError(f"comparisons need two blocks beside the standard, got {compared}")


def _check_levels(name: str, levels: Sequence[str]) -> None:
    """Reject a factor, or the blocks, whose names cannot stand in a design."""
    label = name
    if name == "probe":
        label = "conditions"
    if not levels:
        raise StudyError(f"{label} must be at least one, got none")
    for level, count in sorted(Counter(levels).items()):
        if count > 1:
            raise StudyError(f"{label} must differ from each other, got {level!r} twice")
    for level in levels:
        if not level or level.strip() != level or "/" in level:
            raise StudyError(
                f"{label} must have names without slash or outer spaces, got {list(levels)}"
            )
    if not name.replace("-", "_").isidentifier():
        raise StudyError(f"a factor must be one word, got {name!r}")


def _check_design_size(
    participants: int, repetitions: int, seed: int, group_count: int, trials_of_each: int
) -> None:
    """Reject a design without repetitions, with empty groups, or with too many trials."""
    if repetitions < 1:
        raise StudyError(f"repetitions must be at least 1, got {repetitions}")
    if seed < 0:
        raise StudyError(f"seed must not be negative, got {seed}")
    if participants < group_count:
        raise StudyError(
            f"participants must be at least {group_count}, one for each group, got {participants}"
        )
    total = participants * trials_of_each
    if total > MAX_TRIALS:
        raise StudyError(f"a design must have at most {MAX_TRIALS} trials, got {total}")


def _allocate_setting_orders(
    group_of_participant: NDArray[np.int64],
    group_count: int,
    setting_count: int,
    generator: np.random.Generator,
) -> Orders:
    """Return the order of settings of each participant, balanced within each group.

    `group_of_participant`, shape (participants,), has the number of each participant's group.
    """
    orders = np.zeros((len(group_of_participant), setting_count), dtype=np.int64)
    for index, count in enumerate(np.bincount(group_of_participant, minlength=group_count)):
        orders[group_of_participant == index] = allocate_orders(
            int(count), setting_count, generator
        )
    return orders


def _iterate_trial_rows(
    plan: _TrialPlan,
    participant: str,
    codes: Codes,
    setting_order: Sequence[int],
    between_levels: Levels,
    generator: np.random.Generator,
) -> Iterator[dict[str, str]]:
    """Yield the rows of design.csv of one participant.

    Parameters
    ----------
    plan : _TrialPlan
        What every participant meets.
    participant : str
        Number of the participant.
    codes : Codes
        Of the participant; those of the blocks come before those of the standard.
    setting_order : sequence of int
        Of the settings.
    between_levels : tuple of str
        Of the factors between participants.
    generator : Generator
        Source of all chance.
    """
    judged = list(codes.judged)[: len(plan.judged)]
    standards = list(codes.judged)[len(plan.judged) :]
    practice_code = {item.identity: code for code, item in codes.practised.items()}
    number = 0
    last = ""
    for settings, repetition in itertools.product(
        plan.group_settings_into_turns(setting_order), range(plan.repetitions)
    ):
        cells = list(_iterate_block_condition_cells(plan, settings, judged))
        facing = dict[str, dict[str, str]]()  # code of the standard by order and block
        if standards:
            for pair_order in PairOrder:
                drawn = generator.permutation(standards)
                facing[pair_order] = dict(zip(judged, map(str, drawn), strict=True))
        for cell in _shuffle_without_repeats(cells, last, generator):
            number += 1
            standard = ""
            if standards:
                standard = facing[cell.condition][cell.code]
            when = (participant, str(number), cell.condition, str(repetition + 1))
            row = make_trial_row(plan.experiment, when, codes.judged, cell.code, standard)
            names = (*plan.within, *plan.between)
            for name, level in zip(
                names, (*plan.settings[cell.setting], *between_levels), strict=True
            ):
                row[f"{FACTOR}{name}"] = level
            row["practice_code"] = practice_code.get(row["stimulus"], "")
            row["practice_standard_code"] = practice_code.get(row["standard"], "")
            yield row
            last = cell.code


def _iterate_block_condition_cells(
    plan: _TrialPlan, settings: Sequence[int], codes: Sequence[str]
) -> Iterator[_Cell]:
    """Yield every block in every condition of some settings."""
    for setting in settings:
        conditions = plan.list_conditions_of_setting(setting)
        for code, condition in itertools.product(codes, conditions):
            yield _Cell(code, condition, setting)


def make_trial_row(
    experiment: str,
    when_cells: Sequence[str],
    blocks: Mapping[str, Item],
    code: str,
    standard: str = "",
) -> dict[str, str]:
    """Write a trial as its row of design.csv.

    Parameters
    ----------
    experiment : str
        Its kind.
    when_cells : sequence of str
        Cells of the columns `WHEN`.
    blocks : mapping of Item
        By code.
    code, standard : str
        Codes of the block and of the standard that it is compared with, if there is one.
    """
    row = {"experiment": experiment, **dict(zip(WHEN, when_cells, strict=True))}
    block = {**blocks[code].make_loader_columns(), "code": code}
    for column in _BLOCK:
        row[column] = block[column]
    facing = dict.fromkeys(_BLOCK, "")
    if standard:
        facing = {**blocks[standard].make_loader_columns(), "code": standard}
    for column, name in zip(_STANDARD, _BLOCK, strict=True):
        row[column] = facing[name]
    return row


def _shuffle_without_repeats(
    cells: Sequence[_Cell], previous_code: str, generator: np.random.Generator
) -> list[_Cell]:
    """Shuffle a set so that no block follows itself, where that is possible.

    `previous_code` is the code of the block before the set.
    """
    attempts = 1
    if len({cell.code for cell in cells}) > 1:
        attempts = _SHUFFLES
    for _ in range(attempts):
        shuffled = [cells[index] for index in generator.permutation(len(cells))]
        if not _has_repeated_block(shuffled, previous_code):
            break
    return shuffled


def _has_repeated_block(cells: Sequence[_Cell], previous_code: str) -> bool:
    """Return whether a block follows itself, the first following the block `previous_code`."""
    for cell in cells:
        if cell.code == previous_code:
            return True
        previous_code = cell.code
    return False
