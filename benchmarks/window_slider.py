"""How soon what is felt follows a slider of the window, in a real Chromium.

``python benchmarks/window_slider.py [FILE]`` serves a copy of a stimulus file (ten blocks of the
paper by default), opens its form in Chromium, and moves the last slider by its arrow key. In the
page itself is measured how long after the key the text of the moved block's energy changes, by the
formula, and how long after it the energy by the drag in time stands beside it: in 30 moves of which
each waits for the drag, and in 30 moves in a row, ten a second, as a hand drags. Exit code 1 where
a median is at or above 0.1 s by the formula, or 1 s by the drag. On a busy machine other programs
are measured, too.

Needs Chromium with chromedriver.
"""

import shutil
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait
from window_start import serve_window

ROOT = Path(__file__).resolve().parents[1]
FILE = ROOT / "stimuli" / "paper-ten.toml"
MOVES = 30
MOST_BY_FORMULA, MOST_BY_DRAG = 0.1, 1.0  # [s]
STEPS = 5  # in one direction
PERIOD = 0.1  # of moves in a row [s]
PATIENCE = 120.0  # until the page is there, or a figure has followed [s]
# Keeps the time of every key, and of every change of the energies in the table, by its columns.
WATCH = """
const row = () => [...document.querySelectorAll('table tbody tr')].map(line =>
  [...line.querySelectorAll('td')].map(cell => cell.textContent.trim()));
window.moves = [];
window.formula = [];
window.drag = [];
let energies = '';
let dragged = '';
const look = () => {
  const rows = row();
  const now = rows.map(cells => cells[4]).join('|');
  const inTime = rows.map(cells => cells[6]);
  const isWhole = inTime.length > 0 && inTime.every(text => text !== '');
  if (now !== energies) window.formula.push(performance.now());
  if (isWhole && inTime.join('|') !== dragged) {
    window.drag.push(performance.now());
    dragged = inTime.join('|');
  }
  if (!isWhole) dragged = '';
  energies = now;
};
look();
window.formula = [];
window.drag = [];
new MutationObserver(look).observe(document.body,
  {childList: true, subtree: true, characterData: true});
document.addEventListener('keydown', () => window.moves.push(performance.now()), true);
"""
FORGET = "window.moves = []; window.formula = []; window.drag = [];"


@contextmanager
def open_chromium() -> Iterator[webdriver.Chrome]:
    """Start a headless Chromium."""
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or shutil.which("google-chrome") or ""
    for argument in ("headless=new", "no-sandbox", "window-size=1280,860"):
        options.add_argument(f"--{argument}")
    browser = webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))
    try:
        yield browser
    finally:
        browser.quit()


def wait_until(browser: webdriver.Chrome, script: str) -> None:
    """Wait until a script of the page returns true."""
    WebDriverWait(browser, PATIENCE, 0.05).until(lambda _: browser.execute_script(script))


def open_form(browser: webdriver.Chrome, address: str, name: str) -> Any:
    """Open the form of a file; return its last slider once all is there that follows it."""
    browser.get(address)  # its token becomes a cookie
    browser.get(f"{address.partition('?')[0]}declare?file={name}")
    wait_until(
        browser,
        "const cells = document.querySelectorAll('table tbody td:last-child');"
        "return cells.length > 0 && [...cells].every(cell => cell.textContent.trim() !== '');",
    )
    time.sleep(1.0)
    browser.execute_script(WATCH)
    slider = browser.find_elements("css selector", ".q-slider [tabindex='0']")[-1]
    browser.execute_script("arguments[0].focus()", slider)
    return slider


def choose_key(number: int) -> str:
    """Return the key of a move: to and fro, so that no end of the slider is met."""
    if number % (2 * STEPS) < STEPS:
        return Keys.ARROW_LEFT
    return Keys.ARROW_RIGHT


def move_one_by_one(browser: webdriver.Chrome, slider: Any) -> tuple[list[float], list[float]]:
    """Move, and wait for the drag, again and again; return both delays of every move [s]."""
    by_formula = []
    by_drag = []
    for number in range(MOVES):
        browser.execute_script(FORGET)
        slider.send_keys(choose_key(number))
        wait_until(browser, "return window.drag.length > 0 && window.formula.length > 0")
        begun, formula, drag = browser.execute_script(
            "return [window.moves[0], window.formula[0], window.drag[0]]"
        )
        by_formula.append((formula - begun) / 1e3)
        by_drag.append((drag - begun) / 1e3)
    return by_formula, by_drag


def move_in_a_row(browser: webdriver.Chrome, slider: Any) -> tuple[list[float], float]:
    """Move without waiting; return the delay of every move by the formula, and of the drag [s]."""
    browser.execute_script(FORGET)
    for number in range(MOVES):
        slider.send_keys(choose_key(number))
        time.sleep(PERIOD)
    wait_until(
        browser, "return window.drag.some(time => time > window.moves[window.moves.length - 1])"
    )
    moves, formula, drag = browser.execute_script(
        "return [window.moves, window.formula, window.drag]"
    )
    delays = []
    for begun in moves:
        delays.append(min(shown - begun for shown in formula if shown > begun) / 1e3)
    last = min(shown - moves[-1] for shown in drag if shown > moves[-1]) / 1e3
    return delays, last


def describe(name: str, delays: list[float]) -> str:
    """Describe delays [s] by their median and their worst."""
    median, worst = 1e3 * statistics.median(delays), 1e3 * max(delays)
    return f"{name}: median {median:.0f} ms, worst {worst:.0f} ms of {len(delays)} moves"


def main() -> int:
    """Measure, print, and judge the medians."""
    given = Path(sys.argv[1]) if len(sys.argv) > 1 else FILE
    with tempfile.TemporaryDirectory() as folder:
        shutil.copy(given, folder)
        with serve_window(folder) as (_, address), open_chromium() as browser:
            slider = open_form(browser, address, given.name)
            by_formula, by_drag = move_one_by_one(browser, slider)
            in_a_row, last = move_in_a_row(browser, slider)
    print(describe("by the formula, one by one", by_formula))
    print(describe("by the drag, one by one", by_drag))
    print(describe("by the formula, in a row", in_a_row))
    print(f"by the drag behind the last of a row: {1e3 * last:.0f} ms")
    formula = max(statistics.median(by_formula), statistics.median(in_a_row))
    drag = max(statistics.median(by_drag), last)
    return int(formula >= MOST_BY_FORMULA or drag >= MOST_BY_DRAG)


if __name__ == "__main__":
    sys.exit(main())
