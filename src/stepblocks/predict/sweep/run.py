"""Run a sweep: a plan in, partitioned Parquet out, on this machine or on a cluster that exists."""

# A partition is a pure function of the plan and its number, written beside its place and renamed:
# workers may die, runs may be interrupted, and what is finished stays. The rows do not depend on
# how they are partitioned.

from __future__ import annotations

import io
import json
import math
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stepblocks.atomic import lock_folder, replace_bytes, replace_text
from stepblocks.contact.counterface import Counterface, Margin, Step
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import Limits, OperatingPoint, Tool
from stepblocks.errors import ContactError, PipelineError
from stepblocks.predict.predictions import drag_in_time
from stepblocks.predict.sweep.plan import DIRECTIONS, PARAMETERS, SURFACES, SweepPlan, load_sweep

if TYPE_CHECKING:
    from distributed import Client

_PLAN_FILE = "sweep.json"
_UNITS = {
    "length": "_m",
    "force": "_n",
    "stiffness": "_n_m",
    "speed": "_m_s",
    "frequency": "_hz",
    "ratio": "",
    "direction": "",
}
_STATIC = ("status", "critical_angle_rad", "peak_force_n", "vibration_energy_j")
_DRAG = (
    "status",
    "peak_force_n",
    "vibration_energy_j",
    "share",
    "ring_s",
    "ledger_error",
)  # after ``drag_``


def sweep(
    plan: SweepPlan | str | Path,
    output: str | Path,
    *,
    jobs: int = 1,
    scheduler: str | None = None,
    on_partition: Callable[[int], None] | None = None,
) -> tuple[int, int]:
    """Predict a grid or a random design into partitioned Parquet: every partition that is not yet there.

    Parameters
    ----------
    plan : SweepPlan, str or Path
        What to compute, or its TOML file.
    output : str or Path
        Where the partitions go, ``part-00000000.parquet`` and on. A folder of another plan is
        refused.
    jobs : int
        Local processes; 1 computes in this one, without Dask.
    scheduler : str, optional
        Address of a Dask scheduler whose workers see `output` under the same path.
    on_partition : callable, optional
        Called with the number of each partition when it is finished.

    Returns
    -------
    computed, found : int
        Partitions written by this run, and those that were there.

    Raises
    ------
    PipelineError
        If the plan cannot be read, the folder belongs to another one, an extra is not installed, or
        the scheduler does not answer.
    """
    plan = plan if isinstance(plan, SweepPlan) else load_sweep(Path(plan))
    folder = Path(output)
    _require_extra(dask=scheduler is not None or jobs > 1)
    report = on_partition or (lambda _: None)
    with lock_folder(folder):
        _claim_folder(plan, folder)
        missing = [k for k in range(plan.partitions) if not _is_whole(plan, k, folder)]
        for (
            k
        ) in missing:  # what is damaged is ours, whatever it holds now: the plan beside it says so
            _find_path(folder, k).unlink(missing_ok=True)
        if scheduler is None and jobs <= 1:
            for k in missing:
                write_partition(plan, k, folder)
                report(k)
        elif missing:
            with _open_client(jobs, scheduler) as client:
                _submit(client, plan, folder, missing, report)
    return len(missing), plan.partitions - len(missing)


def _list_rows(plan: SweepPlan, number: int) -> range:
    start = number * plan.rows_per_partition
    return range(start, min(start + plan.rows_per_partition, plan.rows))


