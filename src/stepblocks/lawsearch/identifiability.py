"""What a design cannot tell apart: effects that constants or other effects imitate."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import networkx as nx
import numpy as np

from stepblocks.lawsearch.directions import (
    build_tangent_basis,
    compute_tangent,
    compute_unit_directions,
)
from stepblocks.lawsearch.forward_model import Floats
from stepblocks.lawsearch.law import Law
from stepblocks.lawsearch.problem import Fit, Problem

_SAME_DIRECTION = 0.995  # cosine beyond which two effects imitate one another
_LEAST_WEIGHT = 0.2  # of a constant in an imitation, relative to the constant that moves most
_LEFT_TO_PRIOR = 0.9  # ratio of fitted and prior uncertainty from which the data say nothing


@dataclass(frozen=True)
class Identifiability:
    """What a design cannot tell apart.

    Attributes
    ----------
    imitated_by_constants : dict[str, tuple[str, ...]]
        For each effect that constants imitate, those constants, the one that moves most first.
    cannot_be_told_apart : list[list[str]]
        Groups of effects that imitate one another.
    left_to_their_prior : list[str]
        Constants of which the data say no more than the prior does.
    """

    imitated_by_constants: dict[str, tuple[str, ...]]
    cannot_be_told_apart: list[list[str]]
    left_to_their_prior: list[str]


def find_indistinguishable_effects(
    problem: Problem, base: Fit, effects: Sequence[Law]
) -> Identifiability:
    """Compare the directions in which effects and constants move the prediction.

    Parameters
    ----------
    problem : Problem
    base : Fit
        Fit of the nominal model.
    effects : sequence of Law
        Those of one amplitude are compared, each at the middle one of its shapes.
    """
    compared = []
    for law in effects:
        if len(law.amplitudes) == 1:
            middle = law.shapes[len(law.shapes) // 2]
            compared.append(replace(law, shapes=(middle,)))
    known = build_tangent_basis(base)
    directions = compute_unit_directions(problem, base, compared, known)
    imitated: dict[str, tuple[str, ...]] = {}
    for law in compared:
        if law.id in directions:
            continue
        constants = _list_imitating_constants(problem, base, law)
        if constants is not None:
            imitated[law.id] = constants
    return Identifiability(
        imitated, _group_effects_by_direction(directions), _list_constants_left_to_prior(base)
    )


def _list_imitating_constants(problem: Problem, base: Fit, law: Law) -> tuple[str, ...] | None:
    """List the constants that a least-squares imitation of a law moves most, in order.

    The result is None where the law itself moves nothing.
    """
    tangent = compute_tangent(problem, base, law, law.shapes[0])[:, 0]
    if not np.any(tangent):
        return None
    length = np.maximum(np.linalg.norm(base.jacobian, axis=0), 1e-300)
    scaled = base.jacobian / length
    full = np.concatenate([tangent, np.zeros(len(scaled) - len(tangent))])
    weights = np.abs(np.linalg.lstsq(scaled, full, rcond=None)[0])
    names = []
    for i in np.argsort(-weights):
        if weights[i] > _LEAST_WEIGHT * weights.max():
            names.append(base.parameters[i].name)
    return tuple(names)


def _group_effects_by_direction(directions: dict[str, Floats]) -> list[list[str]]:
    """Group the effects whose directions, unit vectors by name, are nearly the same."""
    alike = nx.Graph()
    for first, second in combinations(directions, 2):
        if abs(directions[first] @ directions[second]) > _SAME_DIRECTION:
            alike.add_edge(first, second)
    return list(map(sorted, nx.connected_components(alike)))


def _list_constants_left_to_prior(base: Fit) -> list[str]:
    """List the constants whose error stays that of the prior."""
    names = []
    for p in base.parameters:
        if np.isfinite(p.prior_std) and base.std[p.name] > _LEFT_TO_PRIOR * p.prior_std:
            names.append(p.name)
    return names
