"""The page to feel runs its own script and nothing else, and asks nothing of anybody.

It is a file, so there is no server of ours whose Host, Origin, size or rate could be checked: what
its policy forbids is tried from within the page, against a server that counts what reaches it.
"""

import http.server
import re
import threading
import time
from pathlib import Path

import pytest

from oracles.browser import browser
from stepblocks.simulators.feel import write_feel_page

FOUR = Path(__file__).resolve().parents[2] / "stimuli" / "paper-four.toml"
# what a page that was tampered with could try, and the rule of the policy that forbids it
ATTEMPTS = {
    "fetch": ("fetch(THERE).catch(() => 0)", "connect-src"),
    "post": (
        "fetch(THERE, {method: 'POST', body: 'x', mode: 'no-cors'}).catch(() => 0)",
        "connect",
    ),
    "XMLHttpRequest": ("const x = new XMLHttpRequest(); x.open('GET', THERE); x.send()", "connect"),
    "beacon": ("navigator.sendBeacon(THERE, 'x')", "connect-src"),
    "EventSource": ("new EventSource(THERE)", "connect-src"),
    "WebSocket": ("new WebSocket(THERE.replace('http', 'ws'))", "connect-src"),
    "image": ("new Image().src = THERE", "img-src"),
    "sound": ("new Audio(THERE).load()", "media-src"),
    "font": ("new FontFace('x', `url(${THERE})`).load().catch(() => 0)", "font-src"),
    "style sheet": ("add('link', {rel: 'stylesheet', href: THERE})", "style-src"),
    "picture of a style": ("document.body.style.background = `url(${THERE})`", "img-src"),
    "frame": ("add('iframe', {src: THERE})", "frame-src"),
    "object": ("add('object', {data: THERE})", "object-src"),
    "worker": ("new Worker(URL.createObjectURL(new Blob(['']))).onerror = () => 0", "worker-src"),
    "script from there": ("add('script', {src: THERE})", "script-src"),
    "script of another": ("add('script', {textContent: 'window.taken = true'})", "script-src"),
    "handler": ("add('button', {}).setAttribute('onclick', 'window.taken = true')", "script-src"),
    # later, since a debugger's own script may evaluate what it likes
    "eval": (
        "setTimeout(() => { try { eval('window.taken = true') } catch (refused) {} })",
        "script-src",
    ),
    "form": ("add('form', {action: THERE, method: 'POST'}).submit()", "form-action"),
    "base": ("add('base', {href: THERE})", "base-uri"),
}
# tries something, and waits until the policy says that it was broken
TRY = """
const done = arguments[arguments.length - 1], THERE = arguments[0], broken = [];
const add = (tag, given) => document.body.appendChild(
  Object.assign(document.createElement(tag), given));
window.taken = false;
document.addEventListener("securitypolicyviolation", (e) => {
  broken.push(e.effectiveDirective); setTimeout(() => done([broken, window.taken])); });
ATTEMPT;
"""


@pytest.fixture(scope="module")
def there():
    """A server that answers everything, and what it was asked."""
    asked = []

    class Counting(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            asked.append(f"{self.command} {self.path}")
            self.send_response(200)
            self.send_header("Access-Control-Allow-Origin", "*")
            self.send_header("Content-Length", "0")
            self.end_headers()

        do_POST = do_OPTIONS = do_GET  # noqa: N815 - names of the library

        def log_message(self, *words):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Counting)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_address[1]}/", asked
    server.shutdown()
    server.server_close()


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
