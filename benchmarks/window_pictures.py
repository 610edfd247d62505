"""Pictures of the window for the documentation: ``python benchmarks/window_pictures.py``.

Needs Chromium with chromedriver. Writes ``docs/images/window-*.png`` at 1280 pixels, of a folder
with three blocks, a scan with two edges, and a session whose friction runs in, which a loop has
explained.
"""

import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from selenium import webdriver
from selenium.webdriver.chrome.service import Service

ROOT = Path(__file__).resolve().parents[1]
PAGES = {
    "declare": "declare?file=three.toml",
    "inspect": "inspect?file=scan.csv",
    "bench": "bench?session=sessions/b1",
}
# clicked, by its text, before the picture is taken; what is shown then is scrolled to
CLICKED = {"inspect": "Look"}
SHOWN = {"declare": "table", "inspect": "h1", "bench": "canvas"}
WAIT = 15.0  # until what a page reads from files is there [s]
BLOCKS = """[prediction]
normal_loads = ["0.8 N"]

[[step_block]]
id = "low"
height = "25 um"

[[step_block]]
id = "mid"
height = "50 um"

[[step_block]]
id = "high"
height = "75 um"
"""
PLAN = """schema = 1
seed = 5
format = "csv"

[design]
heights = ["20 um", "40 um", "60 um", "80 um"]
loads = ["0.5 N", "1.1 N"]
speeds = ["2 mm/s", "10 mm/s"]
trials = 48

[[effects]]
slot = "friction"
change = "multiply"
form = "exponential"
covariate = "run_order"
size = 0.8
span = 12
"""
SIZE = "1280,860"


def prepare(folder: Path) -> None:
    """Put a stimulus file, a scan and an explained session into the folder that is shown."""
    (folder / "three.toml").write_text(BLOCKS, encoding="utf-8")
    rows = []
    for number in range(1000):
        rows.append(f"{2 * number},{25 * (number > 250) + 40 * (number > 750)}")
    text = "\n".join(["x_um,z_um", *rows]) + "\n"
    (folder / "scan.csv").write_text(text, encoding="utf-8")
    (folder / "plan.toml").write_text(PLAN, encoding="utf-8")
    for words in (
        ("simulate-session", "plan.toml", "-o", "sessions/b1"),
        ("loop", "sessions/b1", "-o", "out/b1-loop"),
    ):
        subprocess.run([sys.executable, "-m", "stepblocks", *words], cwd=folder, check=True)


def open_chromium() -> webdriver.Chrome:
    """Start a headless Chromium."""
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or shutil.which("google-chrome") or ""
    for argument in ("headless=new", "no-sandbox", f"window-size={SIZE}"):
        options.add_argument(f"--{argument}")
    return webdriver.Chrome(options=options, service=Service(shutil.which("chromedriver")))


def take_pictures(address: str) -> None:
    """Open each page and keep its picture."""
    browser = open_chromium()
    try:
        browser.get(address)
        for name, path in PAGES.items():
            browser.get(f"{address.partition('?')[0]}{path}")
            time.sleep(WAIT)
            if name in CLICKED:
                path = f"//button[normalize-space(.)='{CLICKED[name]}']"
                browser.find_element("xpath", path).click()
                time.sleep(WAIT)
            if name in SHOWN:
                element = browser.find_element("css selector", SHOWN[name])
                browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", element)
                time.sleep(1.0)
            picture = ROOT / "docs" / "images" / f"window-{name}.png"
            browser.save_screenshot(str(picture))
            print(picture)
    finally:
        browser.quit()


def main() -> int:
    """Serve a folder, and take the pictures."""
    with tempfile.TemporaryDirectory() as base:
        folder = Path(base) / "lab"
        folder.mkdir()
        prepare(folder)
        words = [sys.executable, "-m", "stepblocks", "app", str(folder), "--no-open"]
        with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
            try:
                assert process.stdout is not None
                found = re.search(r"http://\S+", process.stdout.readline())
                assert found is not None
                take_pictures(found[0])
            finally:
                process.terminate()
    return 0


if __name__ == "__main__":
    sys.exit(main())
