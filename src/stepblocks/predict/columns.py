"""Predictions as the rows of ``predictions.csv``: one column for each figure, its unit in its name.

``low`` and ``high`` are the worst cases within the tolerances, ``95_low`` and ``95_high`` the ends
of the drawn 95 % interval, ``analytic_95`` the same by first-order sensitivities. Beyond a limit
there is no energy. Columns that begin with ``drag_`` hold what the drag in time gives, those with
``felt_`` the formula's figure or, where the two differ by more than `DIFFERS`, the drag's.
"""

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence

from stepblocks.contact.energy import Release, Status
from stepblocks.contact.kernels import compute_locking_height
from stepblocks.files.tables import format_csv
from stepblocks.predict.predictions import Prediction

Cell = float | str  # a figure in the unit of its column, NaN where there is none; or a word

_FIGURE = re.compile(r"-?\d+(\.\d+)?(e[+-]?\d+)?")


def make_prediction_row(prediction: Prediction) -> dict[str, Cell]:
    """Put a prediction into the columns of ``predictions.csv``; NaN where there is no figure."""
    return {
        **_make_condition_columns(prediction),
        **_make_release_columns(prediction),
        **_make_interval_columns(prediction),
        **_make_ring_columns(prediction),
        **_make_drag_columns(prediction),
        **_make_felt_columns(prediction),
    }


def _make_condition_columns(prediction: Prediction) -> dict[str, Cell]:
    """Say what is dragged over, and under what."""
    point = prediction.point
    return {
        "set": prediction.set_name,
        "stimulus": prediction.stimulus,
        "drag": prediction.drag_direction,
        "tip_radius_um": point.ball_radius * 1e6,
        "height_um": prediction.face.far_side * 1e6,
        "normal_load_n": point.normal_load,
        "friction": point.friction,
    }


def _make_release_columns(prediction: Prediction) -> dict[str, Cell]:
    """Put down the formula at the nominal dimensions and at the limits of the tolerances."""
    release = prediction.release
    low, high = prediction.limits
    point = prediction.point
    is_beyond_limit = release.status.is_beyond_limit
    locking_height = math.nan
    if release.status is not Status.NO_CATCH:
        locking_height = float(compute_locking_height(point.ball_radius, point.friction))

    def get_energy_uj(at_limit: Release) -> float:
        """Return the vibration energy at a limit [uJ]; NaN where the nominal is beyond a limit."""
        if is_beyond_limit:
            return math.nan
        return at_limit.vibration_energy * 1e6

    return {
        "critical_angle_deg": math.degrees(release.angle),
        "status": release.status.value,
        "status_at_limits": "/".join(dict.fromkeys((low.status.value, high.status.value))),
        "peak_force_n": release.pull_force,
        "peak_force_low_n": low.pull_force,
        "peak_force_high_n": high.pull_force,
        "vibration_energy_uj": release.vibration_energy * 1e6,
        "vibration_energy_low_uj": get_energy_uj(low),
        "vibration_energy_high_uj": get_energy_uj(high),
        "conversion": point.tool.conversion,
        "mean_power_uw": release.mean_power * 1e6,
        "threshold_ratio": release.threshold_ratio,
        "locking_height_um": locking_height * 1e6,
    }


def _make_interval_columns(prediction: Prediction) -> dict[str, Cell]:
    """Put down the 95 % intervals; beyond a limit there is none of an energy."""
    interval = prediction.interval
    is_beyond_limit = prediction.release.status.is_beyond_limit

    def get_force_bound(end: str) -> float:
        """Return an end of the interval of the force [N]; NaN without an interval."""
        if interval is None:
            return math.nan
        return float(getattr(interval, end))

    def get_energy_bound_uj(end: str) -> float:
        """Return an end of the interval of the energy [uJ]; NaN without one or beyond a limit."""
        if interval is None or is_beyond_limit:
            return math.nan
        return float(getattr(interval, end)) * 1e6

    agreement = ""
    if interval is not None and not is_beyond_limit:
        agreement = "no"
        if interval.agrees:
            agreement = "yes"
    return {
        "peak_force_95_low_n": get_force_bound("force_low"),
        "peak_force_95_high_n": get_force_bound("force_high"),
        "vibration_energy_95_low_uj": get_energy_bound_uj("energy_low"),
        "vibration_energy_95_high_uj": get_energy_bound_uj("energy_high"),
        "vibration_energy_analytic_95_low_uj": get_energy_bound_uj("analytic_energy_low"),
        "vibration_energy_analytic_95_high_uj": get_energy_bound_uj("analytic_energy_high"),
        "held_probability": math.nan if interval is None else interval.held_probability,
        "intervals_agree": agreement,
    }


