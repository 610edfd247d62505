"""How long the window takes to its first page, and what it holds while it is idle.

``python benchmarks/window_start.py [FOLDER]`` starts ``stepblocks app`` five times, asks for the
start page as a browser does, waits, and reads the memory of the server. Exit code 1 where the
median start takes 2 s or longer, or the memory is 300 MB or more. On a busy machine look at the
processor time, which does not depend on what else runs.
"""

import re
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from http.cookiejar import CookieJar

import psutil

RUNS = 5
MOST_SECONDS = 2.0  # to the first page
MOST_MEMORY = 300e6  # of the idle server [bytes]
IDLE = 3.0  # before memory is read [s]


@contextmanager
def serve_window(folder: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Serve a folder until the block ends; yield the server and the address of its window."""
    words = [sys.executable, "-m", "stepblocks", "app", folder, "--no-open"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            found = re.search(r"http://\S+", process.stdout.readline())
            assert found is not None
            yield process, found[0]
        finally:
            process.terminate()
            process.wait(60)


def start_once(folder: str) -> tuple[float, float, int]:
    """Start a window; return time and processor time to its first page [s], and idle memory."""
    begin = time.perf_counter()
    with serve_window(folder) as (process, address):
        cookies = urllib.request.HTTPCookieProcessor(CookieJar())
        # with the cookie that the address with the token gives
        with urllib.request.build_opener(cookies).open(address, timeout=60) as page:
            page.read()
        seconds = time.perf_counter() - begin
        server = psutil.Process(process.pid)
        used = server.cpu_times()
        time.sleep(IDLE)
        return seconds, used.user + used.system, server.memory_info().rss


def main() -> int:
    """Print both figures of every start, and judge the medians."""
    with tempfile.TemporaryDirectory() as empty:
        folder = sys.argv[1] if len(sys.argv) > 1 else empty
        starts = [start_once(folder) for _ in range(RUNS)]
    for seconds, used, memory in starts:
        print(
            f"{seconds:.2f} s to the first page, {used:.2f} s of processor, "
            f"{memory / 1e6:.0f} MB idle",
            flush=True,
        )
    seconds, used, memory = map(statistics.median, zip(*starts, strict=True))
    print(
        f"median {seconds:.2f} s (below {MOST_SECONDS:g}), {used:.2f} s of processor, "
        f"{memory / 1e6:.0f} MB (below 300)"
    )
    return int(seconds >= MOST_SECONDS or memory >= MOST_MEMORY)


if __name__ == "__main__":
    sys.exit(main())
