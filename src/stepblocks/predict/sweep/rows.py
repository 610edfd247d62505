"""The rows of a sweep: many at once, each a function of the plan and its number alone."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import NDArray

from stepblocks.contact import Array, kernels
from stepblocks.contact.counterface import Counterface, Margin, ProfiledMargin, Step
from stepblocks.contact.energy import Release, Status, find_release
from stepblocks.contact.laws import build_declared_laws
from stepblocks.contact.operating_point import Limits, OperatingPoint, Tissue, Tool
from stepblocks.errors import ContactError
from stepblocks.predict.predictions import drag_and_measure_ring
from stepblocks.predict.sweep.plan import DIRECTIONS, PARAMETERS, SURFACES, SweepPlan

Column = Array | NDArray[np.int64] | NDArray[np.str_] | NDArray[np.object_]
Inputs = Mapping[str, Array]  # by name, one value for each row [SI]

# streams of random numbers, so that the design does not hang on the draws
_DESIGN = 0
_TOLERANCES = 1


class _ColumnUnit(NamedTuple):
    """The unit of a column: the end of its name, and how many of it are one in SI."""

    suffix: str
    per_si: float


_UNITS = {
    "length": _ColumnUnit("_um", 1e6),
    "force": _ColumnUnit("_n", 1.0),
    "stiffness": _ColumnUnit("_n_m", 1.0),
    "speed": _ColumnUnit("_mm_s", 1e3),
    "frequency": _ColumnUnit("_hz", 1.0),
    "ratio": _ColumnUnit("", 1.0),
}
_DECIMALS = 12  # of a column in other units than SI: 50 um is 50, not 50.000000000000007
# columns of a drag in time, after ``drag_``
_DRAG_FIGURES = ("peak_force_n", "vibration_energy_uj", "conversion", "ring_s", "ledger_error")
_STATUS_TYPE = "U16"  # as long as the longest status
_SIGNED = ("horizontal_discrepancy", "vertical_discrepancy")


def compute_sweep_table(plan: SweepPlan, row_numbers: range) -> pa.Table:
    """Compute rows; one outside the equations has its reason in ``problem``, and no figures."""
    inputs = sample_row_inputs(plan, row_numbers)
    laws = build_declared_laws(plan.laws)
    if "friction" in laws:
        law = laws["friction"]
        loads = inputs["normal_load"].tolist()
        coefficients = [law.coefficient(0.0, load, 0.0, 0.0) for load in loads]
        inputs["friction"] = np.array(coefficients)
    is_backward = inputs.get("direction", np.zeros(len(row_numbers))) > 0.0
    columns = _make_input_columns(plan, row_numbers, inputs, is_backward)
    columns |= _predict_result_columns(plan, inputs, is_backward, laws)
    if plan.mode == "drag":
        columns |= _drag_rows_and_record_problems(plan, inputs, is_backward, columns, laws)
    arrays = {}
    for name, column in columns.items():
        is_text = column.dtype.kind in "UO"
        if is_text:
            arrays[name] = _encode_text_column(column)
        else:
            arrays[name] = pa.array(column)
    return pa.table(arrays)


def _make_input_columns(
    plan: SweepPlan, row_numbers: range, inputs: Inputs, is_backward: NDArray[np.bool_]
) -> dict[str, Column]:
    """List the columns that say which row it is and what was required of it."""
    numbers = np.arange(row_numbers.start, row_numbers.stop)
    columns: dict[str, Column] = {"row": numbers, "draw": numbers % plan.draws}
    if plan.stimuli:
        identities = np.array([stimulus.id for stimulus in plan.stimuli])
        columns["stimulus"] = identities[inputs["stimulus"].astype(int)]
    nothing = np.full(len(row_numbers), math.nan)
    for name, (dimension, _) in PARAMETERS[plan.surface].items():
        if dimension in _UNITS:
            unit = _UNITS[dimension]
            columns[name + unit.suffix] = _convert_to_column_unit(inputs.get(name, nothing), unit)
    if plan.surface == "margin":
        columns["drag"] = np.array(DIRECTIONS)[is_backward.astype(int)]
    return columns


def _convert_to_column_unit(values: Array, unit: _ColumnUnit) -> Array:
    """Convert an input [SI] into the unit of its column, its decimals as they were written."""
    if unit.per_si == 1.0:
        return values
    return np.round(values * unit.per_si, _DECIMALS)


def _encode_text_column(column: Column) -> pa.Array:
    """Hand over texts by their codes: most of a column are alike."""
    codes, names = pd.factorize(column.astype(object))
    return pa.DictionaryArray.from_arrays(codes, list(names)).cast(pa.string())


def sample_row_inputs(plan: SweepPlan, row_numbers: range) -> dict[str, Array]:
    """Draw the inputs [SI] of neighbouring rows, by name; NaN where a part lacks the size."""
    points = np.arange(row_numbers.start, row_numbers.stop) // plan.draws
    uniform = _sample_design_numbers(plan, points)
    inputs, places_left = _compute_point_parameters(plan, points, uniform)
    spreads: dict[str, Array] = {}
    if plan.stimuli:
        which = places_left
        if plan.kind == "random":
            which = (uniform[:, -1] * len(plan.stimuli)).astype(int)
        inputs["stimulus"] = which.astype(np.float64)
        of_values, of_spreads = [], []
        for stimulus in plan.stimuli:
            of_values.append(stimulus.values)
            of_spreads.append(stimulus.spreads)
        inputs |= _make_stimulus_columns(of_values, which, math.nan)
        spreads = _make_stimulus_columns(of_spreads, which, 0.0)
    for name, spread in plan.spreads.items():
        spreads[name] = np.full(len(row_numbers), spread)
    for name, share in plan.shares.items():
        spreads[name] = share * inputs[name]
    if spreads:
        _add_tolerance_deviations(plan, row_numbers, spreads, inputs)
    return inputs


def _sample_design_numbers(plan: SweepPlan, points: NDArray[np.int64]) -> Array:
    """Draw uniform numbers, shape (rows, parameters + 1), equal for draws of one point."""
    columns = len(PARAMETERS[plan.surface]) + 1
    first, last = int(points[0]), int(points[-1])
    drawn = _sample_uniform_by_row(plan.seed, _DESIGN, range(first, last + 1), columns)
    if plan.draws == 1:
        return drawn
    return drawn[points - first]


def _compute_point_parameters(
    plan: SweepPlan, points: NDArray[np.int64], uniform: Array
) -> tuple[dict[str, Array], NDArray[np.int64]]:
    """Return parameters of each point, and its place along the axes that are left for stimuli."""
    inputs: dict[str, Array] = {}
    places_left = points
    for column, name in enumerate(PARAMETERS[plan.surface]):
        if name in plan.ranges:
            low, high = plan.ranges[name]
            inputs[name] = low + (high - low) * uniform[:, column]
        elif name in plan.values:
            choices = np.array(plan.values[name])
            places_left, chosen = np.divmod(places_left, len(choices))
            if plan.kind == "random":
                chosen = (uniform[:, column] * len(choices)).astype(np.int64)
            inputs[name] = choices[chosen]
    return inputs, places_left


def _add_tolerance_deviations(
    plan: SweepPlan, row_numbers: range, spreads: Inputs, inputs: dict[str, Array]
) -> None:
    """Add to the inputs what normal distributions of these standard deviations give."""
    from scipy.special import ndtri

    names = list(PARAMETERS[plan.surface])
    uniform = _sample_uniform_by_row(plan.seed, _TOLERANCES, row_numbers, len(names))
    for name, spread in spreads.items():
        if name not in inputs:
            continue
        drawn = inputs[name] + spread * ndtri(uniform[:, names.index(name)])
        if name not in _SIGNED:
            drawn = np.maximum(drawn, 0.0)
        inputs[name] = drawn


def _sample_uniform_by_row(seed: int, stream: int, row_numbers: range, column_count: int) -> Array:
    """Draw numbers between 0 and 1, shape (rows, columns), each by the number of its row."""
    blocks = -(-column_count // 4)  # the generator counts in blocks of four
    generator = np.random.Philox(key=np.array([seed, stream], dtype=np.uint64))
    generator.advance(row_numbers.start * blocks)
    raw = generator.random_raw(4 * blocks * len(row_numbers)).reshape(len(row_numbers), -1)[
        :, :column_count
    ]
    # 53 bits of each, in the middle of their cell: neither 0 nor 1 is drawn
    return ((raw >> np.uint64(11)).astype(np.float64) + 0.5) * 2.0**-53


def _make_stimulus_columns(
    records: Sequence[Mapping[str, float]], stimulus_indices: NDArray[np.int64], missing: float
) -> dict[str, Array]:
    """Make a column of each figure of the stimuli for rows that name a stimulus by its index."""
    names: dict[str, None] = {}
    for record in records:
        names |= dict.fromkeys(record)
    columns = {}
    for name in names:
        figures = np.array([record.get(name, missing) for record in records])
        columns[name] = figures[stimulus_indices]
    return columns


def _predict_result_columns(
    plan: SweepPlan, inputs: Inputs, is_backward: NDArray[np.bool_], laws: Mapping[str, Any]
) -> dict[str, Column]:
    """Predict all rows inside the equations at once, and the others one by one."""
    count = len(is_backward)
    status = np.full(count, "invalid", dtype=_STATUS_TYPE)
    problem = np.full(count, "", dtype=object)
    angle, force = np.full(count, math.nan), np.full(count, math.nan)
    is_inside = _mark_rows_in_domain(plan.surface, inputs)
    if plan.stimuli:
        # sides of a scan are not level: their angle is found by dilation, one by one
        is_scanned = np.array(["crown_slope" in stimulus.face for stimulus in plan.stimuli])
        is_inside &= ~is_scanned[inputs["stimulus"].astype(int)]
    try:
        release = _compute_releases_in_domain(plan, inputs, is_backward, is_inside)
        status[is_inside] = release.status
        angle[is_inside] = release.angle
        force[is_inside] = release.pull_force
    except ContactError:  # a limit that is not among ours: say in each row which
        is_inside = np.zeros(count, dtype=bool)
    for row in np.flatnonzero(~is_inside):
        try:
            face, point = _make_face_and_point(plan, inputs, int(row), laws)
            found = face.release(point, bool(is_backward[row]))
        except ContactError as error:
            problem[row] = str(error)
            continue
        status[row] = str(found.status)
        angle[row] = found.angle
        force[row] = found.pull_force
    with np.errstate(divide="ignore", invalid="ignore"):
        stored = kernels.compute_stored_energy(force, inputs["stiffness"])
    energy = np.where(status == Status.RELEASES, inputs["conversion"] * stored, math.nan)
    return {
        "status": status,
        "critical_angle_deg": np.degrees(angle),
        "peak_force_n": force,
        "vibration_energy_uj": energy * 1e6,
        "problem": problem,
    }


def _mark_rows_in_domain(surface: str, inputs: Inputs) -> NDArray[np.bool_]:
    """Tell for each row whether all of its inputs lie where the equations hold."""
    is_inside = np.ones(len(inputs["friction"]), dtype=bool)
    for name in ("tip_radius", "normal_load", "stiffness", "conversion"):
        is_inside &= (inputs[name] > 0.0) & np.isfinite(inputs[name])
    is_inside &= (inputs["friction"] >= 0.0) & np.isfinite(inputs["friction"])
    for name in SURFACES[surface].values():
        size = np.nan_to_num(inputs.get(name, np.zeros(1)), nan=0.0, posinf=math.inf)
        is_inside &= np.isfinite(size)
        if name not in _SIGNED:
            is_inside &= size >= 0.0
    return is_inside


def _compute_releases_in_domain(
    plan: SweepPlan,
    inputs: Inputs,
    is_backward: NDArray[np.bool_],
    is_inside: NDArray[np.bool_],
) -> Release[NDArray[np.str_], Array]:
    """Compute releases of the rows inside the equations, by the closed forms of their surface."""
    sizes = {}
    for name, column in SURFACES[plan.surface].items():
        if column in inputs:
            sizes[name] = inputs[column][is_inside]
    ball = inputs["tip_radius"][is_inside]
    if plan.surface == "step":
        edge_radius = np.nan_to_num(sizes.get("edge_radius", np.zeros(len(ball))))
        forward, backward = Step(1e-5).angles(ball, height=sizes["height"], edge_radius=edge_radius)
    else:
        # the end of a crown is square where no vertical discrepancy is given
        opening = sizes.get("opening", sizes["gap"])
        sizes["opening"] = np.where(np.isnan(opening), sizes["gap"], opening)
        forward, backward = Margin(1e-5, 1e-5, 0.0).angles(ball, **sizes)
    angle = np.where(
        is_backward[is_inside], np.asarray(backward, float), np.asarray(forward, float)
    )
    load, friction = inputs["normal_load"][is_inside], inputs["friction"][is_inside]
    return find_release(angle, load, friction, Tool(limits=Limits(**plan.limits)))


def _make_face_and_point(
    plan: SweepPlan, inputs: Inputs, row: int, laws: Mapping[str, Any]
) -> tuple[Counterface, OperatingPoint]:
    """Make counterface and operating point of one row."""
    values = {name: float(column[row]) for name, column in inputs.items()}
    tool = Tool(
        values["stiffness"],
        values["conversion"],
        frequency=values["frequency"],
        limits=Limits(**plan.limits),
        overtones=laws.get("tool", ()),
    )
    stimulus = None
    tissue = Tissue()
    if plan.stimuli:
        stimulus = plan.stimuli[int(values["stimulus"])]
        stiffness, damping, friction = stimulus.tissue
        tissue = Tissue(stiffness, damping / tool.frequency, friction)
    point = OperatingPoint(
        values["tip_radius"],
        values["normal_load"],
        laws.get("friction", values["friction"]),
        tool,
        tissue=tissue,
        contact=laws.get("contact"),
    )
    sizes = {}
    for name, column in SURFACES[plan.surface].items():
        if column in values and not math.isnan(values[column]):
            sizes[name] = values[column]
    if stimulus is not None:
        sizes |= stimulus.face
    return _make_counterface(plan.surface, sizes), point


def _make_counterface(surface: str, sizes: Mapping[str, float]) -> Counterface:
    """Make a step or a margin; the end of a crown is square where no opening is given."""
    if surface == "step":
        return Step(**sizes)
    margin = {"opening": sizes["gap"], **sizes}
    if "crown_slope" in sizes:
        return ProfiledMargin(**margin)
    return Margin(**margin)


def _drag_rows_and_record_problems(
    plan: SweepPlan,
    inputs: Inputs,
    is_backward: NDArray[np.bool_],
    columns: Mapping[str, Column],
    laws: Mapping[str, Any],
) -> dict[str, Column]:
    """Drag every row in time that the equations let release or lock; return the columns of that.

    Why a row cannot be dragged is written into the column ``problem`` of `columns`.
    """
    status = columns["status"].astype(_STATUS_TYPE)
    figures = {}
    for name in _DRAG_FIGURES:
        figures[name] = np.full(len(status), math.nan)
    is_dragged = np.isin(status, [str(Status.RELEASES), str(Status.LOCKED)])
    for row in np.flatnonzero(is_dragged):
        face, point = _make_face_and_point(plan, inputs, int(row), laws)
        try:
            trace, ring = drag_and_measure_ring(
                face,
                point,
                bool(is_backward[row]),
                float(inputs["speed"][row]),
                damping_ratio=float(inputs["damping_ratio"][row]),
            )
        except ContactError as error:
            status[row] = "invalid"
            columns["problem"][row] = str(error)
            continue
        status[row] = str(trace.status)
        figures["ledger_error"][row] = trace.ledger_error
        if ring is not None:
            figures["peak_force_n"][row] = trace.peak_force
            figures["vibration_energy_uj"][row] = ring.energy * 1e6
            figures["conversion"][row] = ring.share
            figures["ring_s"][row] = ring.duration
    dragged: dict[str, Column] = {"drag_status": status}
    for name, column in figures.items():
        dragged[f"drag_{name}"] = column
    return dragged
