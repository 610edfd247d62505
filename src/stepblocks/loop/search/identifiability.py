"""What no trial of this design can tell apart: found from derivatives alone, before anything is fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import networkx as nx
import numpy as np

from stepblocks.loop.search.effect import Effect
from stepblocks.loop.search.fit import Fit, Problem
from stepblocks.loop.search.gate import tangent
from stepblocks.loop.search.trials import Floats

_SAME = 0.995
_ABSORBED = 2e-3


@dataclass(frozen=True)
class Identifiability:
    """Groups that the design cannot tell apart."""

    # Effects that the constants of the nominal model imitate, with the constants that do
    absorbed: dict[str, tuple[str, ...]]
    groups: tuple[tuple[str, ...], ...]  # Effects that imitate one another beside the nominal model
    weak: tuple[str, ...]  # Constants that the data leave open: their error stays that of the prior


def identifiability(problem: Problem, base: Fit, effects: Sequence[Effect]) -> Identifiability:
    """Compare the directions in which effects and constants move the prediction."""
    rows = base.residual.size
    length = np.maximum(np.linalg.norm(base.jacobian, axis=0), 1e-300)
    known, _ = np.linalg.qr(base.jacobian / length)
    directions: dict[str, Floats] = {}
    absorbed: dict[str, tuple[str, ...]] = {}
    for effect in effects:
        if len(effect.amplitudes) != 1:
            continue
        raw = tangent(problem, base, effect, effect.shapes[len(effect.shapes) // 2])[:, 0]
        full = np.concatenate([raw, np.zeros(base.jacobian.shape[0] - rows)])
        size = float(np.linalg.norm(full))
        if size < 1e-9:
            continue
        rest = full / size - known @ (known.T @ (full / size))
        left = float(np.linalg.norm(rest))
        if left < _ABSORBED:
            absorbed[effect.id] = _imitators(base, full / size)
        else:
            directions[effect.id] = rest / left
    return Identifiability(absorbed, _groups(directions), _weak(base))


def _imitators(base: Fit, direction: Floats) -> tuple[str, ...]:
    """Constants that a least-squares imitation of a direction moves most."""
    length = np.maximum(np.linalg.norm(base.jacobian, axis=0), 1e-300)
    weights = np.abs(np.linalg.lstsq(base.jacobian / length, direction, rcond=None)[0])
    order = np.argsort(-weights)
    return tuple(base.parameters[i].name for i in order if weights[i] > 0.2 * weights[order[0]])


def _groups(directions: dict[str, Floats]) -> tuple[tuple[str, ...], ...]:
    graph = nx.Graph()
    names = list(directions)
    for i, first in enumerate(names):
        for second in names[i + 1 :]:
            if abs(float(directions[first] @ directions[second])) > _SAME:
                graph.add_edge(first, second)
    return tuple(tuple(sorted(group)) for group in nx.connected_components(graph))


def _weak(base: Fit) -> tuple[str, ...]:
    return tuple(p.name for p in base.parameters if np.isfinite(p.prior_std) and base.std[p.name] > 0.9 * p.prior_std)
