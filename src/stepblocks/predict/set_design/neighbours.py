"""How far neighbours of a set lie apart, and what making and setting do to that."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stepblocks.contact import Array
from stepblocks.contact.counterface import Counterface
from stepblocks.contact.domain import Real
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.uncertainty import compute_deviated_releases, draw_standard_normal_inputs
from stepblocks.errors import ContactError
from stepblocks.parts.conditions import PredictionGrid
from stepblocks.parts.kind import Part
from stepblocks.predict.predictions import Model, collect_standard_uncertainties, make_tip_dimension
from stepblocks.predict.set_design.curve import compute_drag_energy

DRAWS = 4000
MERGED = 0.5  # neighbours closer than this are taken for one [JND]
_SEED = 0
_TAILS = (0.025, 0.975)
_SETTING = ("ball_radius", "friction", "normal_load", "stiffness", "conversion")


@dataclass(frozen=True)
class Neighbours:
    """Two neighbours of a set.

    Attributes
    ----------
    first, second : str
        Identities of the weaker and the stronger block.
    distance : float
        Between their energies at nominal size, in just noticeable differences [1].
    low, high : float
        Ends of its 95 % interval, from the tolerances of both blocks and of the setting [1].
    reversal : float
        Probability that blocks made within tolerance change their order [1].
    merging : float
        Probability that blocks made within tolerance lie less than `MERGED` apart [1].
    """

    first: str
    second: str
    distance: float
    low: float
    high: float
    reversal: float
    merging: float


@dataclass(frozen=True)
class Felt:
    """A part of a set, how it is met, and what it gives at nominal size [J]."""

    part: Part
    face: Counterface
    energy: float


@dataclass(frozen=True)
class Spread:
    """Draws of the energies of one block [J]; infinite where it locks, 0 where nothing catches."""

    making: Array  # its sizes alone deviate, within their zones
    all: Array  # the setting deviates, too


def sample_block_energies(
    blocks: Sequence[Felt],
    grid: PredictionGrid,
    point: OperatingPoint,
    backward: bool,
    model: Model,
) -> list[Spread]:
    """Draw the energies of the blocks of a set.

    Sizes are drawn evenly from their tolerance zones, each block for itself; the setting is drawn
    from normal distributions, and is the same for all blocks of a draw.
    """
    tip = make_tip_dimension(grid, point.ball_radius)
    widths = collect_standard_uncertainties(blocks[0].part, grid, tip, point.normal_load)
    normal = draw_standard_normal_inputs(len(_SETTING), DRAWS, _SEED)
    setting: dict[str, Real] = {}
    for name, numbers in zip(_SETTING, normal, strict=True):
        if widths[name] > 0.0:
            setting[name] = widths[name] * numbers
    generator = np.random.default_rng(_SEED + 1)
    spreads = []
    for block in blocks:
        making = _sample_size_deviations(block.part, generator)
        spreads.append(
            Spread(
                _compute_deviated_energies(block, point, making, backward, model),
                _compute_deviated_energies(block, point, {**making, **setting}, backward, model),
            )
        )
    return spreads


def _sample_size_deviations(part: Part, generator: np.random.Generator) -> dict[str, Real]:
    """Draw the deviations of the sizes of a part from their zones [m]."""
    deviations: dict[str, Real] = {}
    for name, size in part.sizes.items():
        deviations[name] = generator.uniform(size.lower, size.upper, DRAWS)
    return deviations


def _compute_deviated_energies(
    block: Felt,
    point: OperatingPoint,
    deviations: Mapping[str, Real],
    backward: bool,
    model: Model,
) -> Array:
    """Compute energies [J] where sizes and setting deviate; drags are taken to second order."""
    _, energies = compute_deviated_releases(block.face, point, deviations, backward)
    energies = np.broadcast_to(energies, DRAWS)
    if model is Model.FORMULA:
        return energies
    change = np.zeros(DRAWS)
    for name, deviation in deviations.items():
        change += _compute_log_energy_changes(block, point, name, np.asarray(deviation), backward)
    slips = np.isfinite(energies) & (energies > 0.0)
    return np.where(slips, block.energy * np.exp(change), energies)


def _compute_log_energy_changes(
    block: Felt, point: OperatingPoint, input_name: str, deviation: Array, backward: bool
) -> Array:
    """Compute changes of ln E of a drag with one input, from drags at its extremes."""
    reached = float(np.abs(deviation).max())
    if not reached > 0.0:
        return np.zeros_like(deviation)
    ends = []
    for side in (-reached, reached):
        energy = _predict_deviated_energy(block, point, input_name, side, backward)
        ends.append(math.log(energy / block.energy))
    low, high = ends
    if math.isnan(low):
        low = -high
    if math.isnan(high):
        high = -low
    if math.isnan(low):  # held on either side: what is left of the draws is next to the nominal
        return np.zeros_like(deviation)
    share = deviation / reached
    slope, curvature = 0.5 * (high - low), 0.5 * (high + low)
    return slope * share + curvature * share * share


def _predict_deviated_energy(
    block: Felt, point: OperatingPoint, input_name: str, deviation: float, backward: bool
) -> float:
    """Drag where one input deviates [SI]; return the energy of the ring [J], NaN without one."""
    sizes = {key: size.nominal for key, size in block.part.sizes.items()}
    try:
        if input_name in sizes:
            sizes[input_name] = max(sizes[input_name] + deviation, 0.0)
            face = block.part.make_counterface(**sizes)
            return compute_drag_energy(face, point, backward)
        return compute_drag_energy(
            block.face, deviate_point(point, input_name, deviation), backward
        )
    except ContactError:  # such a value is out of the domain
        return math.nan


def deviate_point(point: OperatingPoint, field_name: str, deviation: float) -> OperatingPoint:
    """Return the operating point with one field of its own or of its tool deviating [SI]."""
    if hasattr(point.tool, field_name):
        value = getattr(point.tool, field_name) + deviation
        return replace(point, tool=replace(point.tool, **{field_name: value}))
    value = max(getattr(point, field_name) + deviation, 0.0)
    return replace(point, **{field_name: value})


def compute_jnd_distances(first_energies: Array, second_energies: Array, jnd_db: float) -> Array:
    """Return distances of energies in just noticeable differences [1]; 0 where neither slips."""
    with np.errstate(divide="ignore", invalid="ignore"):
        distances = 10.0 * (np.log10(second_energies) - np.log10(first_energies)) / jnd_db
    return np.where(np.isnan(distances), 0.0, distances)


def compare_neighbours(
    blocks: Sequence[Felt], spreads: Sequence[Spread], jnd_db: float
) -> tuple[Neighbours, ...]:
    """Compare each block with the next stronger one."""
    compared = []
    for index in range(len(blocks) - 1):
        weaker, stronger = blocks[index], blocks[index + 1]
        weaker_spread, stronger_spread = spreads[index], spreads[index + 1]
        drawn = compute_jnd_distances(weaker_spread.all, stronger_spread.all, jnd_db)
        made = compute_jnd_distances(weaker_spread.making, stronger_spread.making, jnd_db)
        low, high = np.quantile(drawn, _TAILS, method="inverted_cdf")
        nominal = 10.0 * math.log10(stronger.energy / weaker.energy) / jnd_db
        compared.append(
            Neighbours(
                first=weaker.part.id,
                second=stronger.part.id,
                distance=nominal,
                low=float(low),
                high=float(high),
                reversal=float((made < 0.0).mean()),
                merging=float((np.abs(made) < MERGED).mean()),
            )
        )
    return tuple(compared)
