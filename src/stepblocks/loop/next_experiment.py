"""What to measure next: the trials, or the block to make, that would separate what this session could not."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepblocks.loop.search.explain import Explanation, Verdict
from stepblocks.loop.search.fit import fit
from stepblocks.loop.search.forward_model import Trials
from stepblocks.loop.search.next_trials import Rival, propose

_SHOWN = ("height_um", "load_n", "speed_mm_s")
_HEIGHTS_UM = (5.0, 10.0, 15.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 90.0)


def next_experiment(found: Explanation) -> dict[str, Any] | None:
    """Return settings that separate the rivals best, with the expected gain; None where nothing is open."""
    pair = _pair(found)
    if pair is None:
        return None
    names, first, second = pair
    trials = found.problem.trials
    extra = sorted({e.covariate for e in (*first[0], *second[0])} & set(trials.covariates) - set(_SHOWN))
    grid = _grid(trials, extra)
    proposal = propose(found.problem, first, second, grid, (*_SHOWN, *extra))
    if proposal is None:
        return {"separates": names, "trials": [], "note": "no setting within reach tells these apart"}
    document: dict[str, Any] = {
        "separates": names,
        "criterion": "T-optimality: expected difference of twice the log likelihood per trial",
        "trials": [s | {"expected_gain": g} for s, g in zip(proposal.settings, proposal.gain, strict=True)],
        "repeats": proposal.trials,
        "channel": proposal.channel,
    }
    best = float(proposal.settings[0]["height_um"])
    if best not in set(np.asarray(trials.covariates["height_um"], dtype=float).tolist()):
        document["block"] = {
            "name": f"step-{best:03.0f}",
            "height": f"{best:g} um",
            "edge_radius": "0 um",
            "tip": f"{float(np.median(np.asarray(trials.covariates['tip_radius_um'], dtype=float))):g} um",
            "friction": f"{float(np.clip(found.extended.values['friction'], 0.01, 0.9)):.3f}",
        }
    return document


def block_stimulus(experiment: Mapping[str, Any] | None) -> str | None:
    """Stimulus file of the block that an experiment asks for, as `stepblocks build` reads it; None where it asks none."""
    if not experiment or "block" not in experiment:
        return None
    from jinja2 import Environment, PackageLoader

    loads = ", ".join(f'"{load:g} N"' for load in sorted({float(trial["load_n"]) for trial in experiment["trials"]}))
    template = Environment(loader=PackageLoader("stepblocks.loop"), keep_trailing_newline=True, trim_blocks=True)
    return template.get_template("next-block.toml.j2").render(
        rivals=" from ".join(experiment["separates"]), loads=loads, **experiment["block"]
    )


def _pair(found: Explanation) -> tuple[list[str], Rival, Rival] | None:
    """Names of two models that are to be told apart, and the models."""
    if found.verdict is Verdict.NONE:
        return None
    current = found.extended
    for finding in found.findings:
        if finding.rivals:
            rival, fitted, _ = finding.rivals[0]
            others = [e for e in current.effects if e is not finding.effect]
            return [finding.effect.id, rival.id], (current.effects, current), ([*others, rival], fitted)
    # where nothing rivals it, ask what would confirm it: with it, against without it
    finding = min(found.findings, key=lambda f: (f.effect.named, f.gain))
    others = [e for e in current.effects if e is not finding.effect]
    without = fit(found.problem, tuple(others), current.values)
    return [finding.effect.id, "nothing"], (current.effects, current), (others, without)


def _grid(trials: Trials, extra: list[str]) -> Trials:
    def span(name: str) -> list[Any]:
        numbers = trials.numeric(name)
        if numbers is None:
            return sorted(set(trials.covariates[name].tolist()))
        return list(np.linspace(numbers.min(), numbers.max(), 5).tolist())

    loads = sorted({*np.unique(trials.covariates["load_n"]).tolist(), 1.5})
    speeds = sorted({*np.unique(trials.covariates["speed_mm_s"]).tolist(), 1.0, 40.0})
    rows = list(itertools.product(_HEIGHTS_UM, loads, speeds, *(span(name) for name in extra)))[:20000]
    columns: dict[str, NDArray[Any]] = {
        name: np.array([row[i] for row in rows]) for i, name in enumerate((*_SHOWN, *extra))
    }
    for name, column in trials.covariates.items():
        if name not in columns:
            numbers = trials.numeric(name)
            middle: Any = column[0] if numbers is None else float(np.median(numbers))
            columns[name] = np.full(len(rows), middle)
    empty = np.full((len(rows), len(trials.channels)), np.nan)
    known = dict(zip(np.asarray(trials.covariates["height_um"], float).tolist(), trials.block.tolist(), strict=True))
    block = np.array([known.get(float(h), f"step-{h:03.0f}") for h in columns["height_um"]])
    return Trials(columns, trials.channels, empty, empty, block)
