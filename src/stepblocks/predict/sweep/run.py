"""Run a sweep: a plan in, partitioned Parquet out.

A partition is a pure function of the plan and its number, written beside its place and renamed:
a run may be interrupted, and what is finished stays. Rows do not depend on how they are divided.
"""

import io
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import asdict, dataclass
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

from stepblocks.compute.cluster import is_folder_shared, open_cluster
from stepblocks.compute.seam import run_calls
from stepblocks.errors import PipelineError
from stepblocks.files.claim import FolderClaim
from stepblocks.files.figures import Axes, get_or_make_axes
from stepblocks.files.store import FolderStore, ResultStore, open_store
from stepblocks.predict.renamed_columns import format_renamed_column_hint
from stepblocks.predict.sweep.plan import SweepPlan
from stepblocks.predict.sweep.read import load_sweep
from stepblocks.quantities import format_column_label, format_units

try:
    import pyarrow as pa
    import pyarrow.parquet as pq
except ImportError as error:
    raise PipelineError(
        "a sweep needs pyarrow: install the extra with pip install 'stepblocks[sweep]'"
    ) from error

if TYPE_CHECKING:
    from distributed import Client

PLAN_FILE = "_sweep.json"  # pandas and Dask pass over a name that begins so
_SHOWN = 5  # rows that a notebook shows
_MOST_JOBS = 1024


@dataclass(frozen=True)
class SweepResult:
    """A sweep on disk; unpacks into `computed` and `found`.

    Attributes
    ----------
    folder : Path or str
        Holds the partitions, ``part-00000000.parquet`` and on; an address where an object store
        holds them. pandas and Dask read the folder as it is, DuckDB ``*.parquet`` in it, polars
        with ``hidden_file_prefix="_"``.
    plan : SweepPlan
        What was computed.
    computed, found : int
        Partitions that this run wrote, and those that were there.
    """

    folder: Path | str
    plan: SweepPlan
    computed: int
    found: int

    def __iter__(self) -> Iterator[int]:
        return iter((self.computed, self.found))

    def __repr__(self) -> str:
        return (
            f"SweepResult({self.plan.row_count} rows in {self.plan.partition_count} partitions, "
            f"{self.computed} computed, {self.found} found, {str(self.folder)!r})"
        )

    def read(self, columns: list[str] | None = None) -> pd.DataFrame:
        """Read the table, or some of its columns; units stand at the end of their names."""
        store = open_store(self.folder)
        known = _open_partition(store, 0).schema_arrow.names
        for name in columns or ():
            if name not in known:
                hint = format_renamed_column_hint(name, known)
                raise PipelineError(f"columns must be of {', '.join(known)}, got {name!r}{hint}")
        partitions = []
        for number in range(self.plan.partition_count):
            partitions.append(_open_partition(store, number).read(columns))
        table: pd.DataFrame = pa.concat_tables(partitions).to_pandas()
        return table

    def _repr_html_(self) -> str:
        rows = _open_partition(open_store(self.folder), 0).read().slice(0, _SHOWN)
        return f"<p>{escape(repr(self))}</p>{rows.to_pandas().to_html(index=False)}"

    def plot(
        self,
        x: "str | Axes | None" = None,
        y: str = "vibration_energy_uj",
        ax: "Axes | None" = None,
    ) -> "Axes":
        """Draw a column against another, by default the energy against the height or the gap.

        Parameters
        ----------
        x, y : str
            Columns of the table. Axes may stand first, as in the other methods of this name.
        ax : matplotlib Axes, optional
            Where to draw; a new figure by default.

        Returns
        -------
        matplotlib Axes
        """
        if x is not None and not isinstance(x, str):
            return self.plot(None, y, x)
        if x is None:
            x = "marginal_gap_um"
            if self.plan.surface == "step":
                x = "height_um"
        table = self.read([x, y])
        axes = get_or_make_axes(ax)
        axes.plot(table[x], table[y], ".", markersize=3.0)
        axes.set_xlabel(format_units(format_column_label(x)))
        axes.set_ylabel(format_units(format_column_label(y)))
        return axes


