"""A headless Chromium, as the tests of our pages open it."""

import os
import shutil
from contextlib import contextmanager

import pytest


@contextmanager
def browser(*arguments, offline=False):
    """A headless Chromium with further arguments that keeps what its console says, or None where
    there is none.
    """
    chromium, driver = (
        shutil.which("chromium") or shutil.which("google-chrome"),
        shutil.which("chromedriver"),
    )
    if not (chromium and driver):
        yield None
        return
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for argument in ("headless=new", "no-sandbox", *arguments):
        options.add_argument(f"--{argument}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    window = webdriver.Chrome(options=options, service=Service(driver))
    try:
        if offline:
            window.set_network_conditions(offline=True, latency=0, throughput=1)
        yield window
    finally:
        window.quit()


@contextmanager
def browser_without_network(*arguments):
    """The same without a network; the test is skipped where there is none, or fails where one is
    required.
    """
    with browser(*arguments, offline=True) as window:
        if window is None and os.environ.get("STEPBLOCKS_REQUIRE_BROWSER"):
            pytest.fail("a browser is required here and there is none")
        if window is None:
            pytest.skip("no chromium with chromedriver")
        yield window
