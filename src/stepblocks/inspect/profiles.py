"""The profiles of a scan: which are evaluated, which agree, and what they say together."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from typing import Literal, TypeVar

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.inspect.attempts import Attempts, Evaluated
from stepblocks.inspect.budget import Measured
from stepblocks.inspect.evaluation import AS_FOUND, EvaluationOptions
from stepblocks.inspect.noise import LEAST_SCATTER, Array, Mask, estimate_robust_scale
from stepblocks.inspect.notes import Note, NoteKind
from stepblocks.scans.scan import HeightMap, ScannedProfile, split_into_profiles

Result = TypeVar("Result")

LEAST_SHARE = 0.5  # of the profiles of a map that must agree on what they cross [1]
_LEAST_POINTS = 3  # of a part of a profile
_MOST_PROFILES = 60  # of a map that are evaluated; of more, as many are taken evenly over the map
_UNEVEN = 0.01  # spread of the steps of a profile over their mean, from which it is resampled [1]
_LONGEST_GAP = 3.0  # steps over which heights are interpolated
_UNLIKE = 1.25  # ratio of the largest to the smallest feature from which no mean is taken [1]
_MOST_OFF_HEIGHT = 0.5  # of the usual height of a feature, by which that of a profile may differ
_MOST_OFF_PLACE = 8.0  # robust standard deviations by which a feature may be out of place


@dataclass(frozen=True)
class SampledProfiles:
    """The profiles of a scan that are evaluated, and what was left out or resampled."""

    rows: list[ScannedProfile]
    notes: list[Note]


def sample_profiles(
    scan: ScannedProfile | HeightMap, options: EvaluationOptions = AS_FOUND
) -> SampledProfiles:
    """Return the profiles of a scan that are evaluated, cropped and in equal steps.

    Raises
    ------
    MetrologyError
        If the part that is asked for holds fewer than three points.
    """
    notes = []
    rows = split_into_profiles(scan)
    if len(rows) > _MOST_PROFILES:
        chosen = np.unique(np.linspace(0, len(rows) - 1, _MOST_PROFILES).round().astype(int))
        notes.append(NoteKind.PROFILES_SAMPLED.make_note(evaluated=len(chosen), total=len(rows)))
        rows = [rows[index] for index in chosen]
    rows = _crop_profiles(rows, options)
    steps = np.diff(rows[0].position)
    if np.ptp(steps) > _UNEVEN * steps.mean():
        step = float(np.median(steps))
        rows = _resample_profiles(rows, step)
        notes.append(NoteKind.RESAMPLED.make_note(step=step * 1e6))
    return SampledProfiles(rows, notes)


def _crop_profiles(rows: list[ScannedProfile], options: EvaluationOptions) -> list[ScannedProfile]:
    """Crop profiles to the range of the options; those without a measured point are left out."""
    x = rows[0].position
    begin = x[0] if options.begin is None else options.begin
    end = x[-1] if options.end is None else options.end
    inside = (x >= begin) & (x <= end)
    cropped = []
    for row in rows:
        height = row.height[inside]
        if np.isfinite(height).any():
            cropped.append(replace(row, position=x[inside], height=height))
    if inside.sum() < _LEAST_POINTS or not cropped:
        raise MetrologyError(
            f"part from {begin * 1e6:g} to {end * 1e6:g} um must hold {_LEAST_POINTS} points, got "
            f"{inside.sum()}"
        )
    return cropped


def _resample_profiles(rows: list[ScannedProfile], step: float) -> list[ScannedProfile]:
    """Return profiles that share their positions in equal steps [m].

    Heights are interpolated, but across a gap of several steps nothing is known.
    """
    x = rows[0].position
    even = np.arange(x[0], x[-1], step)
    following = x[np.searchsorted(x, even).clip(0, len(x) - 1)]
    is_gap = np.abs(even - following) > _LONGEST_GAP * step
    resampled = []
    for row in rows:
        height = np.where(is_gap, np.nan, np.interp(even, x, row.height))
        resampled.append(replace(row, position=even, height=height))
    return resampled


@dataclass(frozen=True)
class Crossings:
    """What some profiles cross; arrays of shape (profiles, features) [m]."""

    heights: Array
    places: Array
    slack: Array  # by how much a place may always differ from the usual one

    @property
    def is_like_others(self) -> Mask:
        """Which profiles cross the features as the others do, shape (profiles,).

        Features must lie where the others have them, a slant over the map allowed, and be as high.
        """
        count = len(self.places)
        lag = count // 2
        usual_height = np.median(self.heights, axis=0)
        slant = np.median((self.places[lag:] - self.places[:-lag]) / lag, axis=0)
        off = self.places - slant * np.arange(count)[:, np.newaxis]
        off -= np.median(off, axis=0)
        scatter = np.array(list(map(estimate_robust_scale, off.T)))
        allowed = np.maximum(self.slack, _MOST_OFF_PLACE * scatter + LEAST_SCATTER)
        in_place = np.all(np.abs(off) <= allowed, axis=1)
        height_allowed = _MOST_OFF_HEIGHT * np.abs(usual_height)
        as_high = np.all(np.abs(self.heights - usual_height) <= height_allowed, axis=1)
        return np.asarray(in_place & as_high)


def keep_profiles_that_agree(
    attempts: Attempts[ScannedProfile, Result],
    crossings: Crossings,
    rows: list[ScannedProfile],
    notes: list[Note],
) -> list[Evaluated[ScannedProfile, Result]]:
    """Return the profiles that agree on what they cross.

    Parameters
    ----------
    attempts : Attempts
        Profiles that were evaluated, and why the others were refused.
    crossings : Crossings
        What the evaluated profiles cross, in the same order.
    rows : list of ScannedProfile
        All profiles that were asked for.
    notes : list of Note
        Takes what is said of profiles that are left out.

    Raises
    ------
    MetrologyError
        With the share, if fewer than half of the profiles agree.
    """
    kept = _select_agreeing_profiles(attempts.evaluated, crossings)
    reason = "since it crosses others"
    if attempts.refusals:
        reason = f"since {attempts.refusals[0]}"
    if not kept or len(kept) < LEAST_SHARE * len(rows):
        if len(rows) == 1:
            raise MetrologyError(attempts.refusals[0])
        disagreeing = len(attempts.evaluated) - len(kept) + len(attempts.refusals)
        raise MetrologyError(
            "profiles must agree on the features that they cross, got "
            f"{disagreeing} of {len(rows)} that do not "
            f"({1.0 - LEAST_SHARE:.0%} allowed), the first {reason}"
        )
    notes += _make_left_out_notes(kept, rows, reason)
    return kept


def _select_agreeing_profiles(
    evaluated: list[Evaluated[ScannedProfile, Result]], crossings: Crossings
) -> list[Evaluated[ScannedProfile, Result]]:
    """Return the profiles that cross the same; of two all, since neither is the usual one."""
    if len(evaluated) <= 2:
        return evaluated
    return list(compress(evaluated, crossings.is_like_others))


def _make_left_out_notes(
    kept: list[Evaluated[ScannedProfile, Result]], rows: list[ScannedProfile], reason: str
) -> list[Note]:
    """Note how many profiles were refused between those that were kept, and beyond them."""
    kept_rows = {id(success.item) for success in kept}
    numbers = [number for number, row in enumerate(rows) if id(row) in kept_rows]
    between = numbers[-1] - numbers[0] + 1
    refused = between - len(kept)
    beyond = len(rows) - between  # a feature may end within a map
    notes = []
    if refused > 0:
        notes.append(
            NoteKind.PROFILES_REFUSED.make_note(refused=refused, between=between, reason=reason)
        )
    if beyond > 0:
        notes.append(
            NoteKind.PROFILES_BEYOND.make_note(beyond=beyond, total=len(rows), reason=reason)
        )
    return notes


def list_scan_directions(
    scan: ScannedProfile | HeightMap, along: Literal["x", "y"] | None
) -> list[ScannedProfile | HeightMap]:
    """List a scan so that its profiles run along x, along y, or both where neither is stated."""
    if isinstance(scan, ScannedProfile):
        return [scan]
    directions: list[ScannedProfile | HeightMap] = []
    if along != "y":
        directions.append(scan)
    if along != "x":
        turned = np.ascontiguousarray(scan.height.T)
        directions.append(replace(scan, height=turned, dx=scan.dy, dy=scan.dx))
    return directions


def collect_numbered_features(
    key: str, features: Sequence[Measured], average: Callable[[], Measured], notes: list[Note]
) -> dict[str, Measured]:
    """Return features under numbered keys, with their mean where alike; a single one under `key`.

    `notes` takes what is said of unlike features.
    """
    if len(features) == 1:
        return {key: features[0]}
    numbered = {f"{key}_{number}": feature for number, feature in enumerate(features, 1)}
    sizes = [feature.value for feature in features]
    if max(sizes) <= _UNLIKE * min(sizes):
        return {key: average()} | numbered
    listed = ", ".join(f"{size * 1e6:.4g}" for size in sizes)
    notes.append(NoteKind.UNLIKE_FEATURES.make_note(count=len(features), sizes=listed))
    return numbered
