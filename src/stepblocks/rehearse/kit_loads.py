"""The loads of a kit of the apparatus in a simulated session: its weights, and their errors."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from stepblocks.parts.apparatus.declared import Apparatus
from stepblocks.parts.apparatus.loads import ErrorComponent, ErrorSource, Load, compute_normal_load

_SAME_LOAD = 0.01  # share by which a planned load may differ from that of a weight
_CHANCE_OF_THE_KIT = 5  # which stream of the seed of a session the kit draws from
# what is another for each weight: the rest is the same under all of them
_OF_A_WEIGHT = (ErrorSource.MASS, ErrorSource.ARM)
_MOST_KEPT = 64  # weights whose budgets are kept


def match_loads_to_kit_weights(
    kit: Apparatus, loads: Sequence[float]
) -> tuple[list[float], list[float]]:
    """Replace loads by those of the nearest weights, and list loads that no weight has.

    Parameters
    ----------
    kit : Apparatus
        Whose weights there are.
    loads : sequence of float
        As planned [N].

    Returns
    -------
    found : list of float
        Loads of the weights, in the same order [N].
    missing : list of float
        Loads that no weight has within 1 % [N].
    """
    found = []
    missing = []
    for load in loads:
        weight = find_nearest_weight(kit, load)
        if abs(weight.force / load - 1.0) > _SAME_LOAD:
            missing.append(load)
        else:
            found.append(weight.force)
    return found, missing


def find_nearest_weight(kit: Apparatus, load: float) -> Load:
    """Return the weight of a kit whose force is nearest to a load [N]."""
    return min(_list_weight_loads(kit), key=lambda weight: abs(weight.force - load))


@lru_cache(maxsize=_MOST_KEPT)
def _list_weight_loads(kit: Apparatus) -> tuple[Load, ...]:
    """List the forces of all weights with their budgets."""
    return tuple(compute_normal_load(kit, mass) for mass in kit.normal_weights)


def draw_trial_load_error(
    kit: Apparatus, load: float, seed: int, generator: np.random.Generator
) -> float:
    """Draw by how much a load is off in one trial [N].

    Parameters
    ----------
    kit : Apparatus
        Whose budget counts.
    load : float
        As set [N].
    seed : int
        Of the session, from which what is common to its trials is drawn.
    generator : Generator
        Of this trial.

    Returns
    -------
    float
        The sum of a draw of each line of the budget, rectangular over its half width.
    """
    weight = find_nearest_weight(kit, load)
    error = 0.0
    for component in weight.budget:
        if component.is_common:
            share = _draw_shared_error_share(component, weight, seed)
        else:
            share = generator.uniform(-1.0, 1.0)
        error += share * component.half_width
    return error


def _draw_shared_error_share(component: ErrorComponent, weight: Load, seed: int) -> float:
    """Draw the error that all trials of a session share, as a share of the half width."""
    stream = [seed, _CHANCE_OF_THE_KIT, list(ErrorSource).index(component.source)]
    if component.source in _OF_A_WEIGHT:
        stream.append(round(1e6 * weight.mass))
    return float(np.random.default_rng(stream).uniform(-1.0, 1.0))


def compute_largest_common_std(kit: Apparatus, loads: Sequence[float]) -> float:
    """Return the largest standard uncertainty [N] that all trials under some loads [N] share."""
    return max(find_nearest_weight(kit, load).common_std for load in loads)
