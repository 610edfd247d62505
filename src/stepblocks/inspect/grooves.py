"""Ridges and grooves.

All features of each profile are measured, or those of a map where its profiles do not agree.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import (
    Component,
    Instrument,
    Measured,
    add_instrument_components,
    average_profiles,
)
from stepblocks.inspect.levelling import (
    LEAST_FACE,
    Feature,
    FoundEdge,
    Levels,
    find_edges,
    fit_heights,
    measure_features,
)
from stepblocks.inspect.map_levels import is_periodic, measure_dots, measure_masked
from stepblocks.inspect.measure import (
    AS_FOUND,
    LEAST_SHARE,
    Evaluation,
    EvaluationOptions,
    Shown,
    Window,
    evaluate_each,
    keep_profiles_that_agree,
    list_directions,
    list_features,
    sample_profiles,
)
from stepblocks.inspect.noise import Array
from stepblocks.inspect.type_a1 import TypeA1, evaluate_a1, find_apex
from stepblocks.scans.scan import HeightMap, ScannedProfile

_FITS = 2.0  # scatter about type A1 over that about a polynomial, up to which type A1 is taken [1]
# profiles of a map that are evaluated first: of half that agree, two of them do but once in thirty
_TRIED = 8
_LEVEL = 0.1  # of a step that its faces may be off, and of a face over which they may be [1]
# of steps in one direction, by the slope between them, from which they may be a sawtooth [1]
_TAKEN_BACK = 0.5
_MOST_DROPPED = 0.2  # part of the points of a profile that may be spikes [1]
# of the radius of a stylus, by which a wall stands farther out at most [1]: 1/cos - tan of 30 deg
_CONTACT = 0.58
_MOST_HIDDEN = 3  # times that features are sought beside those that were found
_DEGREE_NAMES = {1: "line", 2: "parabola", 3: "cubic"}


def measure_groove(
    scan: ScannedProfile | HeightMap,
    instrument: Instrument,
    options: EvaluationOptions = AS_FOUND,
    key: str = "groove_depth",
    sign: float = 0.0,
) -> Evaluation:
    """Depth of all grooves or ridges of a scan.

    It is by type A1 or A2 where their windows fit, and otherwise on a masked polynomial.
    """
    # A map whose rows do not agree is evaluated across its columns, then by two levels or by dots.
    ways: list[Callable[[], Evaluation]] = [
        partial(_measure_by_rows, one, instrument, options, key, sign)
        for one in list_directions(scan, options.along)
    ]
    # a part, a level or an edge is followed profile by profile alone
    by_rows = (options.along, options.begin, options.end, options.degree, options.edges)
    if isinstance(scan, HeightMap) and all(one is None for one in by_rows):
        ways.append(partial(measure_masked, scan, instrument, options, key))
        if key == "depth":  # of a standard: a hole is no groove of a block
            ways.append(partial(measure_dots, scan, instrument, options, key))
    refused = []
    for way in ways:
        try:
            return way()
        except UnlikeError:
            raise
        except MetrologyError as error:
            refused.append(str(error))
    raise MetrologyError(refused[0])


class UnlikeError(MetrologyError):
    """A scan shows a feature well, and it is not the one that was asked for."""


@dataclass(frozen=True)
class _Seen:
    # What one profile says of one feature.
    feature: Feature  # its height by what its windows allow
    changes: tuple[float, ...]  # of the height by other windows or levellings [m]
    name: str  # of the evaluation
    windows: tuple[Window, ...]
    outliers: int  # of the windows


@dataclass(frozen=True)
class _Row:
    # What one profile says.
    seen: tuple[_Seen, ...]
    fitted: Array  # shape (n,); m
    rejected: int
    points: int  # with the rejected

    @property
    def kind(self) -> tuple[int, str]:
        # How many features it shows, and how they were evaluated.
        return len(self.seen), " and ".join(sorted({one.name for one in self.seen}))

    @property
    def spans(self) -> list[tuple[float, float]]:
        # Edges of each feature [m].
        return [(one.feature.begin, one.feature.end) for one in self.seen]


def _evaluate_row(
    options: EvaluationOptions, crossing: tuple[ScannedProfile, list[FoundEdge]]
) -> _Row:
    # Evaluate all features of a profile, each by what its windows allow; and again with other
    # windows, for the form.
    row, edges = crossing
    x, z = row.position, row.height
    levels = measure_features(x, z, edges, options.degree, options.exclusion)
    for _ in range(_MOST_HIDDEN):
        if not (hidden := _find_hidden_edges(x, z, levels)):
            break
        edges = sorted([*levels.edges, *hidden], key=lambda one: one.position)
        more = evaluate_each(
            lambda own: measure_features(x, z, own, options.degree, options.exclusion), [edges]
        )[0]
        if not more or more[0][1].rejected >= levels.rejected:
            break
        levels = more[0][1]
    chosen = [
        index
        for index in range(len(levels.features))
        if options.edges is None or index + 1 in options.edges
    ]
    MetrologyError.require(
        chosen, f"edges must name features of the {len(levels.features)} found, got {options.edges}"
    )
    others = _evaluate_otherwise(x, z, levels, options)
    known = np.isfinite(z)
    level = np.polynomial.Polynomial.fit(x[known], z[known], 1)(x[known])
    extent = float(np.ptp(z[known] - level))
    seen = []
    for index in chosen:
        feature = levels.features[index]
        height = feature.height
        name = f"masked {_DEGREE_NAMES[levels.degree]}"
        windows: list[Window] = []
        change = tuple(float(one[index]) - height.value for one in others)
        best = (
            None
            if options.degree is not None or options.exclusion is not None
            else _evaluate_by_windows(x, z, levels, feature)
        )
        apex, again = (
            find_apex(x, z - levels.level, height.value, (feature.begin, feature.end), part)
            if best is None and feature.end < np.inf
            else None
            for part in (1.0 / 3.0, 0.5)
        )
        if apex is not None:
            name = f"type A2 on a masked {_DEGREE_NAMES[levels.degree]}"
            height = replace(apex, value=height.value + apex.value, std=height.std + apex.std)
            change = (0.0 if again is None else again.value - apex.value,)
        elif best is None:
            _check_level(x, z, levels, feature)
        else:
            height = replace(best.depth, value=-best.depth.value)
            name = f"type {best.kind}"
            windows = [(*span, one) for span, one in zip(best.windows, "ACB", strict=True)]
            change = (np.sqrt(3.0) * (best.depth.value - best.near),)
        MetrologyError.require(
            not abs(height.value) > (1.0 + _LEVEL) * extent,
            f"step must not exceed the range of the profile, {extent * 1e9:.4g} nm, got "
            f"{abs(height.value) * 1e9:.4g} nm: its features are too near for a reference",
        )
        seen.append(
            _Seen(
                replace(feature, height=height),
                change,
                name,
                tuple(windows),
                0 if best is None else best.outliers,
            )
        )
    # a dome is off a level top, and no spike
    domed = any("A2" in one.name for one in seen)
    return _Row(
        tuple(seen),
        levels.level,
        sum(one.outliers for one in seen) if domed else levels.rejected,
        int(levels.used.sum()) + levels.rejected,
    )


def _find_hidden_edges(x: Array, z: Array, levels: Levels) -> list[FoundEdge]:
    # Find edges that the fit of much larger features left out as if they were spikes.
    beside = np.isfinite(z)
    for edge in levels.edges:
        slack = edge.end - edge.begin + LEAST_FACE * float(x[1] - x[0])
        beside &= (x < edge.begin - slack) | (x > edge.end + slack)
    for one in levels.features:  # a domed top, which a level one does not fit, hides no edges
        if one.end < np.inf and find_apex(
            x, z - levels.level, one.height.value, (one.begin, one.end), 0.5
        ):
            beside &= (x < one.begin) | (x > one.end)
    lost = np.flatnonzero(np.diff(np.concatenate([[0], beside & ~levels.used, [0]]).astype(int)))
    if not (lost[1::2] - lost[::2] >= LEAST_FACE).any():
        return []
    rest = np.where(beside, z - levels.level, np.nan)
    return [edge for _, found in evaluate_each(partial(find_edges, x), [rest])[0] for edge in found]


def _check_level(x: Array, z: Array, levels: Levels, feature: Feature) -> None:
    # Refuse a step beside faces that are not level: the height of a sawtooth is what one chooses.
    height = feature.height.value
    points = int(levels.used.sum()) + levels.rejected
    MetrologyError.require(
        levels.rejected <= _MOST_DROPPED * points,
        f"at most {_MOST_DROPPED:.0%} of the points of a profile may be spikes, got "
        f"{levels.rejected / points:.0%}",
    )
    # flanks that overlap may cross half of their heights in another order
    ends = sorted([float(x[0]), *(edge.position for edge in levels.edges), float(x[-1])])
    at = ends.index(feature.begin)
    kept, seen = (
        np.histogram(x[points], ends)[0][at - 1 : at + 1]
        for points in (levels.used, np.isfinite(z))
    )
    # what a profile with whole features cuts at its ends has less
    is_edge = not any(np.isfinite(one.end) for one in levels.features)
    MetrologyError.require(
        not is_edge or (kept >= np.maximum(LEAST_FACE // 2, seen // 2)).all(),
        f"faces beside a single step must keep half of their points, and {LEAST_FACE // 2}, "
        f"got {kept[0]} of {seen[0]} and {kept[1]} of {seen[1]}",
    )
    rest = float(np.sqrt(np.mean((z - levels.level)[levels.used] ** 2)))
    face = float(levels.used.sum()) / (len(levels.edges) + 1)
    MetrologyError.require(
        rest <= _LEVEL * abs(height) or levels.together <= _LEVEL * face,
        f"faces beside a step of {abs(height) * 1e9:.4g} nm must be level, got residuals of "
        f"{rest * 1e9:.3g} nm that wander together over {levels.together / face:.0%} of a face",
    )
    single = np.array([one.height.value for one in levels.features if not np.isfinite(one.end)])
    back = (
        1.0 - float(levels.level[-1] - levels.level[0]) / float(single.sum())
        if len(single) > 1
        else 0.0
    )
    in_one_direction = abs(single.sum()) > _TAKEN_BACK * np.abs(single).sum()
    MetrologyError.require(
        not (abs(back - 1.0) < _TAKEN_BACK and in_one_direction),
        f"steps must not be those of a sawtooth, got {len(single)} in one direction, of "
        f"which the slope takes back {back:.0%}",
    )


def _evaluate_by_windows(x: Array, z: Array, levels: Levels, feature: Feature) -> TypeA1 | None:
    # Type A1 or A2 of a feature; None where its windows do not fit, or where a bow lets the
    # polynomial fit the same points better.
    found = evaluate_each(lambda span: evaluate_a1(x, z, span), [(feature.begin, feature.end)])[0]
    if not found:
        return None
    best = found[0][1]
    seen = levels.used & np.any([(x >= begin) & (x <= end) for begin, end in best.windows], axis=0)
    if not seen.any():
        return None
    polynomial = float(np.sqrt(np.mean((z - levels.level)[seen] ** 2)))
    return best if best.kind == "A2" or best.scatter < _FITS * polynomial else None


def _evaluate_otherwise(
    x: Array, z: Array, levels: Levels, options: EvaluationOptions
) -> list[Array]:
    # Heights by the next polynomial, and with more kept out at the edges.
    wider = []
    for one in levels.edges:
        more = 0.5 * (one.end - one.begin) + 2 * float(x[1] - x[0])
        wider.append(replace(one, begin=one.begin - more, end=one.end + more))
    degrees = [levels.degree + 1 if levels.degree < 3 else 2, levels.degree]
    asked = zip(
        (levels.edges, wider),
        degrees if options.degree is None else [options.degree] * 2,
        strict=True,
    )
    return [found for _, found in evaluate_each(lambda pair: fit_heights(x, z, *pair), asked)[0]]


def _measure_by_rows(
    scan: ScannedProfile | HeightMap,
    instrument: Instrument,
    options: EvaluationOptions,
    key: str,
    sign: float,
) -> Evaluation:
    rows, notes = sample_profiles(scan, options)
    crossing, refused = evaluate_each(lambda row: find_edges(row.position, row.height), rows)
    rule = "profiles must agree on the features that they cross"
    if len(rows) > 1 and len(refused) > len(crossing):
        raise MetrologyError(
            f"{rule}, got {len(crossing)} of {len(rows)} that cross any, others since {refused[0]}"
        )
    some = crossing[:: max(len(crossing) // _TRIED, 1)]
    tried = [one.kind for _, one in evaluate_each(partial(_evaluate_row, options), some)[0]]
    MetrologyError.require(
        len(some) < _TRIED or max(map(tried.count, tried), default=0) >= 2,
        f"{rule}, got less than 2 of {len(some)} alike",
    )
    results, others = evaluate_each(
        partial(_evaluate_row, options), crossing, LEAST_SHARE * len(rows) - len(refused)
    )
    kinds = [one.kind for _, one in results]
    kind = max(sorted(set(kinds)), key=kinds.count, default=(0, ""))
    usual = np.array([one.spans for _, one in results if one.kind == kind])
    same = [
        (row, _keep_nearest_features(one, np.median(usual[..., 0], axis=0)))
        for (row, _), one in results
    ]
    same = [(row, one) for row, one in same if one.kind == kind]
    if more := sum(len(one.seen) > kind[0] for _, one in results):
        notes.append(
            f"{more} of {len(results)} profiles cross other features beside the {kind[0]} that are "
            "evaluated"
        )
    spans = np.array([one.spans for _, one in same]).reshape(len(same), kind[0], 2)
    begins = spans[..., 0]
    widths = spans[..., 1] - begins
    slack = np.where(
        np.isfinite(widths), 0.25 * widths, 0.02 * np.ptp(begins) if begins.size else 0.0
    )
    sizes = np.array([[each.feature.height.value for each in one.seen] for _, one in same]).reshape(
        begins.shape
    )
    kept = keep_profiles_that_agree(
        same, np.stack([sizes, begins, slack]), rows, refused + others, notes
    )
    first, best = kept[0]
    found = [one for _, one in kept]
    count, way = kind
    spans = np.array([one.spans for one in found])
    single = not np.isfinite(spans).all()  # steps, which have neither width nor pitch
    MetrologyError.require(
        not (single and isinstance(scan, HeightMap) and is_periodic(scan.height)),
        "single steps must not repeat over a map, as the teeth of a grating do; a part of "
        "it without repetition can be evaluated",
    )
    label = key.replace("_", " ")
    each = []
    for index in range(count):
        signed = [one.seen[index].feature.height for one in found]
        heights = [replace(one, value=abs(one.value)) for one in signed]
        form = Component(
            "form",
            _estimate_form(found, index),
            how="change by other windows or levelling, rectangular",
        )
        name = f"{label} {index + 1}" if count > 1 else label
        each.append(average_profiles(name, heights, instrument, [form]))
    signs = np.sign([one.seen[0].feature.height.value for one in found])
    if not single and sign and np.median(signs) != sign:
        asked, got = ("groove", "ridge") if sign < 0.0 else ("ridge", "groove")
        raise UnlikeError(f"scan must show a {asked}, got a {got}: it is upside down, or beside it")
    values = list_features(key, each, partial(_average_features, label, each, instrument), notes)
    if not single and count == 1:
        hidden, flanks = np.mean(
            [(each.feature.unseen, each.feature.flanks) for one in found for each in one.seen],
            axis=0,
        )
        name = f"{key.split('_')[0]}_width" if sign else "feature_width"
        width = _measure_width(label, spans, first.spacing, instrument, hidden)
        inwards, wall = _place_walls(flanks, each[0].value, options)
        values[name] = replace(
            width,
            value=width.value - float(np.median(signs)) * inwards,
            components=(*width.components, wall),
        )
    if outliers := sum(one.rejected for one in found):
        notes.append(f"{outliers} of {sum(one.points for one in found)} points left out as spikes")
    convention = (
        f"{way} beside the flanks, profile by profile"
        if way.startswith("masked")
        else f"ISO 5436-1 {way}, profile by profile, unfiltered"
    )
    windows = sum((one.windows for one in best.seen), ()) or tuple(
        (begin, min(end, float(first.position[-1])), "") for begin, end in best.spans
    )
    line = np.polynomial.Polynomial.fit(first.position[[0, -1]], best.fitted[[0, -1]], 1)(
        first.position
    )
    return Evaluation(
        values,
        convention,
        tuple(notes),
        Shown(first.position, first.height - line, windows, best.fitted - line),
    )


def _keep_nearest_features(row: _Row, places: Array) -> _Row:
    # Keep the features nearest to the usual places [m], where a profile crosses others, too.
    if len(row.seen) <= len(places):
        return row
    begins = np.array([begin for begin, _ in row.spans])
    chosen = sorted({int(np.argmin(abs(begins - one))) for one in places})
    return replace(row, seen=tuple(row.seen[at] for at in chosen))


def _estimate_form(found: list[_Row], index: int) -> float:
    # Largest mean change of a height by another evaluation, less what noise alone changes, as a
    # rectangle [m].
    changes = [one.seen[index].changes for one in found]
    noise = float(np.mean([one.seen[index].feature.height.std ** 2 for one in found])) / len(found)
    means = [float(np.mean([one[k] for one in changes])) for k in range(min(map(len, changes)))]
    return float(np.sqrt(max(max((one**2 for one in means), default=0.0) - 2.0 * noise, 0.0) / 3.0))


def _average_features(label: str, each: list[Measured], instrument: Instrument) -> Measured:
    # Mean over features: their scatter holds the noise of each; what the instrument owes is shared
    # by all.
    heights = np.array([one.value for one in each])
    scatter = float(heights.std(ddof=1) / np.sqrt(len(each)))
    forms = [part.std for one in each for part in one.components if part.name == "form"]
    parts = [
        Component("scatter", scatter, len(each) - 1.0, f"over {len(each)} features"),
        Component("form", float(np.mean(forms)), how="mean of theirs"),
    ]
    return add_instrument_components(f"{label}, mean", float(heights.mean()), parts, instrument)


def _measure_width(
    label: str, spans: Array, spacing: float, instrument: Instrument, hidden: float
) -> Measured:
    # Average the width of one feature over the profiles.
    widths = (spans[..., 1] - spans[..., 0]).ravel()
    scatter = float(widths.std(ddof=1) / np.sqrt(len(widths))) if len(widths) > 1 else 0.0
    parts = [
        Component(
            "sampling",
            float(np.hypot(spacing / np.sqrt(6.0), scatter)),
            how="one interval at either edge, rectangular",
        )
    ]
    if hidden > 0.0:
        parts.append(
            Component(
                "missing",
                hidden / np.sqrt(3.0),
                how="half of what was not measured there, rectangular",
            )
        )
    return add_instrument_components(
        f"width W of the {label.split()[0]}, at half its height",
        float(widths.mean()),
        parts,
        instrument,
        axes=(0.0, 1.0),
    )


def _place_walls(
    flanks: float, depth: float, options: EvaluationOptions
) -> tuple[float, Component]:
    # Return by how much less wide a stylus shows a groove, and what that leaves open [m]: it shows
    # an upright wall as a flank as wide as its cone. `flanks` is half of both flanks' widths [m].
    cone, tip = options.stylus_cone, options.stylus_radius or 0.0
    if cone is None:  # an optical instrument shows the wall at half its height
        return 0.0, Component("flanks", flanks / np.sqrt(3.0), how="half of their width")
    # a flank wider than the cone shows it is that of the surface
    shown = flanks if flanks < depth * np.tan(0.5 * cone) + 2.0 * tip else 0.0
    half = 0.5 * shown + _CONTACT * tip
    origin = "W with the walls in the middle of what the stylus shows of them, rectangular"
    # an upright wall, the usual one, lies at the very end of the rectangle, which 95 % of it leave
    # out: the interval is that of a normal law
    return half, Component("flanks", half / np.sqrt(3.0), how=origin)
