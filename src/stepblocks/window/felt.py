"""What the declare page shows beside a form: what is felt, and the working edge as it is."""

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from stepblocks.declaration.set import StimulusSet
from stepblocks.errors import StepblocksError
from stepblocks.mistakes import Mistake
from stepblocks.parts.kind import Part
from stepblocks.quantities import format_number
from stepblocks.window import texts
from stepblocks.window.draft import Checked, check_stimulus_text

if TYPE_CHECKING:
    from stepblocks.predict.kept import KeptPredictions
    from stepblocks.records.model import LearnedModel

_RUN = 4.0  # of a drawn profile on either side, in times its height [1]
_LEAST_RUN = 20e-6  # [m]
_WIDTH, _MOST_HEIGHT = 560.0, 240.0  # of the picture [pixels]
_MARGIN = 24.0  # [pixels]
_COLUMNS = (
    ("critical_angle_deg", ""),
    ("peak_force_n", "peak_force_95"),
    ("vibration_energy_uj", "vibration_energy_95"),
    ("jnd_to_next", "jnd_to_next_95"),
)
_DRAGGED = "drag_vibration_energy_uj"
_LEARNED = "learned_vibration_energy_uj", "learned_vibration_energy_95"


@dataclass(frozen=True)
class Felt:
    """What is felt of one part in the first condition of its set, as texts.

    Attributes
    ----------
    part : str
    way : str
        Direction of the drag.
    angle, force, energy, distance : str
        Critical angle [deg], force of the pull [N], energy of the vibration [uJ] and just
        noticeable differences to the next; the last three with 95 % intervals.
    dragged : str
        Energy by the drag in time [uJ]; empty where nothing was dragged.
    learned : str
        Energy by the model of a session [uJ] with its interval; empty without a model.
    """

    part: str
    way: str
    angle: str
    force: str
    energy: str
    distance: str
    dragged: str = ""
    learned: str = ""


@dataclass(frozen=True)
class CheckedAndFelt:
    """What a draft declares, and what is felt of it by the formula.

    Attributes
    ----------
    checked : Checked
    felt : tuple of Felt
        Empty where nothing is felt, or something is wrong.
    reason : tuple of Mistake
        Why a sound declaration cannot be predicted; empty where it can.
    """

    checked: Checked
    felt: tuple[Felt, ...] = ()
    reason: tuple[Mistake, ...] = ()


def check_and_predict(
    text: str, path: Path, learned: "LearnedModel | None", kept: "KeptPredictions"
) -> CheckedAndFelt:
    """Validate the text of a stimulus file, and predict by the formula what is felt of it."""
    checked = check_stimulus_text(text, path)
    if checked.stimuli is None:
        return CheckedAndFelt(checked)
    try:
        felt = predict_felt(checked.stimuli, learned, kept=kept)
    except StepblocksError as error:
        return CheckedAndFelt(checked, reason=(("", str(error)),))
    return CheckedAndFelt(checked, tuple(felt))


def predict_felt(
    stimuli: StimulusSet,
    learned: "LearnedModel | None" = None,
    *,
    dragged: bool = False,
    kept: "KeptPredictions | None" = None,
    is_wanted: Callable[[], bool] = lambda: True,
) -> list[Felt]:
    """Predict every part that is felt in the first condition of a set.

    Parameters
    ----------
    stimuli : StimulusSet
    learned : LearnedModel, optional
        Its constants replace those of the set, and what it predicts stands beside, as in a build.
    dragged : bool
        Whether each part is dragged in time, too; by the formula alone takes milliseconds.
    kept : KeptPredictions, optional
        Predictions of what the set was before; what stays as it was is taken from them.
    is_wanted : callable
        Tells before each part whether the rest is wanted still; nothing is returned where not.
    """
    # loaded late: the first page needs no tables
    from stepblocks.contact.energy import Status
    from stepblocks.contact.operating_point import PAPER
    from stepblocks.predict.kept import KeptPredictions
    from stepblocks.predict.learned import apply_learned_constants, format_learned_columns

    felt = stimuli.keep_felt()
    if not felt.stimuli:
        return []
    if learned is not None:
        felt = apply_learned_constants(felt, learned)
    if kept is None:
        kept = KeptPredictions()
    predicted = kept.predict_reusing_kept(
        _keep_first_condition(felt), dragged, PAPER.speed, is_wanted
    )
    if predicted is None:
        return []
    rows = []
    for row, prediction in zip(predicted.rows, predicted.predictions, strict=True):
        angle, force, energy, distance = (_format_figure(row, *names) for names in _COLUMNS)
        if row["status"] != Status.RELEASES:
            energy = str(row["status"])  # says why there is none
        in_time = ""
        if dragged:
            in_time = _format_number(row[_DRAGGED])
        by_model = ""
        if learned is not None:
            columns = format_learned_columns(prediction, learned)
            by_model = _format_figure(_read_numeric_cells(columns), *_LEARNED)
        part, way = str(row["stimulus"]), str(row["drag"])
        rows.append(Felt(part, way, angle, force, energy, distance, in_time, by_model))
    return rows


