"""Shared by all tests: the shipped stimuli, built once."""

import gc
import os
import pickle
from pathlib import Path

import pytest
from filelock import FileLock
from hypothesis import settings
from joblib import cpu_count

from stepblocks.parts.kind import Part

# the same examples on every machine, however slow it is
settings.register_profile("quick", derandomize=True, deadline=None, max_examples=20)
settings.register_profile("long", derandomize=True, deadline=None, max_examples=100)

# as the command line does, before numpy is loaded: threads of the linear algebra only wait for each
# other
for library in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(library, "1")

CORES = cpu_count()
# the cores are busy where several processes share the tests: a command of a test starts workers
# only where the test asks for them, as each would load the libraries again
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ["LOKY_MAX_CPU_COUNT"] = "1"

ROOT = Path(__file__).resolve().parent.parent


def pytest_configure(config):
    """Try few examples of each property in the quick run, and many in the long one."""
    settings.load_profile("long" if runs_long_tests(config) else "quick")


def pytest_xdist_auto_num_workers(config):
    """Share the long tests among one process more than there are cores: some only wait."""
    return CORES + 1 if runs_long_tests(config) else CORES


def runs_long_tests(config):
    """Tell whether the tests that are marked long are asked for, not all others."""
    return config.option.markexpr.startswith("long")


# files of the long tests that take a minute or so: begun first, so that no process waits for
# another one at the end
BEGUN_FIRST = (
    "artefacts/test_artefacts.py",
    "cli/test_one_event.py",
    "drag/test_laws.py",
    "loop/test_finding.py",
    "loop/test_loop.py",
    "loop/test_own_effect.py",
    "loop/test_rehearsal.py",
    "loop/test_run.py",
    "predict/test_sweep.py",
    "simulators/test_export.py",
    "simulators/test_native.py",
    "simulators/test_native_force.py",
    "simulators/test_scenes.py",
    "study/test_conduct.py",
    "study/test_recovery.py",
    "study/test_silent.py",
    "test_fuzz_and_faults.py",
    "window/test_in_browser.py",
    "window/test_killed_jobs.py",
    "workshop/test_ten_blocks.py",
)


# what the quick tests build: a part of each kind and of each form that has an artefact of its own,
# and the parts that single tests open
QUICKLY_BUILT = {
    "crown-chamfer-over",
    "gap-050-under-020",
    "hook",
    "hook-125",
    "sheath-soft",
    "sheath-hard",
    "step-010",
    "step-050",
    "step-100",
    "tip-125",
}


def pytest_collection_modifyitems(items):
    """Take the first case alone of a test that repeats one promise; begin with the long files."""
    seen = set()
    for item in items:
        function = item.nodeid.partition("[")[0]
        if item.get_closest_marker("repeats") and function in seen:
            item.add_marker("long")
        if is_of_a_part_that_is_built_at_length(item):
            item.add_marker("long")
        seen.add(function)
    items.sort(key=lambda item: not item.path.as_posix().endswith(BEGUN_FIRST))


def is_of_a_part_that_is_built_at_length(item):
    """Tell whether a test opens a shipped part that the quick tests do not build."""
    if "shipped_output" not in item.fixturenames or not hasattr(item, "callspec"):
        return False
    given = item.callspec.params.values()
    return any(isinstance(value, Part) and value.id not in QUICKLY_BUILT for value in given)


def pytest_collection_finish():
    """Look for garbage among what tests make, seldom, and never among what was loaded for all."""
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)


@pytest.fixture(scope="session")
def shared():
    """Folder of measured and real data that is not part of the repository."""
    folder = Path(os.environ.get("STEPBLOCKS_SHARED", ROOT.parent / "shared"))
    if not folder.is_dir():
        pytest.skip("the shared data are not here")
    return folder


@pytest.fixture(scope="session")
def make_once(tmp_path_factory):
    """Function that makes something by name: once for all processes that share the tests.

    The first one calls ``make(folder)``; the others wait, and read the result from a file.
    """
    from joblib.externals.loky.backend.reduction import dumps  # of functions, too

    several = "PYTEST_XDIST_WORKER" in os.environ
    base = tmp_path_factory.getbasetemp().parent if several else tmp_path_factory.getbasetemp()

    def make_or_read(name, make):
        folder, kept = base / name, base / f"{name}.pickle"
        with FileLock(base / f"{name}.lock"):
            if not kept.exists():
                folder.mkdir()
                kept.write_bytes(dumps((folder, make(folder))))
            return pickle.loads(kept.read_bytes())

    return make_or_read


def select_quickly_built(shipped):
    """Take the parts of a shipped set that the quick tests build."""
    parts = tuple(part for part in shipped.stimuli if part.id in QUICKLY_BUILT)
    return shipped.model_copy(update={"stimuli": parts})


@pytest.fixture(scope="session")
def shipped_output(make_once, request):
    """Output folder with shipped stimuli: all of them in the long tests, else some of each set."""
    from oracles.shipped import load_all_shipped
    from stepblocks.build.run import build_sets

    sets = load_all_shipped()
    if not runs_long_tests(request.config):
        sets = [select_quickly_built(shipped) for shipped in sets]

    # few parts are built sooner in this process, which has loaded what it takes
    jobs = CORES if runs_long_tests(request.config) else 1

    def build(folder):
        return build_sets(sets, folder, jobs=jobs).failures

    folder, failures = make_once("shipped", build)
    assert failures == []
    return folder
