"""Ridges, grooves and gratings: all features of each profile, or of a map where its profiles do not agree."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from stepblocks.artefacts.scans.scan import HeightMap, Profile
from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import Component, Instrument, Measured, measured_from_profiles, with_budget
from stepblocks.inspect.levelling import Levels, fit_features, measured_features
from stepblocks.inspect.map_levels import fit_grating, masked_step
from stepblocks.inspect.measure import AS_FOUND, How, Inspected, Shown, Window, drawn, sampled, tried
from stepblocks.inspect.noise import LEAST_SCATTER, Array, NoiseUncertainty, robust_scale
from stepblocks.inspect.type_a1 import evaluate_a1

_FITS = 2.0  # scatter about type A1 over that about a polynomial, up to which type A1 is taken [1]
_LEAST_SHARE = 0.5  # of the profiles of a map that must agree on what they cross [1]
_DEGREE_NAMES = {1: "line", 2: "parabola", 3: "cubic"}


def measure_groove(
    scan: Profile | HeightMap, instrument: Instrument, how: How = AS_FOUND, key: str = "groove_depth"
) -> Inspected:
    """Depth of all grooves or ridges of a scan: by type A1 or A2 where their windows fit, else on a masked polynomial.

    A map whose rows do not agree on what they cross is evaluated across its columns, then by two levels, then as a grating.
    """
    ways: list[Callable[[], Inspected]] = [lambda: _by_rows(scan, instrument, how, key)]
    if isinstance(scan, HeightMap):
        turned = replace(scan, height=np.ascontiguousarray(scan.height.T), dx=scan.dy, dy=scan.dx)
        if how.along == "y":
            ways = [lambda: _by_rows(turned, instrument, how, key)]
        elif how.along is None:
            ways += [lambda: _by_rows(turned, instrument, how, key), lambda: _masked(scan, instrument, how, key)]
    ways.append(lambda: _grating(scan, instrument, how, key))
    refused = []
    for way in ways:
        try:
            return way()
        except MetrologyError as error:
            refused.append(str(error).removesuffix(f" [{scan.source}]"))
    raise MetrologyError(f"{'; '.join(dict.fromkeys(refused))} [{scan.source}]")


@dataclass(frozen=True)
class _Row:
    """What one profile says."""

    values: tuple[tuple[float, NoiseUncertainty], ...]  # of each feature [m]
    spans: tuple[tuple[float, float], ...]  # edges of each [m]
    others: tuple[tuple[float, ...], ...]  # change of each by other windows or levellings [m]
    name: str  # of the evaluation
    windows: tuple[Window, ...]
    fitted: Array  # shape (n,); m
    rejected: int


def _row(x: Array, z: Array, how: How) -> _Row:
    """Evaluate all features of a profile, each by what its windows allow; and again with other windows, for the form."""
    levels = measured_features(x, z, how.degree, how.exclusion)
    chosen = [one for index, one in enumerate(levels.features, 1) if how.edges is None or index in how.edges]
    if not chosen:
        raise MetrologyError(f"edges must name features of the {len(levels.features)} found, got {how.edges}")
    wide = _otherwise(x, z, levels, how)
    values, changes, names, windows = [], [], set(), []
    for feature in chosen:
        at = levels.features.index(feature)
        height, noise, name = feature.height, feature.noise, f"masked {_DEGREE_NAMES[levels.degree]}"
        others = tuple(one.features[at].height - height for one in wide if len(one.features) == len(levels.features))
        if how.degree is None and how.exclusion is None and np.isfinite(feature.end):
            found, _ = tried(lambda span: evaluate_a1(x, z, span), [(feature.begin, feature.end)])
            best = found[0][1] if found else None
        else:
            best = None
        if best is not None:
            seen = np.zeros_like(levels.used)
            for begin, end in best.windows:
                seen |= (x >= begin) & (x <= end) & levels.used
            # on a bow a polynomial fits the same points better than the line of type A1
            if best.scatter < _FITS * float(np.sqrt(np.mean((z - levels.level)[seen] ** 2))) or best.kind == "A2":
                height, noise, name = -best.depth, best.noise, f"type {best.kind}"
                windows += [(*span, one) for span, one in zip(best.windows, "ACB", strict=True)]
                others = (np.sqrt(3.0) * (best.depth - best.near),)
        changes.append(others)
        values.append((height, noise))
        names.add(name)
    spans = tuple((one.begin, one.end) for one in chosen)
    name = " and ".join(sorted(names))
    return _Row(tuple(values), spans, tuple(changes), name, tuple(windows), levels.level, levels.rejected)


def _otherwise(x: Array, z: Array, levels: Levels, how: How) -> list[Levels]:
    """Fit the same edges with the next polynomial, and with more kept out at them."""
    step = float(x[1] - x[0])
    wider = [
        replace(
            one,
            begin=one.begin - 0.5 * (one.end - one.begin) - 2 * step,
            end=one.end + 0.5 * (one.end - one.begin) + 2 * step,
        )
        for one in levels.edges
    ]
    degrees = [levels.degree + 1 if levels.degree < 3 else 2, levels.degree]
    asked = zip((levels.edges, wider), degrees if how.degree is None else [how.degree] * 2, strict=True)
    return [found for _, found in tried(lambda pair: fit_features(x, z, pair[0], pair[1]), asked)[0]]


def _by_rows(scan: Profile | HeightMap, instrument: Instrument, how: How, key: str) -> Inspected:
    rows, notes = sampled(scan, how)
    results, refused = tried(lambda row: _row(row.position, row.height, how), rows)
    kinds = [(len(one.values), one.name) for _, one in results]
    usual, name = max(sorted(set(kinds)), key=kinds.count) if kinds else (0, "")
    same = [(row, one) for row, one in results if (len(one.values), one.name) == (usual, name)]
    agreed = [(row, one) for (row, one), alike in zip(same, _alike([one for _, one in same]), strict=True) if alike]
    if len(agreed) < _LEAST_SHARE * len(rows) or not agreed:
        if len(rows) == 1:
            raise MetrologyError(refused[0])
        share = f"{len(agreed)} of {len(rows)} ({_LEAST_SHARE:.0%} needed)"
        rule = f"profiles must agree on the features that they cross, got {share}"
        raise MetrologyError(f"{rule}, the first other since {refused[0]}" if refused else rule)
    if len(agreed) < len(rows):
        notes.append(
            f"{len(rows) - len(agreed)} of {len(rows)} profiles refused"
            + (f", the first since {refused[0]}" if refused else "")
        )
    first, best = agreed[0]
    label = key.replace("_", " ")
    each = []
    for index in range(usual):
        heights = [abs(one.values[index][0]) for _, one in agreed]
        noise = [one.values[index][1] for _, one in agreed]
        form = Component("form", _form(agreed, index), how="change by other windows or levelling, rectangular")
        each.append(
            measured_from_profiles(f"{label} {index + 1}" if usual > 1 else label, heights, noise, instrument, [form])
        )
    values = {key: each[0]} if usual == 1 else {key: _mean_of(label, each, instrument)}
    if usual > 1:
        values |= {f"{key}_{index}": one for index, one in enumerate(each, 1)}
        values |= _pitch_of(label, [one for _, one in agreed], first.spacing, instrument)
    else:
        values |= _widths(label, [one for _, one in agreed], first.spacing, instrument)
    if outliers := sum(one.rejected for _, one in agreed):
        notes.append(f"{outliers} points left out as spikes")
    convention = f"ISO 5436-1 {name}, profile by profile, unfiltered"
    if "masked" in name:
        convention = f"{name} beside the flanks, profile by profile"
    spans = best.windows or tuple((begin, min(end, float(first.position[-1])), "") for begin, end in best.spans)
    return Inspected(values, convention, tuple(notes), drawn(first, best.fitted, spans))


def _form(agreed: list[tuple[Profile, _Row]], index: int) -> float:
    """Largest mean change of a height by another evaluation, less what noise alone changes, as a rectangle [m]."""
    changes = [one.others[index] for _, one in agreed]
    noise = float(np.mean([one.values[index][1].std ** 2 for _, one in agreed])) / len(agreed)
    means = [float(np.mean([one[k] for one in changes])) for k in range(min(map(len, changes)))]
    return float(np.sqrt(max(max((one**2 for one in means), default=0.0) - 2.0 * noise, 0.0) / 3.0))


def _alike(rows: list[_Row]) -> list[bool]:
    """Whether the features of each profile lie where the others have them, a slant over the map allowed, and are as high."""
    if len(rows) < 3:
        return [True] * len(rows)
    heights = np.array([[value for value, _ in row.values] for row in rows])
    begins = np.array([[begin for begin, _ in row.spans] for row in rows])
    ends = np.array([[end for _, end in row.spans] for row in rows])
    lag = max(len(rows) // 2, 1)
    along = begins - np.median((begins[lag:] - begins[:-lag]) / lag, axis=0) * np.arange(len(rows))[:, np.newaxis]
    off = np.abs(along - np.median(along, axis=0))
    scatter = np.array([robust_scale(column) for column in along.T])
    widths = np.where(np.isfinite(ends), 0.25 * (ends - begins), 0.02 * (np.max(begins) - np.min(begins)))
    middle = np.median(heights, axis=0)
    agree = (off <= np.maximum(widths, 8.0 * scatter + LEAST_SCATTER)) & (
        np.abs(heights - middle) <= 0.5 * np.abs(middle)
    )
    return [bool(one) for one in agree.all(axis=1)]


def _mean_of(label: str, each: list[Measured], instrument: Instrument) -> Measured:
    """Mean over features: their scatter holds the noise of each; what the instrument owes is shared by all."""
    heights = np.array([one.value for one in each])
    own = float(heights.std(ddof=1) / np.sqrt(len(each)))
    form = float(np.mean([part.std for one in each for part in one.components if part.name == "form"]))
    parts = [
        Component("scatter", own, len(each) - 1.0, f"over {len(each)} features"),
        Component("form", form, how="mean of theirs"),
    ]
    return with_budget(f"{label}, mean", float(heights.mean()), parts, instrument)


def _pitch_of(label: str, rows: list[_Row], spacing: float, instrument: Instrument) -> dict[str, Measured]:
    middles = np.array([[0.5 * (begin + end) for begin, end in row.spans] for row in rows])
    if not np.isfinite(middles).all():
        return {}
    pitches = np.diff(middles, axis=1).mean(axis=0)
    std = float(pitches.std(ddof=1) / np.sqrt(len(pitches))) if len(pitches) > 1 else spacing / np.sqrt(6.0)
    dof = len(pitches) - 1.0 if len(pitches) > 1 else np.inf
    part = Component(
        "scatter",
        float(np.hypot(std, spacing / np.sqrt(6.0) / len(pitches))),
        dof,
        "over the pitches, and one interval",
    )
    return {"feature_pitch": with_budget("pitch", float(pitches.mean()), [part], instrument, axes=(0.0, 1.0))}


def _widths(label: str, rows: list[_Row], spacing: float, instrument: Instrument) -> dict[str, Measured]:
    widths = np.array([end - begin for row in rows for begin, end in row.spans])
    if not np.isfinite(widths).all():
        return {}
    scatter = float(widths.std(ddof=1) / np.sqrt(len(widths))) if len(widths) > 1 else 0.0
    part = Component(
        "sampling", float(np.hypot(spacing / np.sqrt(6.0), scatter)), how="one interval at either edge, rectangular"
    )
    return {
        "feature_width": with_budget(
            f"width W of the {label.split()[0]}, at half its height",
            float(widths.mean()),
            [part],
            instrument,
            axes=(0.0, 1.0),
        )
    }


def _masked(scan: HeightMap, instrument: Instrument, how: How, key: str) -> Inspected:
    step = masked_step(scan, how.exclusion)
    try:
        form = abs(masked_step(scan, 1.5 * step.exclusion).depth - step.depth) / np.sqrt(3.0)
    except MetrologyError:
        form = np.nan
    noise = Component("noise", step.noise.std, step.noise.dof, "scatter over rows, with the correlation of neighbours")
    change = Component("form", float(form), how="change with one and a half times the exclusion, rectangular")
    value = with_budget(key.replace("_", " "), abs(step.depth), [noise], instrument, [change])
    convention = (
        f"masked step over {step.features} features and {step.rows} rows: each row levelled on the reference between the "
        f"features, {step.exclusion * 1e6:.3g} um kept from every edge"
    )
    note = "type A1 not used: the profiles cross several features, so its windows would lie on the neighbours"
    return Inspected({key: value}, convention, (note,), Shown(*step.profile))


def _grating(scan: Profile | HeightMap, instrument: Instrument, how: How, key: str) -> Inspected:
    if how.exclusion is not None:
        raise MetrologyError("exclusion must not be given for a grating, which has no faces")
    if isinstance(scan, Profile):
        found = fit_grating(scan.position, np.zeros(1), scan.height[np.newaxis, :])
    else:
        found = fit_grating(scan.x, scan.y, scan.height)
    noise = Component("noise", found.noise.std, found.noise.dof, "scatter over parts of the scan")
    pitch = Component("sampling", found.pitch_std, how="a part of a sampling interval over all periods")
    values = {
        key: with_budget(key.replace("_", " "), found.depth, [noise], instrument),
        "feature_pitch": with_budget("pitch, across the lines", found.pitch, [pitch], instrument, axes=(0.0, 1.0)),
    }
    convention = f"grating: from the lowest to the highest point of the mean shape, which repeats in {found.share:.0%} of the variance"
    note = f"lines at {np.degrees(found.angle):.1f} deg from the y axis"
    return Inspected(values, convention, (note,), Shown(*found.shape))