def run_sweep(
    plan: SweepPlan | str | Path,
    output: str | Path,
    *,
    jobs: int = 1,
    on: "str | Client | None" = None,
    partitions: range | None = None,
    on_partition: Callable[[int], None] | None = None,
) -> SweepResult:
    """Predict a grid or a random design into partitioned Parquet.

    It computes every partition that is not yet there.

    Parameters
    ----------
    plan : SweepPlan, str or Path
        What to compute, or its TOML file.
    output : str or Path
        Where the partitions go: a folder, or an address that fsspec reaches, such as
        ``"s3://bucket/sweep"`` (with ``s3fs`` installed). One with another plan is refused.
    jobs : int
        Processes; a script needs no main guard. On a batch system, the workers to ask for.
    on : str or distributed.Client, optional
        A Dask cluster: the address of its scheduler such as ``"tcp://10.0.0.1:8786"``, a batch
        system such as ``"slurm"``, or a client. Workers that see `output` write there, otherwise
        this process does. This machine alone where omitted.
    partitions : range, optional
        Numbers of the partitions to compute; all where omitted. Several runs divide a sweep so
        at the same time, each with partitions of its own, such as the tasks of an array of jobs.
    on_partition : callable, optional
        Called with the number of each partition when it is finished.

    Returns
    -------
    SweepResult
        Folder, plan, and how many partitions were computed and found; it reads and draws its table.

    Raises
    ------
    PipelineError
        If the plan cannot be read, the folder belongs to another one, pyarrow is not installed, a
        process was ended from outside, or the cluster or the object store cannot be used.
    """
    _check_job_count(jobs)
    if not isinstance(plan, SweepPlan | str | Path):
        raise PipelineError(f"plan must be a SweepPlan or a path, got {type(plan).__name__}")
    if not isinstance(plan, SweepPlan):
        plan = load_sweep(Path(plan))
    store = open_store(output)
    wanted = _choose_partitions(plan, partitions)
    share = ""
    if partitions is not None:
        share = f"-{wanted.start}-{wanted.stop}"
    with store.hold_share(share):
        _make_folder_claim(plan).claim_folder(store)
        missing = [number for number in wanted if not _is_partition_complete(plan, number, store)]
        for number in missing:
            # a damaged file is ours, whatever it holds: the plan beside it says so
            store.remove(_format_partition_name(number))
        with open_cluster(on, jobs) as client:
            for number in _iterate_written_partitions(plan, missing, store, jobs, client):
                if on_partition is not None:
                    on_partition(number)
    folder: Path | str = store.location
    if isinstance(store, FolderStore):
        folder = store.folder
    return SweepResult(folder, plan, len(missing), len(wanted) - len(missing))


def _choose_partitions(plan: SweepPlan, partitions: range | None) -> range:
    """Return the partitions that are asked for, all where none are."""
    if partitions is None:
        return range(plan.partition_count)
    first, last = partitions.start, partitions.stop
    if partitions.step != 1 or not 0 <= first < last <= plan.partition_count:
        raise PipelineError(
            f"partitions must lie within 0:{plan.partition_count}, got {first}:{last}"
        )
    return partitions


def _iterate_written_partitions(
    plan: SweepPlan,
    numbers: Sequence[int],
    store: ResultStore,
    jobs: int,
    client: "Client | None",
) -> Generator[int]:
    """Write partitions here or on a cluster; yield the number of each when it is there."""
    if isinstance(store, FolderStore):
        store = FolderStore(store.folder.absolute())
    if client is None or _can_workers_reach_store(store, client):
        calls = ((plan, number, store) for number in numbers)
        yield from run_calls(write_partition, calls, jobs=jobs, on=client, in_order=False)
        return
    calls_elsewhere = ((plan, number) for number in numbers)
    computed = run_calls(
        compute_partition_file, calls_elsewhere, jobs=jobs, on=client, in_order=False
    )
    for number, content in computed:
        store.write(_format_partition_name(number), content)
        yield number


