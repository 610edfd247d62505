"""The experiments as lists of trials: their blocks and where they are felt, orders of conditions, balanced, and blinding codes."""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.contact.counterface import Counterface, Step
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import PAPER, OperatingPoint
from stepblocks.declare import load_declared
from stepblocks.errors import PipelineError, StudyError
from stepblocks.predict.perception import choose_energies
from stepblocks.predict.predictions import predict_one
from stepblocks.quantities import format_units
from stepblocks.select import matches_pattern
from stepblocks.study import require
from stepblocks.study.simulate import TYPICAL_OBSERVER, Z95, Observer

MAX_CONDITIONS = 26  # that one participant may meet
MAX_PARTICIPANTS = 1000
MAX_TRIALS = 200_000
_ALPHABET = (
    "ABCDEFHKLMNPRTUVWXY"  # no I, O, Q, S, Z, G, J: a hand writes them like others; 19 is prime
)
MAX_CODES = len(_ALPHABET) ** 2  # blocks that one study can tell apart

# Columns of design.csv, which tells all
WHEN = ("participant", "trial", "condition", "repetition")
_BLOCK = ("stimulus", "engraved", "code", "height_um")
DESIGN_COLUMNS = (
    "experiment",
    *WHEN,
    *_BLOCK,
    "standard",
    *(f"standard_{name}" for name in _BLOCK[1:]),
)

_NAMED = (("stimulus", "height_um"), ("standard", "standard_height_um"))  # columns of a design

Orders = NDArray[np.int64]
Sets = Sequence[
    tuple[int, Sequence[tuple[str, str]]]
]  # repetition, and codes of blocks with their condition


