"""Promise to five users: from an empty folder, with the commands of docs/first-hour.md and nothing
else, each gets what they came for.

The pages are opened in a real browser: links lead somewhere, nothing overflows, no error, no
request leaves.
"""

import json
import re
import runpy
import shlex
from pathlib import Path

import numpy as np
import pytest

from oracles.browser import browser_without_network
from oracles.softgauge import correlated_noise, edge_gauge
from stepblocks.cli import main

DOCS = Path(__file__).resolve().parents[1] / "docs"
PAGE = DOCS / "first-hour.md"
HOOKS = runpy.run_path(str(DOCS / "generated_pages.py"))


def path_of(user):
    """The files and commands that the tutorial gives a user, in its order."""
    text = PAGE.read_text(encoding="utf-8").split(f"\n## {user}\n")[1].split("\n## ")[0]
    for language, body in re.findall(r"^```(\w*)\n(.*?)^```", text, re.M | re.S):
        if language == "toml":
            name = body.splitlines()[0].removeprefix("# ").strip()
            yield "file", (name, body)
        elif language == "":
            yield from (
                ("command", line) for line in body.replace("\\\n", " ").splitlines() if line.strip()
            )


def walk(user, folder, monkeypatch):
    """Do what the tutorial says, from an empty folder."""
    monkeypatch.chdir(folder)
    for kind, what in path_of(user):
        if kind == "file":
            (folder / what[0]).write_text(what[1])
            continue
        program, *words = shlex.split(what.split("  #")[0])
        assert program == "stepblocks"
        wanted = 1 if "# exit code 1" in what else 0
        assert (
            main(
                [
                    *words,
                    *(["--no-open"] if words[0] == "feel" and "--no-open" not in words else []),
                ]
            )
            == wanted
        ), what
    assert_columns_are_described(folder)


def assert_columns_are_described(folder):
    """Hold every table that a walk wrote to the page of files and columns."""
    files = HOOKS["column_files"]()
    described = [set(file["columns"]) for file in files]
    for path in sorted(folder.rglob("*.csv")):
        if "traces" in path.parts:  # the columns are those that session.toml declares
            continue
        columns = path.read_text(encoding="utf-8").splitlines()[0].split(",")
        plain = {
            name if any(name in one for one in described) else HOOKS["column_base"](name)[0]
            for name in columns
        }
        nearest = min((plain - one for one in described), key=len)
        assert nearest == set(), f"{path.name} has columns that no page describes"


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    profile = tmp_path_factory.mktemp("profile")
    drawn_by = ("enable-unsafe-swiftshader", "use-angle=swiftshader", "use-gl=angle")
    with browser_without_network(*drawn_by, f"user-data-dir={profile}") as window:
        yield window


def look_at(browser, page):
    """Open a page on a narrow and a wide screen and check what every page promises."""
    for width in (390, 1400):
        size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        browser.get(page.as_uri())
        wide = browser.execute_script("return document.documentElement.scrollWidth")
        assert wide <= width, f"{page.name} is {wide} wide on {width}"
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []
    loaded = browser.execute_script(
        "return performance.getEntriesByType('resource').map(e => e.name)"
    )
    assert [name for name in loaded if not name.startswith(("file:", "data:", "blob:"))] == []
    links = browser.execute_script(
        "return [...document.querySelectorAll('a[href]')].map(a => a.getAttribute('href'))"
    )
    for link in links:
        if link.startswith("#"):
            assert browser.execute_script(
                "return document.getElementById(arguments[0]) !== null", link[1:]
            ), link
        elif "://" not in link:
            assert (page.parent / link.partition("#")[0]).exists(), link
    return browser.find_element("tag name", "body").text


@pytest.mark.long
@pytest.mark.browser
def test_the_machinist_gets_a_drawing_a_sheet_and_a_verdict(tmp_path, monkeypatch, browser):
    walk("The machinist", tmp_path, monkeypatch)
    part = tmp_path / "out" / "mine" / "step-013"
    assert {"step-013.step", "step-013.drawing.pdf", "step-013.inspection-sheet.html"} <= {
        one.name for one in part.iterdir()
    }
    text = look_at(browser, tmp_path / "out" / "index.html")
    assert "13 µm ±1 µm" in text
    assert "drawing" in text


@pytest.mark.browser
def test_the_simulator_programmer_gets_scenes_and_feels_the_block(tmp_path, monkeypatch, browser):
    walk("The simulator programmer", tmp_path, monkeypatch)
    scene = tmp_path / "out" / "scenes" / "mine" / "step-050"
    assert (scene / "mujoco" / "scene.xml").is_file()
    assert "step-050" in look_at(browser, tmp_path / "out" / "feel.html")


@pytest.mark.browser
def test_the_metrologist_reads_what_is_felt_with_its_uncertainty(tmp_path, monkeypatch):
    walk("The metrologist", tmp_path, monkeypatch)
    rows = (tmp_path / "predictions.csv").read_text().splitlines()
    assert "vibration_energy_95_low_uj" in rows[0]
    assert (tmp_path / "out" / "index.html").is_file()


@pytest.mark.long
@pytest.mark.browser
def test_the_page_of_an_inspection_opens_with_its_finding_and_shows_every_budget(tmp_path, browser):
    x = np.arange(-800, 800) * 0.5e-6
    z = edge_gauge(x, 50.2e-6, 14e-6, tilt=5e-4)
    z = z + correlated_noise(len(x), 0.5e-6, 10e-9, 40e-9, 2e-6, np.random.default_rng(1))
    scan, stimuli = tmp_path / "a.csv", str(Path(__file__).parents[1] / "stimuli")
    np.savetxt(
        scan,
        np.stack([x, z], axis=1) * 1e6,
        delimiter=",",
        header="x_um,z_um",
        comments="",
        fmt="%.4f",
    )
    asked = [
        "--stimulus",
        "step-050",
        "--set",
        stimuli,
        "--calibration",
        "0.1 %",
        "--stylus-radius",
        "0 um",
        "-o",
        str(tmp_path / "out"),
    ]
    assert main(["inspect", str(scan), *asked]) == 1  # an edge of 14 um is not what was asked for
    text = look_at(browser, tmp_path / "out" / "step-050.inspection.html")
    assert "Inspection of step-050: does not conform" in text
    assert "lowers E_v by" in text
    assert "lateral calibration" in text


@pytest.mark.long
@pytest.mark.browser
def test_the_psychophysicist_gets_run_sheets_and_a_report(tmp_path, monkeypatch, browser):
    walk("The psychophysicist", tmp_path, monkeypatch)
    assert (tmp_path / "people" / "run-sheets.html").stat().st_size > 1000
    assert "judgements" in look_at(browser, tmp_path / "people" / "report" / "report.html")


@pytest.mark.long
@pytest.mark.browser
def test_the_bench_gets_features_and_what_its_model_lacks(tmp_path, monkeypatch, browser):
    walk("The bench", tmp_path, monkeypatch)
    result = json.loads((tmp_path / "out" / "loop" / "result.json").read_text())
    assert result["verdict"] in {"none", "effect", "ambiguous", "unexplained"}
    assert "Verdict" in look_at(browser, tmp_path / "out" / "loop" / "report.html")
    assert len(browser.find_elements("css selector", "nav a[href^='#']")) >= 8
    folded = browser.find_elements("css selector", "details:not([open]) img")
    assert folded
    assert all("residual" in one.get_attribute("alt") for one in folded)
