"""Pictures of the window for the documentation: ``python benchmarks/window_pictures.py``.

Needs Chromium with chromedriver. Writes ``docs/images/window-*.png`` at 1280 pixels, of a folder
with the shipped stimuli of the paper and a scan with two edges.
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
PAGES = {"declare": "declare?file=paper-four.toml", "inspect": "inspect?file=scan.csv"}
WAIT = 15.0  # until what a page reads from files is there [s]
SIZE = "1280,860"


def prepare(folder: Path) -> None:
    """Put a stimulus file and a scan into the folder that is shown."""
    shutil.copy(ROOT / "stimuli" / "paper-four.toml", folder)
    rows = []
    for number in range(1000):
        rows.append(f"{2 * number},{25 * (number > 250) + 40 * (number > 750)}")
    text = "\n".join(["x_um,z_um", *rows]) + "\n"
    (folder / "scan.csv").write_text(text, encoding="utf-8")


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
            for button in browser.find_elements("xpath", "//button[normalize-space(.)='Look']"):
                button.click()
                time.sleep(WAIT)
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
