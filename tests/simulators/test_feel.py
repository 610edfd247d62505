"""The page on which a step is felt, in a real browser without a network."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

from oracles.browser import browser_without_network
from stepblocks.cli import main
from stepblocks.declare import load_set
from stepblocks.simulators.feel import feel

ROOT = Path(__file__).resolve().parents[2]
R = 125e-6
DRAG = Path(__file__).with_name("drag_across.js").read_text()


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    path = tmp_path_factory.mktemp("feel") / "my page.html"
    assert (
        main(["feel", str(ROOT / "stimuli" / "paper-ten.toml"), "-o", str(path), "--no-open"]) == 0
    )
    return path


def test_the_page_is_one_file_that_loads_nothing(page):
    text = page.read_text()
    assert "http" not in text
    assert "src=" not in text
    assert len(text) < 300_000


def test_a_set_without_blocks_is_refused_in_one_line(tmp_path, capsys):
    tips = str(ROOT / "stimuli" / "probe-tips.toml")
    assert main(["feel", tips, "-o", str(tmp_path / "x.html"), "--no-open"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def blocks_of(page):
    """What the page knows of its blocks."""
    return json.loads(page.read_text().split("const BLOCKS = ")[1].split(";\n")[0])


def test_a_notebook_writes_the_page_of_one_file(tmp_path):
    count = feel(str(ROOT / "stimuli" / "crown-margins.toml"), str(tmp_path / "new" / "x.html"))
    straight = [
        s
        for s in load_set(ROOT / "stimuli" / "crown-margins.toml").stimuli
        if s.turn_radius is None
    ]
    assert [block["name"] for block in blocks_of(tmp_path / "new" / "x.html")] == [
        s.id for s in straight
    ]
    assert count == len(straight)


@pytest.mark.parametrize("name", ["paper-ten", "crown-margins"])
def test_the_thinned_path_keeps_every_notch_and_the_angle_of_the_formula(name, tmp_path):
    feel([ROOT / "stimuli" / f"{name}.toml"], tmp_path / "x.html")
    stimuli = load_set(ROOT / "stimuli" / f"{name}.toml")
    parts, radius = {part.id: part for part in stimuli.stimuli}, stimuli.prediction.tip_radii[0]
    for block in blocks_of(tmp_path / "x.html"):
        path = parts[block["name"]].counterface().centre_path(radius)
        assert block["angle"] == path.find_notch(+1.0)[2]
        for direction, side in ((1.0, "up"), (-1.0, "down")):
            x, _, angle = path.find_notch(direction)
            if angle > 0.0:
                notch = next(n for n in block["notches"] if n[side])
                assert notch["x"] == x
                piece = block["x"].index(x)
                slope = block["first"][piece] if direction > 0.0 else -block["last"][piece - 1]
                assert slope == pytest.approx(
                    min(math.tan(angle), 1e9), rel=1e-9
                )  # at a wall: steeper than any tip climbs
        # chords of d = 1.5 degrees lie R d^2 / 8 = 11 nm below the circle, measured square to it
        off = np.abs(np.interp(path.x, block["x"], block["z"]) - path.z)[1:-1]
        steepest = np.maximum(np.abs(path.slope_end[:-1]), np.abs(path.slope_start[1:]))
        assert (off <= radius * math.radians(1.5) ** 2 / 8.0 * np.hypot(1.0, steepest)).all()


def test_the_profile_that_is_drawn_is_the_parts_own(tmp_path):
    feel([ROOT / "stimuli" / "paper-ten.toml"], tmp_path / "x.html")
    for number, block in enumerate(blocks_of(tmp_path / "x.html"), start=1):
        x, z = np.array(block["profile"]).T
        assert (np.diff(x) > 0.0).all()
        assert sorted(set(z)) == pytest.approx([0.0, number * 10e-6])


@pytest.fixture(scope="module")
def browser(page, tmp_path_factory):
    profile = tmp_path_factory.mktemp("profile")
    with browser_without_network(
        "disable-background-networking", "window-size=1200,1100", f"user-data-dir={profile}"
    ) as window:
        window.get(page.as_uri())
        yield window


@pytest.mark.browser
def test_the_pages_own_renderer_follows_the_formula_and_locks(browser):
    for index in range(10):
        height = (index + 1) * 10e-6
        force = math.tan(math.acos(1 - height / R) + math.atan(0.15))
        found = browser.execute_script(f"{DRAG}\nreturn dragAcross({index}, 1.0, 0.15)")
        assert found["peak"] == pytest.approx(force, rel=5e-3)
        assert found["events"] == 1
    locked = browser.execute_script(f"{DRAG}\nreturn dragAcross(9, 1.0, 0.3)")
    assert (locked["events"], locked["formula"]) == (0, None)


@pytest.mark.browser
def test_a_mouse_drags_the_probe_over_the_edge(browser):
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.support.ui import WebDriverWait

    browser.execute_script("document.getElementById('block').value = 0; choose('block')")
    scene = browser.find_element("id", "scene")
    ActionChains(browser).move_to_element_with_offset(scene, -200, 0).click_and_hold().perform()
    for _ in range(15):
        ActionChains(browser).move_by_offset(30, 0).perform()
    ActionChains(browser).release().perform()
    WebDriverWait(browser, 30).until(
        lambda window: "last release at 0.6" in window.find_element("id", "state").text
    )
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []


@pytest.mark.browser
def test_the_hand_reaches_the_release_of_every_block_and_the_middle_is_to_scale(browser):
    reached = browser.execute_script(
        "return BLOCKS.map((_, i) => { document.getElementById('block').value = i; choose('block');"
        " return K * (toHand(1) - block.trigger); })"
    )
    # equations (1) and (2) at 1 N and mu 0.15, the sliders' first values
    needed = [
        math.tan(math.acos(1 - height * 1e-5 / R) + math.atan(0.15)) for height in range(1, 11)
    ]
    assert all(have > need for have, need in zip(reached, needed, strict=True))
    assert browser.execute_script("return toHand(0.25)") == pytest.approx(0.25 * 0.5 * 12 * R)


@pytest.mark.browser
def test_the_arrow_keys_drag_and_the_last_release_stands_with_its_energy(browser):
    from selenium.webdriver.common.keys import Keys
    from selenium.webdriver.support.ui import WebDriverWait

    browser.execute_script("document.getElementById('block').value = 4; choose('block')")
    scene = browser.find_element("id", "scene")
    for _ in range(40):
        scene.send_keys(Keys.ARROW_RIGHT)
    # E_v of 50 um at 1 N and mu 0.15: 35.0 uJ (the facts of the paper's equations)
    told = r"last release at 1\.8[45]\d N, E_v 3[45]\.\d µJ"
    WebDriverWait(browser, 30).until(
        lambda window: re.search(told, window.find_element("id", "state").text)
    )
    WebDriverWait(browser, 30).until(lambda window: window.execute_script("return kept !== null"))
    force = browser.execute_script("return Array.from(kept.force)")
    assert np.argmax(np.abs(force)) == pytest.approx(
        0.02 * 10_000, abs=30
    )  # the release stands 20 ms from the left


@pytest.mark.browser
def test_blind_neither_shows_nor_says_what_is_felt_and_keeps_the_score(browser):
    browser.execute_script("document.getElementById('blind').click()")
    assert browser.find_element("id", "state").text.startswith(
        "Feel A and B"
    ) or browser.execute_script(
        "return new Promise(done => setTimeout(() => done($('state').textContent), 300))"
    ).startswith("Feel A and B")
    higher = browser.execute_script(
        "return answer.map(i => Math.max(...BLOCKS[i].profile.map(point => "
        "point[1]))).reduce((a, "
        "b) => a > b ? 0 : 1)"
    )
    browser.find_element("id", "say-a" if higher == 0 else "say-b").click()
    assert browser.find_element("id", "score").text.startswith("1 of 1 right; A was step-")
    browser.execute_script("document.getElementById('blind').click()")


@pytest.mark.parametrize("width", [390, 1400])
@pytest.mark.browser
def test_the_page_to_feel_fits_every_screen(browser, width):
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    wide = browser.execute_script("return [document.documentElement.scrollWidth, innerWidth]")
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    assert wide[0] <= wide[1] == width


def test_the_page_begins_with_the_block_of_50_um_and_has_its_suffix(tmp_path):
    assert (
        main(
            [
                "feel",
                str(ROOT / "stimuli" / "paper-ten.toml"),
                "-o",
                str(tmp_path / "mine"),
                "--no-open",
            ]
        )
        == 0
    )
    assert '<option value="4" selected>step-050</option>' in (tmp_path / "mine.html").read_text()
