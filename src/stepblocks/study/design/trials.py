"""Experiments as lists of trials: blocks, crossed factors, balanced orders, blinding codes."""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.counterface import Counterface, Step
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import PAPER, OperatingPoint
from stepblocks.declaration.read import load_set
from stepblocks.declaration.select import matches_pattern
from stepblocks.declaration.set import StimulusSet
from stepblocks.errors import PipelineError
from stepblocks.predict.perception import choose_energies
from stepblocks.predict.predictions import predict_one
from stepblocks.quantities import parse_quantity
from stepblocks.study import require

Declared: TypeAlias = str | Path | StimulusSet  # a stimulus file, or the set of one
REPETITIONS = 3  # of experiment 1
MAX_CONDITIONS = 26  # that one participant may meet
MAX_PARTICIPANTS = 1000
MAX_TRIALS = 200_000
_ALPHABET = (
    "ABCDEFHKLMNPRTUVWXY"  # no I, O, Q, S, Z, G, J: a hand writes them like others; 19 is prime
)
MAX_CODES = len(_ALPHABET) ** 2  # blocks that one study can tell apart

WHEN = ("participant", "trial", "condition", "repetition")
_BLOCK = ("stimulus", "engraved", "code", "height_um")
FACTOR = "factor_"  # begins the column of each declared factor
PRACTICE = "P-"  # begins a code of practice, which says what was right: no trial shows it
# Columns of design.csv, which hides nothing; those of declared factors follow
DESIGN_COLUMNS = (
    "experiment",
    *WHEN,
    *_BLOCK,
    "standard",
    *(f"standard_{name}" for name in _BLOCK[1:]),
)
ORDERS = ("standard-first", "standard-second")  # conditions of a comparison
# Factors that `study run` can change from trial to trial of virtual blocks, and their dimension;
# "" where the levels are words
VIRTUAL_FACTORS = {
    "vibration": "",
    "block": "",
    "amplitude": "ratio",
    "frequency": "frequency",
    "decay": "time",
    "load": "force",
}
REAL, VIRTUAL = "real", "simulated"  # levels of the factor "block"
_SHUFFLES = 5000

_NAMED = (("stimulus", "height_um"), ("standard", "standard_height_um"))  # columns of a design

Orders = NDArray[np.int64]
Factors = Mapping[str, Sequence[str]]


