"""The page, opened from disk in a real browser without a network."""

from pathlib import Path

import pytest

from oracles.browser import browser_without_network

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with browser_without_network(
        "disable-quic",
        "no-first-run",
        "disable-background-networking",
        "disable-component-update",
        "disable-sync",
        "window-size=1300,1200",
        "enable-unsafe-swiftshader",
        "use-angle=swiftshader",
        "use-gl=angle",
        f"user-data-dir={tmp_path_factory.mktemp('profile')}",
    ) as window:
        yield window


@pytest.fixture
def page(browser, shipped_output):
    browser.get((shipped_output / "index.html").as_uri())
    return browser


def wait_for(browser, script, value):
    from selenium.webdriver.support.ui import WebDriverWait

    WebDriverWait(browser, 60).until(
        lambda driver: driver.execute_script(f"return {script}") == value
    )


def test_every_stimulus_has_its_picture_dimensions_prediction_links_and_verdict(
    page, shipped_output
):
    rows = page.find_elements("css selector", ".row")
    assert len(rows) == len(list(shipped_output.glob("*/*/record.json")))
    text = page.find_element("id", "paper-ten-step-050").text
    for words in ("50 µm ±1 µm", "checks passed", "to", "µJ", "step-050.step", "1.4112"):
        assert words in text
    broken = page.execute_script(
        "return [...document.images].filter(i => { i.loading = 'eager'; return false; }).length"
    )
    assert broken == 0
    wait_for(page, "[...document.images].every(i => i.complete && i.naturalWidth === 960)", True)
    links = [link.get_attribute("href") for link in page.find_elements("css selector", "a")]
    missing = [
        link
        for link in (
            link.partition("#")[0].removeprefix(shipped_output.as_uri() + "/") for link in links
        )
        if not (shipped_output / link).is_file()
    ]
    assert links
    assert missing == []
    # every file that was written for a part, but the data of its view, is linked or shown
    shown = [image.get_attribute("src") for image in page.find_elements("css selector", "img")]
    reached = {one.removeprefix(shipped_output.as_uri() + "/") for one in links + shown if one}
    written = {one.relative_to(shipped_output) for one in shipped_output.glob("*/*/*.*")}
    for path in written | {Path("manifest.json")}:
        assert path.as_posix() in reached or path.name.endswith(".js"), path


def test_the_curves_are_drawn_with_their_locking_limit(page):
    wait_for(
        page, "document.querySelectorAll('#figure-paper-ten .scatterlayer .trace').length > 4", True
    )
    shapes = page.execute_script(
        "return document.getElementById('figure-paper-ten').layout.shapes.length"
    )
    assert shapes == 2 * 3
    low, high = page.execute_script(
        "return document.getElementById('figure-paper-ten').layout.yaxis2.range"
    )
    assert low < high <= 4.0  # what is felt: up to 10 mJ, not the pole at the locking height


def test_the_page_opens_with_the_ten_steps_and_an_overview_of_all(page, shipped_output):
    order = page.execute_script(
        "return [...document.querySelectorAll('section')].map((one) => one.id)"
    )
    assert order[:2] == ["overview", "paper-ten"]
    lines = page.find_elements("css selector", "#overview [data-row]")
    assert len(lines) == len(list(shipped_output.glob("*/*/record.json")))
    ten = next(line.text for line in lines if line.text.startswith("step-100"))
    # mu 0.30 locks below 100 um, at each of four loads: R (1 - sin(atan 0.3)) = 89 um
    assert "4 of 12" in ten


def test_the_search_and_the_filter_find(page):
    def sieved(words, kind):
        page.execute_script(
            "for (const [name, value] of Object.entries(arguments[0])) { const one = "
            "document.getElementById(name);"
            " one.value = value; one.dispatchEvent(new Event('input')); }",
            {"search": words, "kind": kind},
        )
        shown = (
            "return [...document.querySelectorAll('.row')].filter((one) => "
            "one.offsetParent).map((one) => one.id)"
        )
        return page.execute_script(shown)

    assert sieved("step-050", "") == ["paper-ten-step-050"]
    assert sieved("zirconia chamfer", "") == ["crown-margins-crown-chamfer-over"]
    assert {one.split("-")[0] for one in sieved("", "sheath of the probe")} == {"sheaths"}
    assert sieved("no such block", "") == []
    assert len(sieved("", "")) == len(page.find_elements("css selector", ".row"))


@pytest.mark.parametrize("width", [390, 1400])
def test_nothing_overflows_on_a_narrow_or_a_wide_screen(page, width):
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    page.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    page.refresh()
    wait_for(
        page, "document.querySelectorAll('#figure-paper-ten .scatterlayer .trace').length > 4", True
    )
    wide = page.execute_script("return [document.documentElement.scrollWidth, innerWidth]")
    page.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    assert wide[0] <= wide[1] == width


def test_the_part_in_the_view_is_lit_and_no_silhouette(page):
    import io

    import numpy as np
    from PIL import Image

    button = page.find_element("css selector", '[data-script="paper-ten/step-050/view.js"]')
    page.execute_script("arguments[0].click()", button)
    wait_for(page, "document.getElementById('stage').dataset.painted", "step-050 whole")
    picture = Image.open(io.BytesIO(page.find_element("id", "stage").screenshot_as_png)).convert(
        "L"
    )
    grey = np.asarray(picture, dtype=float)
    part = grey[grey < 240.0]  # on white
    assert part.size > 0.05 * grey.size
    assert part.std() > 15.0  # an evenly grey silhouette has none
    page.find_element("id", "shut").click()


def test_the_pages_of_the_shipped_sets_are_light_enough_to_hand_on(shipped_output):
    files = [
        shipped_output / "index.html",
        *shipped_output.glob("assets/*"),
        *shipped_output.glob("*/*/view.js"),
    ]
    files += shipped_output.glob("*/*/*.png")
    assert sum(path.stat().st_size for path in files) < 10_000_000


def test_the_block_can_be_turned_and_its_step_exaggerated(page):
    button = page.find_element("css selector", '[data-script="paper-ten/step-050/view.js"]')
    page.execute_script("arguments[0].click()", button)
    painted = "document.getElementById('stage').dataset.painted"
    wait_for(page, painted, "step-050 whole")
    top = "Math.max(...document.getElementById('stage').data[0].z)"
    assert page.execute_script(f"return {top}") == pytest.approx(0.05 * 30, rel=1e-6)
    page.execute_script(
        "const s = document.getElementById('slider'); s.value = 2; s.dispatchEvent(new "
        "Event('input'));"
    )
    assert page.execute_script(f"return {top}") == pytest.approx(0.05 * 100, rel=1e-6)
    page.find_element("id", "close-up").click()
    wait_for(page, painted, "step-050 close-up")
    assert page.execute_script(f"return {top}") == pytest.approx(0.05, rel=1e-7)  # float32
    page.find_element("id", "shut").click()


def test_nothing_on_the_page_is_an_error_or_asks_for_the_network(page):
    wait_for(page, "document.querySelectorAll('#figure-paper-ten .scatterlayer').length > 0", True)
    severe = [entry for entry in page.get_log("browser") if entry["level"] == "SEVERE"]
    assert severe == []
    loaded = page.execute_script("return performance.getEntriesByType('resource').map(e => e.name)")
    assert [name for name in loaded if not name.startswith(("file:", "data:", "blob:"))] == []