def _can_workers_reach_store(store: ResultStore, client: "Client") -> bool:
    """Tell whether workers of a cluster write where this process does."""
    if isinstance(store, FolderStore):
        return is_folder_shared(client, store.folder)
    return True


def _check_job_count(jobs: object) -> None:
    """Refuse a number of processes that is not a whole number above 0."""
    is_whole = isinstance(jobs, int) and not isinstance(jobs, bool)
    if not is_whole or not 1 <= jobs <= _MOST_JOBS:  # type: ignore[operator]
        shown = " ".join(repr(jobs).split())  # the text of a table has lines
        raise PipelineError(f"jobs must be a whole number from 1 to {_MOST_JOBS}, got {shown:.40}")


def write_partition(plan: SweepPlan, number: int, store: ResultStore) -> int:
    """Compute one partition and put its file in place; return its number."""
    _, content = compute_partition_file(plan, number)
    store.write(_format_partition_name(number), content)
    return number


def compute_partition_file(plan: SweepPlan, number: int) -> tuple[int, bytes]:
    """Compute one partition; return its number and the bytes of its file."""
    from stepblocks.predict.sweep.rows import compute_sweep_table

    table = compute_sweep_table(plan, _get_partition_rows(plan, number))
    return number, _encode_parquet(table)


def _get_partition_rows(plan: SweepPlan, number: int) -> range:
    """List the numbers of the rows of a partition."""
    first = number * plan.rows_per_partition
    return range(plan.row_count)[first : first + plan.rows_per_partition]


def _is_partition_complete(plan: SweepPlan, number: int, store: ResultStore) -> bool:
    """Tell whether a partition is there, and to the byte what is written for its rows."""
    try:
        content = store.read(_format_partition_name(number))
        if content is None:
            return False
        table = pq.ParquetFile(pa.BufferReader(content), page_checksum_verification=True).read()
    except (OSError, ValueError, pa.ArrowException):
        return False
    if table.num_rows != len(_get_partition_rows(plan, number)):
        return False
    return _encode_parquet(table) == content


def _encode_parquet(table: pa.Table) -> bytes:
    """Write a table as the bytes of its file."""
    stream = io.BytesIO()
    columns_of_texts = [field.name for field in table.schema if field.type == "string"]
    pq.write_table(
        table,
        stream,
        compression="zstd",
        use_dictionary=columns_of_texts,
        write_page_checksum=True,
    )
    return stream.getvalue()


def _make_folder_claim(plan: SweepPlan) -> FolderClaim:
    """Return what claims the folder of a sweep."""
    record = {"schema": 1, "digest": plan.digest, "rows": plan.row_count, "plan": asdict(plan)}
    return FolderClaim(
        file_name=PLAN_FILE,
        results="part-*.parquet",
        result_words="partitions",
        other_words="the result of another sweep",
        digest=plan.digest,
        record=record,
    )


def _open_partition(store: ResultStore, number: int) -> pq.ParquetFile:
    """Open a partition for reading; one that is gone is an error that names it."""
    name = _format_partition_name(number)
    gone = f"partition is gone: run the sweep again [{store.location}/{name}]"
    if isinstance(store, FolderStore):
        path = store.folder / name
        if not path.exists():
            raise PipelineError(gone)
        return pq.ParquetFile(path)  # of which only the columns that are wanted are read
    content = store.read(name)
    if content is None:
        raise PipelineError(gone)
    return pq.ParquetFile(pa.BufferReader(content))


def _format_partition_name(number: int) -> str:
    """Name the file of a partition."""
    return f"part-{number:08d}.parquet"
