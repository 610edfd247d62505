"""The page, opened from disk in a real browser without a network."""

import os
import shutil

import pytest

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    chromium, driver = shutil.which("chromium") or shutil.which("google-chrome"), shutil.which("chromedriver")
    if not (chromium and driver):
        if os.environ.get("STEPBLOCKS_REQUIRE_BROWSER"):
            pytest.fail("a browser is required here and there is none")
        pytest.skip("no chromium with chromedriver")
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    profile = tmp_path_factory.mktemp("profile")
    for argument in (
        "headless",
        "no-sandbox",
        "disable-quic",
        "no-first-run",
        "disable-background-networking",
        "disable-component-update",
        "disable-sync",
        "window-size=1300,1200",
        "enable-unsafe-swiftshader",
        "use-angle=swiftshader",
        "use-gl=angle",
        f"user-data-dir={profile}",
    ):
        options.add_argument(f"--{argument}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=Service(driver))
    driver.set_network_conditions(offline=True, latency=0, throughput=1)
    yield driver
    driver.quit()


@pytest.fixture
def page(browser, shipped_output):
    browser.get((shipped_output / "index.html").as_uri())
    return browser


def wait_for(browser, script, value):
    from selenium.webdriver.support.ui import WebDriverWait

    WebDriverWait(browser, 60).until(lambda driver: driver.execute_script(f"return {script}") == value)


def test_every_stimulus_has_its_picture_dimensions_prediction_links_and_verdict(page, shipped_output):
    rows = page.find_elements("css selector", ".row")
    assert len(rows) == len(list(shipped_output.glob("*/*/record.json")))
    text = page.find_element("id", "paper-ten-step-050").text
    for words in ("50 um ±1 um", "checks passed", "to", "uJ", "step-050.step"):
        assert words in text
    broken = page.execute_script(
        "return [...document.images].filter(i => { i.loading = 'eager'; return false; }).length"
    )
    assert broken == 0
    wait_for(page, "[...document.images].every(i => i.complete && i.naturalWidth === 960)", True)
    links = [link.get_attribute("href") for link in page.find_elements("css selector", "a")]
    missing = [
        link for link in links if not (shipped_output / link.removeprefix(shipped_output.as_uri() + "/")).is_file()
    ]
    assert links
    assert missing == []


def test_the_curves_are_drawn_with_their_locking_limit(page):
    wait_for(page, "document.querySelectorAll('#figure-paper-ten .scatterlayer .trace').length > 4", True)
    shapes = page.execute_script("return document.getElementById('figure-paper-ten').layout.shapes.length")
    assert shapes == 2 * 3


def test_the_block_can_be_turned_and_its_step_exaggerated(page):
    button = page.find_element("css selector", '[data-script="paper-ten/step-050/view.js"]')
    page.execute_script("arguments[0].click()", button)
    painted = "document.getElementById('stage').dataset.painted"
    wait_for(page, painted, "step-050 whole")
    top = "Math.max(...document.getElementById('stage').data[0].z)"
    assert page.execute_script(f"return {top}") == pytest.approx(0.05 * 30, rel=1e-6)
    page.execute_script(
        "const s = document.getElementById('slider'); s.value = 2; s.dispatchEvent(new Event('input'));"
    )
    assert page.execute_script(f"return {top}") == pytest.approx(0.05 * 100, rel=1e-6)
    page.find_element("id", "close-up").click()
    wait_for(page, painted, "step-050 close-up")
    assert page.execute_script(f"return {top}") == pytest.approx(0.05, rel=1e-9)
    page.find_element("id", "shut").click()


def test_nothing_on_the_page_is_an_error_or_asks_for_the_network(page):
    wait_for(page, "document.querySelectorAll('#figure-paper-ten .scatterlayer').length > 0", True)
    severe = [entry for entry in page.get_log("browser") if entry["level"] == "SEVERE"]
    assert severe == []
    loaded = page.execute_script("return performance.getEntriesByType('resource').map(e => e.name)")
    assert [name for name in loaded if not name.startswith(("file:", "data:", "blob:"))] == []
