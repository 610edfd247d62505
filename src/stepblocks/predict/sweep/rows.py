"""The rows of a sweep: many at once, each a function of the plan and its number alone."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import NDArray

from stepblocks.contact import Array, kernels
from stepblocks.contact.counterface import Counterface, Margin, ProfiledMargin, Step
from stepblocks.contact.energy import Release, Status, find_release
from stepblocks.contact.laws import build_laws
from stepblocks.contact.operating_point import Limits, OperatingPoint, Tissue, Tool
from stepblocks.errors import ContactError
from stepblocks.predict.predictions import drag_in_time
from stepblocks.predict.sweep.plan import DIRECTIONS, PARAMETERS, SURFACES, SweepPlan

Column = Array | NDArray[np.int64] | NDArray[np.str_] | NDArray[np.object_]

_UNITS = {
    "length": "_m",
    "force": "_n",
    "stiffness": "_n_m",
    "speed": "_m_s",
    "frequency": "_hz",
    "ratio": "",
    "direction": "",
}
# after ``drag_``
_DRAG = ("peak_force_n", "vibration_energy_j", "share", "ring_s", "ledger_error")
_SIGNED = ("horizontal_discrepancy", "vertical_discrepancy")


def draw_inputs(plan: SweepPlan, rows: range) -> dict[str, Array]:
    """Draw the inputs [SI] of neighbouring rows, by name; NaN where a part lacks the size."""
    names = list(PARAMETERS[plan.surface])
    points = np.arange(rows.start, rows.stop) // plan.draws
    first = rows.start // plan.draws
    drawn = _draw_uniform(plan.seed, 0, range(first, int(points[-1]) + 1), len(names) + 1)
    share = drawn[points - first] if plan.draws > 1 else drawn
    inputs: dict[str, Array] = {}
    left = points
    for place, name in enumerate(names):
        if name in plan.ranges:
            low, high = plan.ranges[name]
            inputs[name] = low + (high - low) * share[:, place]
        elif name in plan.values:
            choices = np.array(plan.values[name])
            left, turn = np.divmod(left, len(choices))
            chosen = (share[:, place] * len(choices)).astype(np.int64)
            inputs[name] = choices[turn if plan.kind == "grid" else chosen]
    spreads: dict[str, Array] = {}
    if plan.stimuli:
        which = left if plan.kind == "grid" else (share[:, -1] * len(plan.stimuli)).astype(int)
        inputs["stimulus"] = which.astype(np.float64)
        inputs |= _take_column([one["values"] for one in plan.stimuli], which, math.nan)
        spreads = _take_column([one["spreads"] for one in plan.stimuli], which, 0.0)
    spreads |= {
        **{name: np.full(len(rows), spread) for name, spread in plan.spreads.items()},
        **{name: part * inputs[name] for name, part in plan.shares.items()},
    }
    if spreads:
        from scipy.special import ndtri

        uniform = _draw_uniform(plan.seed, 1, rows, len(names))
        for name in (name for name in spreads if name in inputs):
            drawn = inputs[name] + spreads[name] * ndtri(uniform[:, names.index(name)])
            inputs[name] = drawn if name in _SIGNED else np.maximum(drawn, 0.0)
    return inputs


def _draw_uniform(seed: int, stream: int, rows: range, columns: int) -> Array:
    # Draw numbers between 0 and 1, shape (rows, columns), each by the number of its row
    blocks = -(-columns // 4)  # the generator counts in blocks of four
    random = np.random.Philox(key=np.array([seed, stream], dtype=np.uint64))
    random.advance(rows.start * blocks)
    raw = random.random_raw(4 * blocks * len(rows)).reshape(len(rows), -1)[:, :columns]
    return ((raw >> np.uint64(11)).astype(np.float64) + 0.5) * 2.0**-53


def _take_column(
    records: Sequence[Mapping[str, float]], which: NDArray[np.int64], missing: float
) -> dict[str, Array]:
    names = dict.fromkeys(name for one in records for name in one)
    return {name: np.array([one.get(name, missing) for one in records])[which] for name in names}


def compute_table(plan: SweepPlan, rows: range) -> pa.Table:
    """Compute rows; one outside the equations has its reason in ``problem``, and no figures."""
    inputs = draw_inputs(plan, rows)
    laws = build_laws(plan.laws)
    if "friction" in laws:
        law = laws["friction"]
        inputs["friction"] = np.array(
            [law.coefficient(0.0, one, 0.0, 0.0) for one in inputs["normal_load"].tolist()]
        )
    numbers = np.arange(rows.start, rows.stop)
    columns: dict[str, Column] = {"row": numbers, "draw": numbers % plan.draws}
    if plan.stimuli:
        columns["stimulus"] = np.array([one["id"] for one in plan.stimuli])[
            inputs["stimulus"].astype(int)
        ]
    nothing = np.full(len(rows), math.nan)
    columns |= {
        name + _UNITS[dimension]: inputs.get(name, nothing)
        for name, (dimension, _) in PARAMETERS[plan.surface].items()
    }
    backward = inputs.get("direction", np.zeros(len(rows))) > 0.0
    if plan.surface == "margin":
        columns["direction"] = np.array(DIRECTIONS)[backward.astype(int)]
    columns |= _predict_rows(plan, inputs, backward, laws)
    if plan.mode == "drag":
        columns |= _drag_rows(plan, inputs, backward, columns, laws)
    return pa.table(
        {
            name: _encode_texts(column) if column.dtype.kind in "UO" else pa.array(column)
            for name, column in columns.items()
        }
    )


def _encode_texts(column: Column) -> pa.Array:
    # Hand over texts by their codes: most of a column are alike
    codes, names = pd.factorize(column.astype(object))
    return pa.DictionaryArray.from_arrays(codes, list(names)).cast(pa.string())


def _predict_rows(
    plan: SweepPlan,
    inputs: Mapping[str, Array],
    backward: NDArray[np.bool_],
    laws: Mapping[str, Any],
) -> dict[str, Column]:
    # Predict all rows inside the equations at once, and the others one by one
    count = len(backward)
    status = np.full(count, "invalid", dtype="U16")
    problem = np.full(count, "", dtype=object)
    figures = np.full((3, count), math.nan)
    inside = _find_rows_in_domain(plan.surface, inputs)
    if plan.stimuli:
        # sides of a scan are not level: their angle is found by dilation, one by one
        scanned = np.array(["crown_slope" in one["face"] for one in plan.stimuli])
        inside &= ~scanned[inputs["stimulus"].astype(int)]
    try:
        angle, release = _release_at_once(plan, inputs, backward, inside)
        status[inside] = release.status
        figures[:2, inside] = angle, release.pull_force
    except ContactError:  # a limit that is not among ours: say in each row which
        inside = np.zeros(count, dtype=bool)
    for row in np.flatnonzero(~inside):
        try:
            face, point = _make_condition(plan, inputs, int(row), laws)
            one = face.release(point, bool(backward[row]))
            status[row] = str(one.status)
            figures[:2, row] = one.angle, one.pull_force
        except ContactError as error:
            problem[row] = str(error)
    with np.errstate(divide="ignore", invalid="ignore"):
        stored = kernels.compute_stored_energy(figures[1], inputs["stiffness"])
    figures[2] = np.where(status == Status.RELEASES, inputs["conversion"] * stored, math.nan)
    return {
        "status": status,
        "critical_angle_rad": figures[0],
        "peak_force_n": figures[1],
        "vibration_energy_j": figures[2],
        "problem": problem,
    }


def _find_rows_in_domain(surface: str, inputs: Mapping[str, Array]) -> NDArray[np.bool_]:
    # Tell for each row whether all of its inputs lie where the equations hold
    inside = np.ones(len(inputs["friction"]), dtype=bool)
    for name in ("tip_radius", "normal_load", "stiffness", "conversion"):
        inside &= (inputs[name] > 0.0) & np.isfinite(inputs[name])
    inside &= (inputs["friction"] >= 0.0) & np.isfinite(inputs["friction"])
    for name in SURFACES[surface].values():
        size = np.nan_to_num(inputs.get(name, np.zeros(1)), nan=0.0, posinf=math.inf)
        inside &= np.isfinite(size) & ((size >= 0.0) | (name in _SIGNED))
    return inside


def _release_at_once(
    plan: SweepPlan,
    inputs: Mapping[str, Array],
    backward: NDArray[np.bool_],
    inside: NDArray[np.bool_],
) -> tuple[Array, Release[NDArray[np.str_], Array]]:
    sizes = {
        name: inputs[column][inside]
        for name, column in SURFACES[plan.surface].items()
        if column in inputs
    }
    ball = inputs["tip_radius"][inside]
    if plan.surface == "step":
        ways = Step(1e-5).angles(
            ball,
            height=sizes["height"],
            edge_radius=np.nan_to_num(sizes.get("edge_radius", np.zeros(len(ball)))),
        )
    else:
        opening = sizes.get("opening", sizes["gap"])
        sizes["opening"] = np.where(np.isnan(opening), sizes["gap"], opening)
        ways = Margin(1e-5, 1e-5, 0.0).angles(ball, **sizes)
    angle = np.where(backward[inside], *(np.asarray(one, float) for one in reversed(ways)))
    load, friction = inputs["normal_load"][inside], inputs["friction"][inside]
    return angle, find_release(angle, load, friction, Tool(limits=Limits(**plan.limits)))


def _make_condition(
    plan: SweepPlan, inputs: Mapping[str, Array], row: int, laws: Mapping[str, Any]
) -> tuple[Counterface, OperatingPoint]:
    # Return the counterface and the operating point of one row
    one = {name: float(column[row]) for name, column in inputs.items()}
    sizes = {
        name: one[column]
        for name, column in SURFACES[plan.surface].items()
        if column in one and not math.isnan(one[column])
    }
    tool = Tool(
        one["stiffness"],
        one["conversion"],
        frequency=one["frequency"],
        limits=Limits(**plan.limits),
        overtones=laws.get("tool", ()),
    )
    tissue = Tissue()
    if plan.stimuli:
        stimulus = plan.stimuli[int(one["stimulus"])]
        sizes |= stimulus["face"]
        wall, damping, rubbed = stimulus["tissue"]
        tissue = Tissue(wall, damping / tool.frequency, rubbed)
    point = OperatingPoint(
        one["tip_radius"],
        one["normal_load"],
        laws.get("friction", one["friction"]),
        tool,
        tissue=tissue,
        contact=laws.get("contact"),
    )
    if plan.surface == "step":
        return Step(**sizes), point
    kind = ProfiledMargin if "crown_slope" in sizes else Margin
    # the end of a crown is square where no vertical discrepancy is given
    return kind(**{"opening": sizes["gap"]} | sizes), point


def _drag_rows(
    plan: SweepPlan,
    inputs: Mapping[str, Array],
    backward: NDArray[np.bool_],
    columns: Mapping[str, Column],
    laws: Mapping[str, Any],
) -> dict[str, Column]:
    # Drag every row in time that the equations let slip or lock
    found = columns["status"].astype("U16")
    figures = np.full((len(_DRAG), len(found)), math.nan)
    for row in np.flatnonzero(np.isin(found, [str(Status.RELEASES), str(Status.LOCKED)])):
        try:
            trace, ring = drag_in_time(
                *_make_condition(plan, inputs, int(row), laws),
                bool(backward[row]),
                float(inputs["speed"][row]),
                damping_ratio=float(inputs["damping_ratio"][row]),
            )
        except ContactError as error:
            found[row] = "invalid"
            columns["problem"][row] = str(error)
            continue
        found[row] = str(trace.status)
        figures[-1, row] = trace.ledger_error
        if ring:
            figures[:-1, row] = trace.peak_force, ring.energy, ring.share, ring.duration
    return {"drag_status": found} | {
        f"drag_{name}": column for name, column in zip(_DRAG, figures, strict=True)
    }
