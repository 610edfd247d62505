"""Which tests reach which function: a plugin of pytest for benchmarks/mutations.py.

``pytest -p mutations_reach tests/ROOM`` with REACH_SOURCE (folder of the source) and REACH_RECORD
(where to write) notes for every function of the source the tests that call it in this process, the
time of each test, and the tests that fail anyhow. Compiled kernels are not seen.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import pytest

SOURCE = os.environ.get("REACH_SOURCE", "")
RECORD = os.environ.get("REACH_RECORD", "")
seen: set[CodeType] = set()
by_setup: dict[str, set[str]] = defaultdict(set)
by_test: dict[str, set[str]] = defaultdict(set)
seconds: dict[str, float] = defaultdict(float)
failed: set[str] = set()


def note(frame: FrameType, event: str, value: object) -> None:
    """Keep the code that is called."""
    seen.add(frame.f_code)


def name_of(code: CodeType) -> str | None:
    """Name a function of the source as a mutant does; None for code of others."""
    if not code.co_filename.startswith(SOURCE) or code.co_name == "<module>":
        return None
    path = Path(code.co_filename).relative_to(SOURCE).as_posix()
    names = [one for one in code.co_qualname.split(".") if not one.startswith("<")]
    return f"{path}::{'.'.join(names)}"


def sort_seen(into: dict[str, set[str]], test: str) -> None:
    """Give what was called to a test."""
    for code in list(seen):
        if name := name_of(code):
            into[name].add(test)
    seen.clear()


def pytest_sessionstart(session: pytest.Session) -> None:
    """Begin to watch."""
    sys.settrace(note)
    threading.settrace(note)


@contextmanager
def watch(into: dict[str, set[str]], test: str) -> Iterator[None]:
    """Give to a test what is called meanwhile, and the time that it takes."""
    begun = time.monotonic()
    sys.settrace(note)
    try:
        yield
    finally:
        seconds[test] += time.monotonic() - begun
        sort_seen(into, test)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_setup(item: pytest.Item) -> Any:
    """Give to the setup of a test what its fixtures call."""
    seen.clear()
    with watch(by_setup, item.nodeid):
        return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Any:
    """Give to a test what it calls."""
    with watch(by_test, item.nodeid):
        return (yield)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Keep the tests that fail without a mutant."""
    if report.failed:
        failed.add(report.nodeid)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Write what was seen."""
    sys.settrace(None)
    record = {
        "seconds": {name: round(spent, 3) for name, spent in seconds.items()},
        "failed": sorted(failed),
        "tests": {name: sorted(tests) for name, tests in sorted(by_test.items())},
        "setups": {name: sorted(tests) for name, tests in sorted(by_setup.items())},
    }
    Path(RECORD).write_text(json.dumps(record) + "\n", encoding="utf-8")