def make_williams_square(conditions: int) -> Orders:
    """Return Williams' orders, in which every condition follows every other equally often."""
    # Williams, E. J. (1949), Australian Journal of Scientific Research A 2, 149-168.
    require(
        1 <= conditions <= MAX_CONDITIONS,
        f"the number of conditions must lie between 1 and {MAX_CONDITIONS}, got {conditions}",
    )
    zigzag = np.array([(k + 1) // 2 if k % 2 == 0 else -((k + 1) // 2) for k in range(conditions)])
    square = (zigzag[np.newaxis, :] + np.arange(conditions)[:, np.newaxis]) % conditions
    return np.vstack([square, square[:, ::-1]]) if conditions % 2 and conditions > 1 else square


def allocate_orders(participants: int, conditions: int, generator: np.random.Generator) -> Orders:
    """Give every participant an order, whole Williams designs first, the rest from one more."""
    require(
        1 <= participants <= MAX_PARTICIPANTS,
        f"the number of participants must lie between 1 and {MAX_PARTICIPANTS}, got {participants}",
    )
    square = make_williams_square(conditions)
    relabelled = generator.permutation(conditions)[square[np.arange(participants) % len(square)]]
    return np.asarray(relabelled[generator.permutation(participants)], dtype=np.int64)


@dataclass(frozen=True)
class Balance:
    """How evenly conditions stand over positions and behind each other."""

    conditions: int
    position_spread: int  # largest minus smallest count of a condition in a position
    follower_spread: int  # the same of an ordered pair of different neighbours
    interleaved: bool = False  # whether conditions change from trial to trial
    groups: int = 1  # of participants, each balanced by itself

    @property
    def exact(self) -> bool:
        """Whether positions and followers are balanced without remainder."""
        return self.position_spread == 0 and self.follower_spread == 0

    def __str__(self) -> str:
        if self.interleaved:
            return "conditions interleaved, all of them in each repetition"
        if self.exact:
            return "order of conditions balanced exactly, for position and for carry-over"
        return (
            f"order of conditions balanced to within {self.position_spread} per position and "
            f"{self.follower_spread} per neighbour; exact at multiples of "
            f"{self.groups * len(make_williams_square(self.conditions))} participants"
        )


def measure_balance(orders: Orders) -> Balance:
    """Count positions and neighbours."""
    count = orders.shape[1]
    positions, followers = np.zeros((2, count, count), dtype=np.int64)
    np.add.at(positions, (orders, np.arange(count)), 1)
    np.add.at(followers, (orders[:, :-1], orders[:, 1:]), 1)
    apart = followers[~np.eye(count, dtype=bool)]
    return Balance(count, int(np.ptp(positions)), int(np.ptp(apart)) if apart.size else 0)


@dataclass(frozen=True)
class Item:
    """A block that is judged.

    Attributes
    ----------
    identity, engraved : str
        Of the stimulus, and as it stands on the block.
    height : float
        Of its step [m].
    """

    identity: str
    engraved: str
    height: float

    def __post_init__(self) -> None:
        require(
            math.isfinite(self.height) and self.height > 0.0,
            f"height must be positive and finite, got {self.height:g} m [block {self.identity}]",
        )

    def describe(self) -> dict[str, str]:
        """Say which block it is, for who loads the blocks."""
        return {
            "stimulus": self.identity,
            "engraved": self.engraved,
            "height_um": f"{self.height * 1e6:.9g}",
        }


def assign_codes(
    items: Sequence[Item], generator: np.random.Generator, practised: Sequence[Item] = ()
) -> dict[str, Item]:
    """Give every block a code of two random letters and a check letter, and one for practice."""
    places = [*((item, "") for item in items), *((item, PRACTICE) for item in practised)]
    require(
        len(places) <= MAX_CODES,
        f"a participant must need at most {MAX_CODES} codes, with those of practice, got "
        f"{len(places)}: choose fewer blocks",
    )
    size = len(_ALPHABET)
    codes = {}
    for (item, head), number in zip(places, generator.permutation(MAX_CODES), strict=False):
        first, second = divmod(int(number), size)
        check = _ALPHABET[-(2 * first + 3 * second) % size]
        codes[head + _ALPHABET[first] + _ALPHABET[second] + check] = item
    return codes


@dataclass(frozen=True)
class Design:
    """A whole experiment.

    Attributes
    ----------
    experiment : str
        A name of `stepblocks.study.design.experiments.EXPERIMENTS`.
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
        """Difference over its standard deviation that a paired t-test finds in 80 % of studies."""
        from statsmodels.stats.power import TTestPower

        return float(TTestPower().solve_power(nobs=len(self.blocks), alpha=0.05, power=0.8))

    def __repr__(self) -> str:
        return (
            f"<Design {self.experiment}: {len(self.blocks)} participants, "
            f"{len(self.trials)} trials>"
        )


def make_trial_row(
    experiment: str,
    when: Sequence[object],
    blocks: Mapping[str, Item],
    code: str,
    standard: str = "",
) -> dict[str, str]:
    """Write a trial as its row of design.csv: when (in `WHEN`), and its codes."""
    cells = [experiment, *map(str, when)]
    for one in (code, standard):
        found = blocks[one].describe() | {"code": one} if one else dict.fromkeys(_BLOCK, "")
        cells += [found[name] for name in _BLOCK]
    return dict(zip(DESIGN_COLUMNS, cells, strict=True))


def name_setting(row: Mapping[str, str]) -> str:
    """Return the levels of a trial's declared factors."""
    return "/".join(level for name, level in row.items() if name.startswith(FACTOR))


def list_levels(row: Mapping[str, str]) -> set[str]:
    """Return the condition of a trial and all levels of its factors."""
    return {row["condition"], *row["condition"].split("/"), *name_setting(row).split("/")}


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
    """
    settings, groups, generator = _check_size(
        (participants, repetitions, seed), items, factors, between, standard
    )
    names = [*(name for name in factors if name not in between), *between]
    group = generator.permutation(participants) % len(groups)
    orders = np.zeros((participants, len(settings)), dtype=np.int64)
    for index, count in enumerate(np.bincount(group, minlength=len(groups))):
        orders[group == index] = allocate_orders(int(count), len(settings), generator)
    base = [item for item in items if item.identity == standard]
    others = [item for item in items if item.identity != standard]
    trials, blocks = list[dict[str, str]](), dict[str, dict[str, Item]]()
    for person in range(participants):
        codes = assign_codes([*others, *base * len(others)], generator, items)
        own, aliases = list(codes)[: len(others)], list(codes)[len(others) : -len(items)]
        practised = {codes[code].identity: code for code in list(codes)[-len(items) :]}
        blocks[str(person + 1)] = codes
        last = ""
        number = itertools.count(1)
        turns = [[*orders[person]]] if interleaved else [[index] for index in orders[person]]
        for some, time in itertools.product(turns, range(repetitions)):
            cells = [
                (code, condition, index)
                for index in some
                for code in own
                for condition in (ORDERS if base else ["/".join(settings[index])])
            ]
            facing = {order: generator.permutation(aliases) for order in ORDERS if base}
            for code, condition, index in _shuffle(cells, last, generator):
                met = settings[index] + groups[group[person]]
                row = make_trial_row(
                    experiment,
                    (person + 1, next(number), condition, time + 1),
                    codes,
                    code,
                    str(facing[condition][own.index(code)]) if base else "",
                )
                trials.append(
                    row
                    | {f"{FACTOR}{one}": level for one, level in zip(names, met, strict=True)}
                    | {
                        f"practice_{name}": practised.get(row[block], "")
                        for name, block in (("code", "stimulus"), ("standard_code", "standard"))
                    }
                )
                last = code
    return Design(
        experiment,
        trials,
        blocks,
        replace(measure_balance(orders), interleaved=interleaved, groups=len(groups)),
    )


def _shuffle(
    cells: Sequence[tuple[str, str, int]], last: str, generator: np.random.Generator
) -> list[tuple[str, str, int]]:
    # Order a set so that no block follows itself, where that can be
    for _ in range(_SHUFFLES if len({cell[0] for cell in cells}) > 1 else 1):
        found = [cells[index] for index in generator.permutation(len(cells))]
        if all(one != two for one, two in itertools.pairwise([last, *(cell[0] for cell in found)])):
            break
    return found


def _check_size(
    size: tuple[int, int, int],
    items: Sequence[Item],
    factors: Factors,
    between: Sequence[str],
    standard: str,
) -> tuple[list[tuple[str, ...]], list[tuple[str, ...]], np.random.Generator]:
    # Refuse what is impossible; return settings, groups and the source of all chance
    participants, repetitions, seed = size
    known = [item.identity for item in items]
    for name, values in {**factors, "blocks": known}.items():
        label = "conditions" if name == "probe" else name
        require(values, f"{label} must be at least one, got none")
        twice = sorted({value for value in values if list(values).count(value) > 1})
        require(not twice, f"{label} must differ from each other, got {''.join(twice[:1])!r} twice")
        require(
            all(value and value.strip() == value and "/" not in value for value in values),
            f"{label} must have names without slash or outer spaces, got {list(values)}",
        )
        require(name.replace("-", "_").isidentifier(), f"a factor must be one word, got {name!r}")
    unknown = [name for name in between if name not in factors]
    require(not unknown, f"between must name factors ({', '.join(factors)}), got {unknown}")
    if standard:
        require(standard in known, f"standard must be one of {', '.join(known)}, got {standard!r}")
        count = len(known) - 1
        require(count >= 2, f"comparisons need two blocks beside the standard, got {count}")
    require(repetitions >= 1, f"repetitions must be at least 1, got {repetitions}")
    require(seed >= 0, f"seed must not be negative, got {seed}")
    settings = list(itertools.product(*(v for n, v in factors.items() if n not in between)))
    groups = list(itertools.product(*(factors[name] for name in between)))
    require(
        participants >= len(groups),
        f"participants must be at least {len(groups)}, one for each group, got {participants}",
    )
    total = participants * len(settings) * len(items) * repetitions * (2 if standard else 1)
    require(total <= MAX_TRIALS, f"a design must have at most {MAX_TRIALS} trials, got {total}")
    return settings, groups, np.random.default_rng(seed)


@dataclass(frozen=True)
class Blocks:
    """The blocks of a study and where they are felt.

    Attributes
    ----------
    items : tuple of Item
        The blocks.
    faces : mapping of Counterface
        By identity.
    point : OperatingPoint
        The first of the set's grid under which every block rings, as far as nothing else is given.
    """

    items: tuple[Item, ...]
    faces: Mapping[str, Counterface]
    point: OperatingPoint

    def energies(self) -> dict[str, float]:
        """Predict the energy of vibration [J] of each block; each must release the probe."""
        found = dict(zip(self.faces, _predict_felt(self.faces.values(), self.point), strict=True))
        for name, face in self.faces.items():
            if not found[name] > 0.0:
                status = face.release(self.point).status
                reason = "walked over in time" if status is Status.RELEASES else status.value
                raise PipelineError(
                    f"every block must release the probe to be felt by its vibration; {name} "
                    f"is {reason} at friction {self.point.friction:g}"
                )
        return found


def _predict_felt(faces: Iterable[Counterface], point: OperatingPoint) -> list[float]:
    return list(choose_energies([predict_one(face, point) for face in faces])[0])


def choose_blocks(
    source: Declared | Sequence[float],
    felt: Mapping[str, float] = MappingProxyType({}),
    only: str | None = None,
) -> Blocks:
    """Choose the blocks of a study: those of a stimulus set, or sharp steps of some heights [m]."""
    if not isinstance(source, str | Path | StimulusSet):
        named = {f"step-{height * 1e6:03.6g}": height for height in source}
        return Blocks(
            tuple(Item(name, name.upper(), height) for name, height in named.items()),
            {name: Step(height) for name, height in named.items()},
            replace(PAPER, **dict[str, Any](felt)),
        )
    stimuli = source if isinstance(source, StimulusSet) else load_set(Path(source))
    blocks = [
        block
        for block in stimuli.step_block
        if only is None or matches_pattern(only, stimuli.name, block.id)
    ]
    if not blocks:
        chosen = f" that match {only!r}" if only else ""
        raise PipelineError(f"a study needs step blocks; the set {stimuli.name} has none{chosen}")
    grid = stimuli.prediction
    loads = [felt["normal_load"]] if "normal_load" in felt else grid.normal_loads
    points = [grid.first_point(**{**felt, "normal_load": load}) for load in loads]
    faces = [
        block.counterface()
        for block in sorted(stimuli.step_block, key=lambda one: one.height.nominal)
    ]
    # of the loads the first under which every block rings, and rises
    point = next(
        (
            point
            for point in points[:-1]
            if (np.diff([0.0, *_predict_felt(faces, point)]) > 0.0).all()
        ),
        points[-1],
    )
    return Blocks(
        tuple(Item(block.id, block.id.upper(), block.height.nominal) for block in blocks),
        {block.id: block.counterface() for block in blocks},
        point,
    )


def check_virtual_factor(name: str, levels: Sequence[str]) -> None:
    """Refuse a factor of virtual blocks that the program cannot change, or levels of no meaning."""
    require(
        name in VIRTUAL_FACTORS,
        "a factor of virtual blocks within participants must be one of "
        f"{', '.join(VIRTUAL_FACTORS)}, got {name!r}",
    )
    words = {"vibration": ("vibration-off", "vibration-on"), "block": (REAL, VIRTUAL)}
    for level in levels:
        if name in words:
            require(
                level in words[name],
                f"{name} must be one of {', '.join(words[name])}, got {level!r}",
            )
        else:
            require(parse_quantity(level, VIRTUAL_FACTORS[name]) > 0.0, f"{name} must be positive")


def find_designed_blocks(
    design: Sequence[Mapping[str, str]], where: Declared | None, felt: Mapping[str, float]
) -> Blocks:
    """Find the blocks of a design in a stimulus file; without one they are sharp steps."""
    heights = {
        row[name]: float(row[height]) / 1e6
        for row in design
        for name, height in _NAMED
        if row[name]
    }
    blocks = choose_blocks(sorted(set(heights.values())) if where is None else where, felt)
    faces = (
        {name: Step(height) for name, height in heights.items()} if where is None else blocks.faces
    )
    lacking = ", ".join(sorted(set(heights) - set(faces)))
    require(
        not lacking,
        f"the blocks of the design must be in the stimulus file, got no {lacking} [{where}]",
    )
    return replace(blocks, faces={name: face for name, face in faces.items() if name in heights})
