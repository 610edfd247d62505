"""A participant as a program: reads the page of a run in headless Chromium, drags over the edge,
answers; and is killed on the way.
"""

import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress

# of the browser: a laboratory's screen, and sound without a click
LOOKS = ("window-size=1000,900", "autoplay-policy=no-user-gesture-required")


@contextmanager
def running(folder, participant, *options):
    """The command ``study run`` in a process of its own, and the address of its page."""
    command = [sys.executable, "-m", "stepblocks", "study", "run", str(folder), *options]
    process = subprocess.Popen(
        [*command, "--participant", participant, "--no-open"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        said = [process.stdout.readline() for _ in range(2)]
        assert said[1].startswith("open http://127.0.0.1:"), said
        yield process, said[1].split()[1]
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGKILL)
        process.wait(20.0)
        process.stdout.close()


def wait_for(window, script, seconds=30.0):
    """Wait until a script on the page says something true, and return it."""
    from selenium.common.exceptions import JavascriptException

    end = time.monotonic() + seconds
    while time.monotonic() < end:
        # on a busy machine the page is there before its own script
        with suppress(JavascriptException):
            if found := window.execute_script(f"return {script}"):
                return found
        time.sleep(0.02)
    raise AssertionError(
        f"the page never said {script}; it says {window.find_element('tag name', 'body').text!r}"
    )


def drag(window, pixels):
    """Hold the mouse button, drag over the edge, and let go."""
    from selenium.webdriver.common.action_chains import ActionChains

    field = window.find_element("id", "field")
    wait_for(window, "state.running")
    held = (
        ActionChains(window, duration=10)
        .move_to_element_with_offset(field, -200, 0)
        .click_and_hold()
    )
    for _ in range(pixels // 20):
        held = held.move_by_offset(20, 0)
    held.perform()
    wait_for(window, "probe > 0")  # the probe has followed over the edge's place
    ActionChains(window).release().perform()


def answer(window, estimate, rating=None):
    """Answer the trial that is shown, and wait for the next."""
    shown = window.execute_script("return state.trial")
    window.find_element("name", "estimate_um").send_keys(str(estimate))
    if rating is not None:
        window.find_elements("name", "realism_rating")[rating - 1].click()
    window.find_element("id", "answer").click()
    wait_for(window, f"state.done || state.trial !== {shown!r}")
    return window.execute_script("return state.done")


def reply_by_number(trial):
    """An estimate and a rating of a trial that say nothing of its block."""
    return 10 + 5 * (trial % 7), 1 + trial % 7


def whole_run(
    window,
    folder,
    participant,
    kills,
    *options,
    pixels=560,
    reply=reply_by_number,
    closed=(),
    reopen=None,
):
    """Run all trials of a participant, the program killed in the middle of the trials `kills`, and
    the browser closed in that of others, where `reopen` returns a new one; return the trials as
    shown.
    """
    shown, waiting, closing = [], list(kills), list(closed)
    while True:
        with running(folder, participant, *options) as (process, url):
            window.get(url)
            while True:
                wait_for(window, "state && state.trial")
                window.execute_script(
                    "if (!document.getElementById('pause').hidden)"
                    " document.getElementById('goon').click()"
                )
                shown.append(int(window.execute_script("return state.trial")))
                virtual = window.execute_script("return state.virtual")
                if virtual:
                    drag(window, pixels)
                if waiting and shown[-1] == waiting[0]:
                    waiting.pop(0)
                    process.kill()
                    break
                if closing and shown[-1] == closing[0]:
                    closing.pop(0)
                    window = reopen()
                    window.get(url)
                    continue
                estimate, rating = reply(shown[-1])
                if answer(window, estimate, rating if virtual else None):
                    assert process.wait(20.0) == 0
                    return shown