def _is_whole(plan: SweepPlan, number: int, folder: Path) -> bool:
    """Tell whether a partition is there, and to the byte what is written for the rows that it holds, which have checksums."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        content = _find_path(folder, number).read_bytes()
        table = pq.ParquetFile(pa.BufferReader(content), page_checksum_verification=True).read()
    except (OSError, ValueError, pa.ArrowException):
        return False
    return bool(
        table.num_rows == len(_list_rows(plan, number)) and _format_parquet(table) == content
    )


def _format_parquet(table: Any) -> bytes:
    import pyarrow.parquet as pq

    stream = io.BytesIO()
    pq.write_table(table, stream, compression="zstd", write_page_checksum=True)
    return stream.getvalue()


def write_partition(plan: SweepPlan, number: int, folder: Path) -> int:
    """Compute one partition and put its file in place; returns the number of its rows."""
    import pyarrow as pa

    rows = [compute_row(plan, row) for row in _list_rows(plan, number)]
    texts = ("stimulus", "direction", "status", "drag_status", "problem")
    kinds = {"row": pa.int64(), "draw": pa.int64(), **dict.fromkeys(texts, pa.string())}
    schema = pa.schema([(name, kinds.get(name, pa.float64())) for name in rows[0]])
    replace_bytes(
        _find_path(folder, number), _format_parquet(pa.Table.from_pylist(rows, schema=schema))
    )
    return len(rows)


def _submit(
    client: Any, plan: SweepPlan, folder: Path, missing: list[int], report: Callable[[int], None]
) -> None:
    """Keep a few partitions per worker in flight, so that neither scheduler nor workers hold more than that."""
    from distributed import as_completed

    waiting: Iterator[int] = iter(missing)
    ahead = 4 * max(len(client.scheduler_info()["workers"]), 1)

    def submit(number: int) -> Any:
        key = f"stepblocks-{plan.digest[:16]}-{number}"
        return client.submit(
            write_partition, plan, number, folder.absolute(), key=key, pure=False, retries=5
        )

    flying = as_completed([submit(k) for k in islice(waiting, ahead)], loop=client.loop)
    for future in flying:
        future.result()
        report(int(future.key.rsplit("-", 1)[1]))
        following = next(waiting, None)
        if following is not None:
            flying.add(submit(following))


def _open_client(jobs: int, scheduler: str | None) -> Client:
    import dask
    from distributed import Client, LocalCluster

    if scheduler is not None:
        try:
            return Client(scheduler, timeout="10s")
        except (OSError, ValueError) as error:
            raise PipelineError(f"scheduler {scheduler!r} does not answer: {error}") from error
    # a worker that dies is no fault of its partition: let it be tried again elsewhere
    dask.config.set({"distributed.scheduler.allowed-failures": 20})
    cluster = LocalCluster(
        n_workers=jobs, threads_per_worker=1, processes=True, dashboard_address=None
    )
    return Client(cluster, set_as_default=False)


def _claim_folder(plan: SweepPlan, folder: Path) -> None:
    """Write the resolved plan into the folder, or make sure that the one that lies there is the same."""
    path = folder / _PLAN_FILE
    text = json.dumps(
        {"digest": plan.digest, "rows": plan.rows, "plan": asdict(plan)}, indent=1, sort_keys=True
    )
    if path.exists():
        try:
            known = json.loads(path.read_text(encoding="utf-8")).get("digest")
        except (OSError, ValueError, AttributeError) as error:
            raise PipelineError(
                f"{_PLAN_FILE} cannot be read; choose another folder [{folder}]"
            ) from error
        if known != plan.digest:
            whose = "another sweep, or of another version of stepblocks"
            raise PipelineError(
                f"folder holds the result of {whose}; choose another folder [{folder}]"
            )
        return
    if any(folder.glob("part-*.parquet")):
        raise PipelineError(
            f"folder holds partitions without {_PLAN_FILE}; choose another folder [{folder}]"
        )
    replace_text(path, text + "\n")


def _find_path(folder: Path, number: int) -> Path:
    return folder / f"part-{number:08d}.parquet"


def _require_extra(dask: bool) -> None:
    from importlib.util import find_spec

    for name in ("pyarrow", *(("distributed",) if dask else ())):
        if find_spec(name) is None:
            raise PipelineError(
                f"a sweep needs {name}: install the extra with pip install 'stepblocks[sweep]'"
            )


def draw_inputs(plan: SweepPlan, row: int) -> dict[str, float]:
    """Draw the inputs [SI] of one row; they depend on the plan and the row's number alone."""
    left = point = row // plan.draws
    inputs: dict[str, float] = {}
    random = np.random.default_rng([plan.seed, point])
    for name in PARAMETERS[plan.surface]:
        if name in plan.ranges:
            inputs[name] = float(random.uniform(plan.ranges[name][0], plan.ranges[name][1]))
        elif name in plan.values:
            choices = plan.values[name]
            if plan.kind == "grid":
                left, index = divmod(left, len(choices))
            else:
                index = int(random.integers(len(choices)))
            inputs[name] = choices[index]
    spreads = dict(plan.spreads)
    if plan.stimuli:
        index = left if plan.kind == "grid" else int(random.integers(len(plan.stimuli)))
        chosen = plan.stimuli[index]
        inputs |= {"stimulus": index} | chosen["values"]
        spreads = chosen["spreads"] | spreads
    spreads |= {name: share * inputs[name] for name, share in plan.shares.items()}
    if spreads:
        noise = np.random.default_rng([plan.seed, row, 1])
        signed = ("horizontal_discrepancy", "vertical_discrepancy")
        for name in PARAMETERS[plan.surface]:
            if name in spreads:
                moved = inputs[name] + spreads[name] * float(noise.standard_normal())
                inputs[name] = moved if name in signed else max(moved, 0.0)
    return inputs


