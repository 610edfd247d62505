"""The page to feel runs its own script and nothing else, and asks nothing of anybody.

It is a file, so there is no server of ours whose Host, Origin, size or rate could be checked: what
its policy forbids is tried from within the page, against a server that counts what reaches it.
"""

import re
import time
from pathlib import Path

import pytest

from oracles.browser import browser
from oracles.page_policy import ATTEMPTS, TRY, counting_server
from stepblocks.haptics.feel_page import write_feel_page

FOUR = Path(__file__).resolve().parents[2] / "stimuli" / "paper-four.toml"


@pytest.fixture(scope="module")
def there():
    with counting_server() as found:
        yield found


@pytest.fixture(scope="module")
def window(tmp_path_factory):
    with browser(f"user-data-dir={tmp_path_factory.mktemp('profile')}") as found:
        if found is None:
            pytest.skip("no chromium with chromedriver")
        found.set_script_timeout(60)
        yield found


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    path = tmp_path_factory.mktemp("feel") / "page.html"
    write_feel_page(FOUR, path)
    return path


@pytest.mark.browser
@pytest.mark.parametrize("name", ATTEMPTS)
def test_what_breaks_a_rule_of_the_page_s_policy_is_stopped_and_reaches_nobody(
    name, page, there, window
):
    attempt, rule = ATTEMPTS[name]
    place, asked = there
    asked.clear()
    window.get(page.as_uri())
    broken, taken = window.execute_async_script(TRY.replace("ATTEMPT", attempt), place)
    assert broken[0].startswith(rule)
    assert not taken
    assert asked == []
    assert window.current_url == page.as_uri()


@pytest.mark.browser
@pytest.mark.parametrize(
    "name", ["fetch", "image", "style sheet", "frame", "script from there", "form"]
)
def test_without_the_policy_the_same_attempt_arrives(name, page, there, window, tmp_path):
    """So what reaches nobody above was held by the policy, not by the test."""
    place, asked = there
    asked.clear()
    bare = tmp_path / "bare.html"
    bare.write_text(re.sub(r"<meta http-equiv=[^>]*>", "", page.read_text(), count=1))
    window.get(bare.as_uri())
    attempt = TRY.replace("ATTEMPT", ATTEMPTS[name][0])
    window.execute_script(attempt, place, None)
    for _ in range(600):
        if asked:
            break
        time.sleep(0.05)
    assert asked


@pytest.mark.browser
def test_the_place_of_a_file_is_shown_and_never_run(window, tmp_path):
    """A set has a plain name, but its folders may be called anything, `</script>` included."""
    file = tmp_path / "<" / "script><img src=x onerror=taken=1><script>" / FOUR.name
    file.parent.mkdir(parents=True)
    file.write_bytes(FOUR.read_bytes())
    write_feel_page(file, tmp_path / "page.html")
    window.get((tmp_path / "page.html").as_uri())
    found = window.execute_script(
        "return [document.images.length, document.scripts.length, window.taken ?? null,"
        " STIMULI[0].file]"
    )
    assert found == [0, 2, None, str(file)]  # two scripts: the stimuli as data, and the page's own
