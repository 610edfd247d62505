"""Rehearse a session many times, each with a seed of its own, here or on a cluster."""

import tempfile
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from stepblocks import __version__
from stepblocks.compute.cluster import is_folder_shared, open_cluster
from stepblocks.compute.cores import count_cores
from stepblocks.compute.seam import run_calls
from stepblocks.errors import PipelineError
from stepblocks.files.atomic import (
    lock_folder,
    make_draft_folder,
    move_into_place,
    sync_folder,
)
from stepblocks.files.claim import FolderClaim, hash_plan
from stepblocks.files.packed import PackedFolder, pack_folder, unpack_folder
from stepblocks.files.store import FolderStore
from stepblocks.quantities import check_seed
from stepblocks.rehearse.plan import SessionPlan, read_session_plan
from stepblocks.rehearse.run import write_session, write_session_folder

if TYPE_CHECKING:
    from distributed import Client

_PLAN_FILE = "rehearsals.json"


@dataclass(frozen=True)
class Rehearsals:
    """Sessions that differ in their seeds alone.

    Attributes
    ----------
    folders : tuple of Path
        One for each seed, ``seed-000007`` for seed 7.
    simulated, found : int
        Sessions that this run wrote, and those that were there.
    """

    folders: tuple[Path, ...]
    simulated: int
    found: int


def simulate_sessions(
    plan: str | Path,
    output: str | Path,
    seeds: Sequence[int],
    *,
    jobs: int | None = None,
    on: "str | Client | None" = None,
    on_session: Callable[[Path], None] | None = None,
) -> Rehearsals:
    """Simulate a session once for each seed; what an earlier run finished is kept.

    Parameters
    ----------
    plan : str or Path
        TOML file of the plan: design, model, scatter, rig and effects. Its own seed is not used.
    output : str or Path
        Folder of the sessions; each has a folder in it.
    seeds : sequence of int
        Seeds of all chance, each once.
    jobs : int, optional
        Processes of this machine, one for each core where omitted. On a batch system, the workers
        to ask for.
    on : str or distributed.Client, optional
        A Dask cluster, as in `run_sweep`. Workers that see `output` write there, otherwise this
        process does.
    on_session : callable, optional
        Called with the folder of each session when it is finished.

    Returns
    -------
    Rehearsals
        The folders, and how many sessions were simulated and found.

    Raises
    ------
    PipelineError
        If the plan is malformed, a seed stands twice or is out of range, a folder holds another
        session, every trial of one locks, or the cluster cannot be used.
    """
    declared = read_session_plan(Path(plan))
    _refuse_bad_seeds(seeds)
    folder = Path(output)
    places = []
    missing = []
    with lock_folder(folder):
        _make_rehearsal_claim(declared).claim_folder(FolderStore(folder))
        for seed in seeds:
            place = folder / f"seed-{seed:06d}"
            places.append(place)
            if not place.exists():  # a session appears whole or not at all
                seeded = declared.model_copy(update={"seed": seed})
                missing.append((seeded, place.absolute()))
        with open_cluster(on if missing else None, jobs) as cluster:
            for place in _simulate_missing_sessions(missing, jobs or count_cores(), cluster):
                if on_session is not None:
                    on_session(place)
    return Rehearsals(tuple(places), len(missing), len(places) - len(missing))


def _refuse_bad_seeds(seeds: Sequence[int]) -> None:
    """Refuse seeds that are missing, repeated or out of range."""
    if not seeds:
        raise PipelineError("seeds must name at least one session, got none")
    for seed in seeds:
        check_seed(seed)
    if len(set(seeds)) != len(seeds):
        raise PipelineError("seeds must differ from each other, got one twice")


def _make_rehearsal_claim(plan: SessionPlan) -> FolderClaim:
    """Return the claim of a plan on its folder of rehearsals, whatever its own seed."""
    content = plan.model_dump(mode="json", exclude={"seed"})
    digest = hash_plan({"plan": content, "stepblocks": __version__})
    return FolderClaim(
        file_name=_PLAN_FILE,
        results="seed-*",
        result_words="sessions",
        other_words="sessions of another plan",
        digest=digest,
        record={"schema": 1, "digest": digest, "plan": content},
    )


def _simulate_missing_sessions(
    missing_sessions: Sequence[tuple[SessionPlan, Path]], jobs: int, cluster: "Client | None"
) -> Generator[Path]:
    """Simulate sessions here or on a cluster; yield the folder of each when it is there."""
    if not missing_sessions:
        return
    folder = missing_sessions[0][1].parent
    processes = min(jobs, len(missing_sessions))
    if cluster is None or is_folder_shared(cluster, folder):
        yield from run_calls(
            write_session_and_return_folder,
            missing_sessions,
            jobs=processes,
            on=cluster,
            in_order=False,
        )
        return
    calls = run_calls(
        write_packed_session, missing_sessions, jobs=processes, on=cluster, in_order=False
    )
    for place, files in calls:
        with make_draft_folder(place) as draft:
            unpack_folder(files, draft)
            sync_folder(draft)
            move_into_place(draft, place)
        yield place


def write_session_and_return_folder(plan: SessionPlan, folder: Path) -> Path:
    """Write a session into its folder, whole or not at all; return the folder."""
    write_session_folder(plan, folder)
    return folder


def write_packed_session(plan: SessionPlan, folder: Path) -> tuple[Path, PackedFolder]:
    """Write a session into a temporary folder of this machine; return its place and files."""
    with tempfile.TemporaryDirectory(prefix="stepblocks-") as name:
        write_session(plan, Path(name))
        return folder, pack_folder(Path(name))