def compute_row(plan: SweepPlan, row: int) -> dict[str, Any]:
    """Compute a row of the table; one outside the equations has its reason in ``problem``, no figures."""
    inputs = draw_inputs(plan, row)
    result: dict[str, Any] = {"row": row, "draw": row % plan.draws}
    if plan.stimuli:
        result["stimulus"] = plan.stimuli[int(inputs["stimulus"])]["id"]
    for name, (dimension, _) in PARAMETERS[plan.surface].items():
        result[name + _UNITS[dimension]] = inputs.get(name, math.nan)
    if plan.surface == "margin":
        result["direction"] = DIRECTIONS[int(inputs["direction"])]
    result |= dict.fromkeys(_STATIC, math.nan) | {"status": "invalid", "problem": ""}
    if plan.mode == "drag":
        result |= {f"drag_{name}": math.nan for name in _DRAG} | {"drag_status": "invalid"}
    try:
        face = _make_counterface(plan.surface, inputs)
        tool = Tool(inputs["stiffness"], inputs["conversion"], limits=Limits(**plan.limits))
        point = OperatingPoint(
            inputs["tip_radius"], inputs["normal_load"], inputs["friction"], tool
        )
        backward = bool(inputs.get("direction", 0.0))
        release = face.release(point, backward)
        found = str(release.status), release.angle, release.pull_force, release.vibration_energy
        result |= zip(_STATIC, found, strict=True)
        if plan.mode == "drag" and (
            release.status.is_beyond_limit or release.status in (Status.TOO_HIGH, Status.NO_CATCH)
        ):
            result["drag_status"] = str(release.status)
        elif plan.mode == "drag":
            result |= _drag_row(face, point, backward, inputs)
    except ContactError as error:
        result["problem"] = str(error)
    return result


def _make_counterface(surface: str, inputs: dict[str, float]) -> Counterface:
    sizes = {name: inputs[column] for name, column in SURFACES[surface].items() if column in inputs}
    # the end of a crown is square where no vertical discrepancy is given
    return Step(**sizes) if surface == "step" else Margin(**{"opening": sizes["gap"]} | sizes)


def _drag_row(
    face: Counterface, point: OperatingPoint, backward: bool, inputs: dict[str, float]
) -> dict[str, Any]:
    point = replace(point, tool=replace(point.tool, frequency=inputs["frequency"]))
    trace, ring = drag_in_time(
        face, point, backward, inputs["speed"], damping_ratio=inputs["damping_ratio"]
    )
    felt = (trace.peak_force, ring.energy, ring.share, ring.duration) if ring else (math.nan,) * 4
    found = str(trace.status), *felt, trace.ledger_error
    return {f"drag_{name}": one for name, one in zip(_DRAG, found, strict=True)}