def _keep_first_condition(stimuli: StimulusSet) -> StimulusSet:
    """Keep of all conditions of a set the first."""
    grid = stimuli.prediction
    first = grid.model_copy(
        update={
            "tip_radii": grid.tip_radii[:1],
            "normal_loads": grid.normal_loads[:1],
            "frictions": grid.frictions[:1],
            "step_heights": grid.step_heights[:1],
        }
    )
    return stimuli.model_copy(update={"prediction": first})


def _read_numeric_cells(columns: Mapping[str, str]) -> dict[str, float]:
    """Read the cells of a table that hold numbers."""
    numbers = {}
    for name, text in columns.items():
        with suppress(ValueError):
            numbers[name] = float(text)
    return numbers


def _format_figure(row: Mapping[str, object], name: str, interval_prefix: str) -> str:
    """Write a figure, with its interval where it has one."""
    value = _format_number(row.get(name))
    if not interval_prefix:
        return value
    unit = name.rpartition("_")[2]
    suffix = "" if name == "jnd_to_next" else f"_{unit}"
    low = _format_number(row.get(f"{interval_prefix}_low{suffix}"))
    high = _format_number(row.get(f"{interval_prefix}_high{suffix}"))
    if "-" in (low, high):
        return value
    return texts.INTERVAL.format(value=value, low=low, high=high)


def _format_number(value: object) -> str:
    """Write a number to three digits; a dash where there is none, or it has no bound."""
    if not isinstance(value, int | float) or not math.isfinite(value):
        return "-"
    return format_number(float(value))


def draw_profile_as_svg(part: Part) -> str:
    """Draw the working edge of a part to one scale across and up, as SVG; empty without one.

    The colour is that of the text around it.
    """
    if not part.crossed:
        return ""
    face = part.counterface()
    tallest = max(abs(float(z)) for z in face.section(_LEAST_RUN)[1])
    run = max(_RUN * tallest, _LEAST_RUN)
    x, z = face.section(run)
    points = list(zip(x.tolist(), z.tolist(), strict=True))
    return _draw_line_as_svg(points, texts.PROFILE_OF.format(part=part.id))


def _draw_line_as_svg(points: Sequence[tuple[float, float]], title: str) -> str:
    """Draw a line through points [m] to one scale, with a bar of a round length."""
    across, up = zip(*points, strict=True)
    left = min(across)
    top = max(up)
    wide = max(across) - left
    tall = top - min(up)
    scale = min((_WIDTH - 2.0 * _MARGIN) / wide, _MOST_HEIGHT / max(tall, 1e-12))
    height = tall * scale + 3.0 * _MARGIN
    places = []
    for x, z in points:
        places.append(f"{_MARGIN + (x - left) * scale:.2f},{_MARGIN + (top - z) * scale:.2f}")
    drawn = " ".join(places)
    length = _choose_scale_bar(0.3 * wide)
    label = f"{format_number(1e6 * length)} µm"
    base = height - 0.6 * _MARGIN
    bar = length * scale
    escaped_title = escape(title)
    head = (
        f'<svg viewBox="0 0 {_WIDTH:.0f} {height:.1f}" width="{_WIDTH:.0f}" role="img" '
        f'aria-label="{escaped_title}" stroke="currentColor" fill="none" '
        f'style="max-width: 100%"><title>{escaped_title}</title>'
    )
    lines = (
        f'<polyline points="{drawn}" stroke-width="2"/>'
        f'<path d="M{_MARGIN:.1f} {base:.1f}h{bar:.2f}" stroke-width="3"/>'
    )
    caption = (
        f'<text x="{_MARGIN + bar + 8.0:.2f}" y="{base + 4.0:.1f}" '
        f'fill="currentColor" stroke="none" font-size="13">{escape(label)}</text>'
    )
    return f"{head}{lines}{caption}</svg>"


def _choose_scale_bar(largest_length: float) -> float:
    """Return the longest of 1, 2 and 5 times a power of ten that is not above a length [m]."""
    decade = 1e-9
    bar = decade
    while decade <= largest_length:
        for factor in (1.0, 2.0, 5.0):
            if factor * decade <= largest_length:
                bar = factor * decade
        decade *= 10.0
    return bar