def _make_ring_columns(prediction: Prediction) -> dict[str, Cell]:
    """Put down the limit that is passed, where one is, and the frequency of the ring."""
    tool = prediction.point.tool
    limit = math.nan
    if prediction.release.status.is_beyond_limit:
        _, limit = tool.limits.first
    return {
        "limit_n": limit,
        "frequency_hz": tool.frequency,
        "frequency_low_hz": tool.frequency - tool.frequency_deviation,
        "frequency_high_hz": tool.frequency + tool.frequency_deviation,
    }


def _make_drag_columns(prediction: Prediction) -> dict[str, Cell]:
    """Put down what the drag in time gives; no figures where nothing was dragged."""
    dragged = prediction.in_time
    if dragged is None:
        return {
            "drag_status": "",
            "drag_peak_force_n": math.nan,
            "drag_vibration_energy_uj": math.nan,
            "drag_conversion": math.nan,
            "drag_over_formula": prediction.energy_over_formula,
        }
    return {
        "drag_status": dragged.status,
        "drag_peak_force_n": dragged.peak_force,
        "drag_vibration_energy_uj": dragged.energy * 1e6,
        "drag_conversion": dragged.share,
        "drag_over_formula": prediction.energy_over_formula,
    }


def _make_felt_columns(prediction: Prediction) -> dict[str, Cell]:
    """Say what is felt, and by which model."""
    power = prediction.felt_energy / prediction.point.tool.ring_duration
    felt_by = ""
    if not math.isnan(power):
        felt_by = prediction.felt_model.value
    return {
        "felt_by": felt_by,
        "felt_energy_uj": prediction.felt_energy * 1e6,
        "felt_power_uw": power * 1e6,
    }


def format_predictions_csv(
    predictions: Iterable[Prediction],
    make_more_columns: Callable[[Prediction], dict[str, str]] | None = None,
) -> str:
    """Write predictions as ``predictions.csv``, with further columns behind."""
    rows = []
    for prediction in predictions:
        row = format_row_cells(make_prediction_row(prediction))
        if make_more_columns is not None:
            row |= make_more_columns(prediction)
        rows.append(row)
    return format_csv(rows)


def format_row_cells(row: Mapping[str, Cell]) -> dict[str, str]:
    """Format the figures of a table's row; words stay as they are."""
    return {name: _format_cell(cell) for name, cell in row.items()}


def _format_cell(cell: Cell) -> str:
    """Format a figure with six digits; a word stays as it is."""
    if isinstance(cell, str):
        return cell
    return format_six_digits(cell)


def format_six_digits(figure: float) -> str:
    """Format a figure for a table; nothing where there is none."""
    if math.isnan(figure):
        return ""
    return f"{figure:.6g}"


def agree_to_sixth_digit(cell: str, reference: str) -> bool:
    """Whether two cells of a table agree, figures to one in the sixth digit."""
    if cell == reference:
        return True
    if not _FIGURE.fullmatch(cell) or not _FIGURE.fullmatch(reference):
        return False
    first, second = float(cell), float(reference)
    leading_digit = math.floor(math.log10(max(abs(first), abs(second))))
    sixth_digit = 10.0 ** (leading_digit - 5)
    return abs(first - second) < 1.5 * sixth_digit


# columns that a terminal has no room for, by name or by how their names end
_HIDDEN_COLUMNS = (
    "set",
    "critical_angle_deg",
    "status_at_limits",
    "conversion",
    "mean_power_uw",
    "threshold_ratio",
    "locking_height_um",
    "held_probability",
    "intervals_agree",
    "drag_status",
    "drag_over_formula",
    "felt_power_uw",
    "_low_n",
    "_high_n",
    "_low_uj",
    "_high_uj",
    "_hz",
    "drag_peak_force_n",
    "jnd_to_next_95_low",
    "jnd_to_next_95_high",
)


def choose_terminal_columns(columns: Sequence[str]) -> tuple[str, ...]:
    """Choose the columns that fit a terminal: status, force and energy by formula and drag."""
    shown = []
    for name in columns:
        if "energy_95" in name or not name.endswith(_HIDDEN_COLUMNS):
            shown.append(name)
    return tuple(shown)
