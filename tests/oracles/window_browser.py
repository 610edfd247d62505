"""A window in a real browser: the server as a user starts it, and a Chromium that opens it."""

import os
import re
import subprocess
import sys
import time
from contextlib import contextmanager

import pytest

from oracles.browser import browser

SECONDS = 600.0  # for anything to appear: a build may take minutes


@contextmanager
def serve(folder):
    """Address of a window on a folder, and the process of its server."""
    words = [sys.executable, "-m", "stepblocks", "app", str(folder), "--no-open"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        try:
            line = process.stdout.readline()
            yield re.search(r"http://\S+", line)[0], process
        finally:
            process.terminate()
            process.communicate(timeout=60)


@contextmanager
def open_browser(*arguments):
    """A headless Chromium; skipped where there is none, unless one is required."""
    with browser(*arguments) as driver:
        if driver is None and os.environ.get("STEPBLOCKS_REQUIRE_BROWSER"):
            pytest.fail("a browser is required here and there is none")
        if driver is None:
            pytest.skip("no chromium with chromedriver")
        yield driver


def wait_for(look, what):
    """Wait until a look finds something, and return it."""
    from selenium.common.exceptions import WebDriverException

    end = time.monotonic() + SECONDS
    while time.monotonic() < end:
        try:
            found = look()
        except WebDriverException:  # the page is being built anew
            found = None
        if found:
            return found
        time.sleep(0.1)
    raise AssertionError(f"{what} did not appear")


class Clicker:
    """Someone who uses a page by its visible texts alone."""

    def __init__(self, driver):
        self.driver = driver

    def see(self, text, number=1):
        """Wait for so many elements with a text, and return the whole text of the first."""
        path = f"//*[text()[contains(normalize-space(.), {quote(text)})]]"

        def look():
            shown = [element for element in self._find_all(path) if element.is_displayed()]
            return shown[0].text if len(shown) >= number else None

        return wait_for(look, text)

    def find(self, selector):
        """Wait for an element that a selector of CSS finds."""

        def look():
            found = self.driver.find_elements("css selector", selector)
            return found[0] if found else None

        return wait_for(look, selector)

    def click(self, text, number=0):
        """Click a button or a link, by its text or its name for listeners."""
        literal = quote(text)
        path = (
            f"//*[self::button or @role='button'][contains(normalize-space(.), {literal}) or "
            f"contains(@aria-label, {literal})] | //a[contains(normalize-space(.), {literal})]"
        )

        def look():
            found = [element for element in self._find_all(path) if element.is_displayed()]
            if len(found) <= number:
                return False
            self.driver.execute_script(
                "arguments[0].scrollIntoView({block: 'center'})", found[number]
            )
            found[number].click()
            return True

        wait_for(look, f"button {text}")

    def type(self, label, text):
        """Replace what a field says."""
        from selenium.webdriver.common.keys import Keys

        def look():
            field = self._find_shown(f"//input[@aria-label={quote(label)}]")
            if field is None:
                return False
            field.send_keys(Keys.CONTROL, "a")
            field.send_keys(Keys.DELETE, text, Keys.TAB)
            return True

        wait_for(look, f"field {label}")

    def see_field(self, label, text):
        """Wait until a field says a text."""

        def look():
            field = self._find_shown(f"//input[@aria-label={quote(label)}]")
            return field is not None and field.get_property("value") == text

        wait_for(look, f"{text!r} in field {label}")

    def choose(self, label, option):
        """Choose an option of a list."""

        def open_list():
            field = self._find_shown(f"//*[@aria-label={quote(label)} and @role='combobox']")
            if field is None:
                return False
            field.click()
            return True

        wait_for(open_list, f"list {label}")
        path = f"//*[@role='option'][contains(normalize-space(.), {quote(option)})]"

        def click_option():
            found = self._find_shown(path)
            if found is None:
                return False
            found.click()
            return True

        wait_for(click_option, f"option {option}")

    def drop(self, path):
        """Hand a file to the first field for files."""

        def look():
            fields = self._find_all("//input[@type='file']")
            if not fields:
                return False
            fields[0].send_keys(str(path))
            return True

        wait_for(look, "field for files")

    def _find_all(self, path):
        return self.driver.find_elements("xpath", path)

    def _find_shown(self, path):
        for element in self._find_all(path):
            if element.is_displayed():
                return element
        return None


def quote(text):
    """Write a text as a literal of XPath."""
    return f'"{text}"' if '"' not in text else f"'{text}'"