def make_williams_square(conditions: int) -> Orders:
    """Return Williams' orders, in which every condition follows every other equally often."""
    # Williams, E. J. (1949), Australian Journal of Scientific Research A 2, 149-168.
    if not 1 <= conditions <= MAX_CONDITIONS:
        raise StudyError(
            f"the number of conditions must lie between 1 and {MAX_CONDITIONS}, got {conditions}"
        )
    zigzag = np.array([(k + 1) // 2 if k % 2 == 0 else -((k + 1) // 2) for k in range(conditions)])
    square = (zigzag[np.newaxis, :] + np.arange(conditions)[:, np.newaxis]) % conditions
    return np.vstack([square, square[:, ::-1]]) if conditions % 2 and conditions > 1 else square


def allocate_orders(participants: int, conditions: int, generator: np.random.Generator) -> Orders:
    """Give every participant an order, whole Williams designs first, the rest from one more."""
    if not 1 <= participants <= MAX_PARTICIPANTS:
        raise StudyError(
            f"the number of participants must lie between 1 and {MAX_PARTICIPANTS}, got "
            f"{participants}"
        )
    square = make_williams_square(conditions)
    rows = square[np.arange(participants) % len(square)]
    relabelled = generator.permutation(conditions)[rows]
    return np.asarray(relabelled[generator.permutation(participants)], dtype=np.int64)


@dataclass(frozen=True)
class Balance:
    """How evenly conditions stand over positions and behind each other."""

    conditions: int
    position_spread: int  # largest minus smallest count of a condition in a position
    follower_spread: int  # the same of an ordered pair of different neighbours

    @property
    def exact(self) -> bool:
        """Whether positions and followers are balanced without remainder."""
        return self.position_spread == 0 and self.follower_spread == 0

    def __str__(self) -> str:
        if self.exact:
            return "order of conditions balanced exactly, for position and for carry-over"
        return (
            f"order of conditions balanced to within {self.position_spread} per position and "
            f"{self.follower_spread} per "
            f"neighbour; exact at multiples of {len(make_williams_square(self.conditions))} participants"
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
    """A block that is judged."""

    identity: str  # of the stimulus
    engraved: str  # the identity as it stands on the block
    height: float  # of its step [m]

    def __post_init__(self) -> None:
        if not (math.isfinite(self.height) and self.height > 0.0):
            raise StudyError(
                f"height must be positive and finite, got {self.height:g} m [block {self.identity}]"
            )

    def told(self) -> dict[str, str]:
        """Say which block it is, for who loads the blocks."""
        return {
            "stimulus": self.identity,
            "engraved": self.engraved,
            "height_um": f"{self.height * 1e6:.9g}",
        }


def assign_codes(items: Sequence[Item], generator: np.random.Generator) -> dict[str, Item]:
    """Give every block a code of two random letters and a check letter, which says nothing about the block."""
    require(
        len(items) <= MAX_CODES, f"a study must have at most {MAX_CODES} blocks, got {len(items)}"
    )
    size = len(_ALPHABET)
    codes = {}
    for item, number in zip(items, generator.permutation(MAX_CODES), strict=False):
        first, second = divmod(int(number), size)
        codes[
            _ALPHABET[first] + _ALPHABET[second] + _ALPHABET[-(2 * first + 3 * second) % size]
        ] = item
    return codes


@dataclass(frozen=True)
class Design:
    """A whole experiment."""

    experiment: str  # a name of `stepblocks.study.experiments.EXPERIMENTS`
    trials: Sequence[
        Mapping[str, str]
    ]  # rows of design.csv, by participant, in the order in which they are run
    blocks: Mapping[str, Item]  # by code
    balance: Balance  # of the order of conditions over participants
    advice: str = ""  # on levels that are too coarse to tell a threshold


def make_trial_row(
    experiment: str,
    when: Sequence[object],
    blocks: Mapping[str, Item],
    code: str,
    standard: str = "",
) -> dict[str, str]:
    """Write a trial as its row of design.csv: when (in `WHEN`), and the codes of its block and its standard."""
    cells = [experiment, *map(str, when)]
    for one in (code, standard):
        told = blocks[one].told() | {"code": one} if one else {}
        cells += [told.get(name, "") for name in _BLOCK]
    return dict(zip(DESIGN_COLUMNS, cells, strict=True))


def design_crossover(
    experiment: str,
    participants: int,
    items: Sequence[Item],
    repetitions: int,
    seed: int,
    probes: Sequence[str],
) -> Design:
    """Design an experiment in which every participant judges every block under every condition, conditions balanced."""
    blocks, generator = _prepare(participants, probes, items, repetitions, seed)
    orders = allocate_orders(participants, len(probes), generator)
    cells = [[(code, name) for code in blocks] for name in probes]
    sets = [
        [(time + 1, cells[one]) for one in order for time in range(repetitions)] for order in orders
    ]
    return Design(
        experiment, _shuffled(experiment, sets, blocks, generator), blocks, measure_balance(orders)
    )


def design_constant_stimuli(
    participants: int, items: Sequence[Item], repetitions: int, seed: int, standard: str
) -> Design:
    """Design a comparison with a standard by constant stimuli, in two intervals."""
    orders = ("standard-first", "standard-second")
    blocks, generator = _prepare(participants, orders, items, repetitions, seed)
    base = next((code for code, item in blocks.items() if item.identity == standard), None)
    if base is None:
        raise StudyError(
            f"standard must be one of the blocks {', '.join(i.identity for i in items)}, got "
            f"{standard!r}"
        )
    pairs = [(code, order) for code in blocks if code != base for order in orders]
    require(
        len(pairs) >= 4,
        f"constant stimuli need at least two blocks besides the standard, got {len(pairs) // 2}",
    )
    sets = [[(repetition, pairs) for repetition in range(1, repetitions + 1)]] * participants
    trials = _shuffled("constant", sets, blocks, generator, base)
    return Design(
        "constant", trials, blocks, measure_balance(np.zeros((participants, 1), dtype=np.int64))
    )


def _shuffled(
    experiment: str,
    sets: Sequence[Sets],
    blocks: Mapping[str, Item],
    generator: np.random.Generator,
    base: str = "",
) -> list[dict[str, str]]:
    """Make trials of each participant's sets, each set in an order of its own."""
    trials = []
    for participant, own in enumerate(sets, start=1):
        number = itertools.count(1)
        for repetition, cells in own:
            for code, condition in (cells[index] for index in generator.permutation(len(cells))):
                when = (participant, next(number), condition, repetition)
                trials.append(make_trial_row(experiment, when, blocks, code, base))
    return trials


def _prepare(
    participants: int, conditions: Sequence[str], items: Sequence[Item], repetitions: int, seed: int
) -> tuple[dict[str, Item], np.random.Generator]:
    """Refuse what is impossible; return the blocks by their codes and the source of all chance."""
    for name, values in (
        ("conditions", list(conditions)),
        ("blocks", [item.identity for item in items]),
    ):
        require(values, f"{name} must be at least one, got none")
        twice = sorted({value for value in values if values.count(value) > 1})
        if twice:
            raise StudyError(f"{name} must differ from each other, got {twice[0]!r} twice")
        if not all(value.strip() == value and value for value in values):
            raise StudyError(f"{name} must have names without spaces around them, got {values}")
    require(repetitions >= 1, f"repetitions must be at least 1, got {repetitions}")
    require(seed >= 0, f"seed must not be negative, got {seed}")
    total = participants * len(conditions) * len(items) * repetitions
    require(total <= MAX_TRIALS, f"a design must have at most {MAX_TRIALS} trials, got {total}")
    require(participants >= 1, f"participants must be at least 1, got {participants}")
    generator = np.random.default_rng(seed)
    return assign_codes(items, generator), generator


@dataclass(frozen=True)
class Blocks:
    """The blocks of a study and where they are felt."""

    items: tuple[Item, ...]
    faces: Mapping[str, Counterface]  # by identity
    # the first of the set's grid under which every block rings, as far as nothing else is asked for
    point: OperatingPoint

    def energies(self) -> dict[str, float]:
        """Predict the felt energy [J] of each block, the drag's where one differs from the formula; each must release the probe."""
        found = dict(zip(self.faces, _felt(self.faces.values(), self.point), strict=True))
        for name, face in self.faces.items():
            if not found[name] > 0.0:
                status = face.release(self.point).status
                said = "walked over in time" if status is Status.RELEASES else status.value
                rule = "every block must release the probe to be felt by its vibration"
                raise PipelineError(f"{rule}; {name} is {said} at friction {self.point.friction:g}")
        return found


def _felt(faces: Iterable[Counterface], point: OperatingPoint) -> list[float]:
    return list(choose_energies([predict_one(face, point) for face in faces])[0])


def _rise(energies: Sequence[float]) -> bool:
    return energies[0] > 0.0 and all(low < high for low, high in itertools.pairwise(energies))


def choose_blocks(
    source: str | Path | Sequence[float],
    felt: Mapping[str, Any] = MappingProxyType({}),
    only: str | None = None,
) -> Blocks:
    """Choose the blocks of a study: those of a stimulus file, or sharp steps of some heights [m], felt as in the paper."""
    if not isinstance(source, str | Path):
        named = {f"step-{height * 1e6:03.6g}": height for height in source}
        items = tuple(Item(name, name.upper(), height) for name, height in named.items())
        return Blocks(
            items, {name: Step(height) for name, height in named.items()}, replace(PAPER, **felt)
        )
    stimuli = load_declared(Path(source))
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
    point = next((point for point in points[:-1] if _rise(_felt(faces, point))), points[-1])
    items = tuple(Item(block.id, block.id.upper(), block.height.nominal) for block in blocks)
    return Blocks(items, {block.id: block.counterface() for block in blocks}, point)


def find_designed_blocks(
    design: Sequence[Mapping[str, str]], where: str | Path | None, felt: Mapping[str, float]
) -> Blocks:
    """Find the blocks of a design, standards included, in a stimulus file; without one they are sharp steps."""
    named = [(row[name], row[height]) for row in design for name, height in _NAMED]
    heights = {name: float(height) / 1e6 for name, height in named if name}
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


def describe_coarse_levels(
    blocks: Blocks, standard: str, observer: Observer = TYPICAL_OBSERVER
) -> str:
    """Say where too few blocks lie so near to a standard that answers can differ; empty where a fit can be expected."""
    try:
        energies = blocks.energies()
    except PipelineError:
        return ""  # a block that locks is felt by something else than its vibration
    heights = {item.identity: item.height for item in blocks.items}
    noise = math.sqrt(2.0) * observer.sensation_noise
    apart = [
        abs(math.log(energies[name] / energies[standard])) for name in energies if name != standard
    ]
    near = sum(distance < Z95 * noise for distance in apart)
    if near >= 2 or len(heights) < 2:
        return ""
    face, around = blocks.faces[standard], (0.99, 1.01)
    faces = {
        f"{share}": replace(face, height=heights[standard] * share)
        for share in around
        if isinstance(face, Step)
    }
    low, high = replace(blocks, faces=faces).energies().values()
    reach = Z95 * noise * 0.02 * heights[standard] / math.log(high / low) * 1e6
    middle = heights[standard] * 1e6
    return format_units(
        f"levels are coarse: at a Weber fraction of the energy of {observer.weber:g} only "
        f"{near} "
        f"of {len(heights) - 1} blocks "
        f"are mistaken for {standard} now and then, and a threshold needs two or more; add "
        "heights between "
        f"{middle - reach:.3g} and {middle + reach:.3g} um"
    )
