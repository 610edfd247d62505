"""The page on which a step is felt, in a real browser without a network."""

import base64
import hashlib
import html
import json
import math
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from oracles.browser import browser_without_network
from oracles.shipped import load_shipped
from stepblocks.cli import main
from stepblocks.contact.energy import Status
from stepblocks.contact.event import list_vibration_events
from stepblocks.declaration.set import choose_operating_point
from stepblocks.haptics.feel_page import write_feel_page

ROOT = Path(__file__).resolve().parents[2]
R = 125e-6
DRAG = (ROOT / "tests" / "oracles" / "drag_across.js").read_text()


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    path = tmp_path_factory.mktemp("feel") / "my page.html"
    assert (
        main(["feel", str(ROOT / "stimuli" / "paper-ten.toml"), "-o", str(path), "--no-open"]) == 0
    )
    return path


def test_the_page_is_one_file_that_loads_nothing(page):
    text = page.read_text()
    assert "http:" not in text
    assert "https:" not in text
    assert "src=" not in text
    assert len(text) < 300_000


def stimuli_of(page):
    """What the page knows of its stimuli."""
    text = page.read_text().split('<script id="stimuli" type="application/json">')[1]
    return json.loads(text.split("</script>")[0])


def test_every_stimulus_has_the_tip_load_friction_tool_and_limits_of_its_own_file(tmp_path):
    """All shipped sets on one page: none takes over the conditions of another, none is left out."""
    write_feel_page(ROOT / "stimuli", tmp_path / "x.html")
    found = {(one["set"], one["name"]): one for one in stimuli_of(tmp_path / "x.html")}
    for name in ("paper-ten", "paper-four", "crown-margins", "probe-tips", "sheaths"):
        stimuli = load_shipped(name)
        grid = stimuli.prediction
        for part in stimuli.stimuli:
            one = found.pop((name, part.id))
            ball = grid.tip_radii[0] if part.ball is None else part.ball.nominal
            assert (one["radius"], one["load"], one["friction"]) == (
                ball,
                grid.normal_loads[0],
                grid.frictions[0],
            )
            ring = stimuli.predict_ring(part) or grid.tool
            assert (one["frequency"], one["decay"]) == (ring.frequency, ring.decay_time)
            assert (one["limit"], one["limiter"]) == (9.87, "a hand pulls")
            assert len(one["variants"]) == (1 if part.crossed else len(grid.step_heights))
    assert not found


def test_a_notebook_writes_the_page_of_a_set_of_its_own(tmp_path):
    stimuli = load_shipped("crown-margins")
    assert (
        write_feel_page(stimuli.with_parts(stimuli.stimuli[-3:]), tmp_path / "new" / "x.html") == 3
    )
    names = [one["name"] for one in stimuli_of(tmp_path / "new" / "x.html")]
    assert names == [part.id for part in stimuli.stimuli[-3:]]


def test_the_profile_that_is_drawn_is_the_parts_own(tmp_path):
    write_feel_page([ROOT / "stimuli" / "paper-ten.toml"], tmp_path / "x.html")
    for number, one in enumerate(stimuli_of(tmp_path / "x.html"), start=1):
        x, z = np.array(one["variants"][0]["profile"]).T
        assert (np.diff(x) > 0.0).all()
        assert sorted(set(z)) == pytest.approx([0.0, number * 10e-6])


def test_the_page_allows_no_network_and_no_script_but_its_own(page):
    """The policy stands before the scripts; its hash is that of the text between their tags."""
    text = page.read_text()
    policy = re.search(r'Content-Security-Policy"\s+content="([^"]*)"', text)[1]
    script = text.split("<script>")[1].split("</script>")[0]
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    rules = dict(rule.strip().split(" ", 1) for rule in html.unescape(policy).split(";"))
    assert rules["default-src"] == "'none'"
    assert rules["script-src"] == f"'sha256-{digest}'"
    assert rules["base-uri"] == rules["form-action"] == "'none'"
    assert text.index("Content-Security-Policy") < text.index("<script")
    assert text.count("<script>") == 1


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
        changes = {"load": 1.0, "friction": 0.15, "limit": 1e3}
        found = browser.execute_script(f"{DRAG}\nreturn dragAcross({index}, {json.dumps(changes)})")
        assert found["peak"] == pytest.approx(force, rel=5e-3)
        assert found["events"] == 1
    locked = browser.execute_script(f"{DRAG}\nreturn dragAcross(9, {{friction: 0.3}})")
    assert (locked["events"], locked["status"], locked["formula"]) == (0, "locked", None)


@pytest.mark.long
@pytest.mark.browser
def test_each_stimulus_of_all_sets_slips_at_the_force_of_its_own_file(whole):
    """Paper blocks under R 125 um and 0.3 N, not the first file's 60 um; expected: the events."""
    stimuli = whole.execute_script("return STIMULI.map(one => [one.set, one.name])")
    for name in ("paper-ten", "crown-margins"):
        declared = load_shipped(name)
        for part in declared.stimuli:
            point = choose_operating_point(declared, part, {})
            event = list_vibration_events(part.counterface(), point, part.id)[0]
            index = stimuli.index([name, part.id])
            found = whole.execute_script(f"{DRAG}\nreturn dragAcross({index})")
            if event.status is Status.RELEASES:
                assert found["peak"] == pytest.approx(event.critical_force, rel=5e-3)
                assert found["events"] == 1
            else:
                assert found["events"] == 0
                assert found["status"] == event.status.value.split("-hand")[0]


@pytest.mark.repeats
@pytest.mark.parametrize(
    ("load", "friction", "tip"), [(0.12, 0.155, 62.5), (0.013, 0.72, 17.2634), (2.6, 0.0, 125.0)]
)
@pytest.mark.browser
def test_conditions_between_and_beyond_the_marks_of_the_sliders_act_as_declared(
    browser, page, tmp_path, load, friction, tip
):
    """Equations (1) and (2) with 0.12 N and not 0.1 N, whatever a slider can stand at."""
    text = (ROOT / "stimuli" / "paper-ten.toml").read_text()
    for old, new in (
        ('set = "paper-ten"', 'set = "own"'),
        (r'tip_radii = \["125 um"\]', f'tip_radii = ["{tip} um"]'),
        (r"normal_loads = \[[^]]*\]", f'normal_loads = ["{load} N"]'),
        (r"frictions = \[[^]]*\]", f"frictions = [{friction}]"),
        ('from = "10 um", to = "100 um", step = "10 um"', 'values = ["1 um", "2 um"]'),
    ):
        text, count = re.subn(old, new, text)
        assert count == 1
    (tmp_path / "own.toml").write_text(text)
    write_feel_page(tmp_path / "own.toml", tmp_path / "own.html")
    browser.get((tmp_path / "own.html").as_uri())
    try:
        expected = load * math.tan(math.acos(1 - 2 / tip) + math.atan(friction))
        found = browser.execute_script(
            DRAG + "\n$('block').value = 1; choose('block'); retune();"
            "return [dragAcross(1, {...tool, radius: radius()}),"
            " tool.load, tool.friction, radius(), $('load-text').textContent]"
        )
        assert found[1:4] == pytest.approx([load, friction, tip * 1e-6], rel=1e-6)
        assert float(found[4].split()[0]) == pytest.approx(load)
        assert found[0]["formula"] == pytest.approx(expected, rel=1e-6)
        assert found[0]["peak"] == pytest.approx(expected, rel=5e-3)
        # a slider that a hand then moves stands at thousandths
        assert browser.execute_script(
            "$('load').value = 0.73449; $('load').dispatchEvent(new Event('input'));"
            "return [tool.load, $('load-text').textContent]"
        ) == [0.734, "0.734 N"]
        from selenium.webdriver.common.keys import Keys

        slider = browser.find_element("id", "friction")
        seen = [browser.execute_script("return tool.friction")]
        for key in [Keys.ARROW_RIGHT] * 4 + [Keys.ARROW_LEFT] * 4:
            slider.send_keys(key)
            seen.append(browser.execute_script("return tool.friction"))
        ways = np.sign(np.diff(seen))
        if friction < 0.5:  # else it stands at its end
            assert list(ways) == [1] * 4 + [-1] * 4
    finally:
        browser.get(page.as_uri())


@pytest.mark.browser
def test_beyond_the_hand_the_tip_does_not_slip_and_the_page_says_so(browser):
    """Step of 100 um at 1 N and mu 0.15: 19 N, a hand pulls 9.87 N at most."""
    found = browser.execute_script(f"{DRAG}\nreturn dragAcross(9, {{load: 1.0}})")
    assert (found["status"], found["events"]) == ("beyond", 0)
    assert found["peak"] == pytest.approx(9.87)
    said = browser.execute_script(
        "$('block').value = 9; choose('block'); $('load').value = 1; retune(); describe();"
        "return $('state').textContent"
    )
    assert "slips at 19.04" in said
    assert "beyond what a hand pulls (9.87 N): it does not slip" in said


@pytest.mark.browser
@pytest.mark.parametrize(("typed", "taken"), [("-5", 1.0), ("0", 1.0), ("1e9", 1000.0), ("", 125)])
def test_a_tip_that_cannot_be_is_the_nearest_that_can_and_the_page_goes_on(browser, typed, taken):
    """The box takes radii of 1 um to 1 mm; what is no number leaves the last one."""
    shown = browser.execute_script(
        "$('block').value = 4; choose('block'); const box = $('tip'); box.value = '125';"
        "box.dispatchEvent(new Event('change'));"
        f"box.value = '{typed}'; box.dispatchEvent(new Event('change'));"
        "for (let i = 0; i < 2000; i++) probe.tick(probe.x + 1e-6, 1e-3);"
        "return [+box.value, radius() * 1e6, isFinite(probe.x)]"
    )
    assert shown == [pytest.approx(taken), pytest.approx(taken), True]


@pytest.mark.browser
def test_a_change_of_block_takes_its_conditions_and_forgets_the_last_release(browser):
    kept = browser.execute_script(
        "$('block').value = 0; choose('block'); $('load').value = 1.5; retune();"
        "for (let i = 0; i < 4000; i++) probe.tick(probe.x + 1e-5, 1e-4);"
        "kept = { force: [0, 1], before: [0, 1], ring: [0, 1], released: 1 };"
        "$('block').value = 4; choose('block');"
        "return [kept, since, probe.events, probe.released, tool.load, $('shares').textContent]"
    )
    assert kept == [None, -1, 0, 0, 0.3, ""]


@pytest.mark.browser
def test_a_mouse_drags_the_probe_over_the_edge(browser):
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.support.ui import WebDriverWait

    browser.execute_script("document.getElementById('block').value = 0; choose('block')")
    scene = browser.find_element("id", "scene")
    drag = ActionChains(browser, duration=30)  # of each move [ms]
    drag.move_to_element_with_offset(scene, -200, 0).click_and_hold()
    for _ in range(15):
        drag.move_by_offset(30, 0)
    drag.release().perform()
    WebDriverWait(browser, 30).until(
        lambda window: "last release at 0.18" in window.find_element("id", "state").text
    )
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []


@pytest.mark.browser
def test_the_hand_reaches_the_release_of_every_block_and_the_middle_is_to_scale(browser):
    reached = browser.execute_script(
        "return STIMULI.map((_, i) => { $('block').value = i; choose('block');"
        " return tool.stiffness * (toHand(1) - release().x); })"
    )
    # equations (1) and (2) at 0.3 N and mu 0.15, the first of the set's prediction
    heights = range(1, 11)
    needed = [0.3 * math.tan(math.acos(1 - n * 1e-5 / R) + math.atan(0.15)) for n in heights]
    assert all(have > need for have, need in zip(reached, needed, strict=True))
    assert browser.execute_script("return toHand(0.25) / (0.5 * VIEW)") == pytest.approx(0.25)


@pytest.mark.browser
def test_the_arrow_keys_drag_and_the_last_release_stands_with_its_energy(browser):
    from selenium.webdriver.common.keys import Keys
    from selenium.webdriver.support.ui import WebDriverWait

    browser.execute_script("$('block').value = 4; choose('block')")
    scene = browser.find_element("id", "scene")
    for _ in range(40):
        scene.send_keys(Keys.ARROW_RIGHT)
    # 50 um at 0.3 N and mu 0.15: 0.556 N and, a hundredth of 35.0 uJ times 9, 3.15 uJ
    told = r"last release at 0\.55\d N, E_v 3\.1\d µJ"
    WebDriverWait(browser, 30).until(
        lambda window: re.search(told, window.find_element("id", "state").text)
    )
    WebDriverWait(browser, 30).until(lambda window: window.execute_script("return kept !== null"))
    force = browser.execute_script("return Array.from(kept.force)")
    # the release stands 20 ms from the left
    assert np.argmax(np.abs(force)) == pytest.approx(0.02 * 10_000, abs=30)
    # figure 5 of the paper: about 86 % of the energy of the vibration phase in 250 to 350 Hz
    shares = re.findall(r"(\d+) %", browser.execute_script("return $('shares').textContent"))
    assert int(shares[1]) == pytest.approx(86, abs=4)


@pytest.mark.browser
def test_blind_trials_tell_nothing_but_the_feel_and_keep_the_score(whole):
    """Neither axes nor places nor reach nor what a reader is told depends on which block it is."""
    whole.execute_script("document.getElementById('blind').click()")
    told = []
    for side in ("block", "other"):
        told.append(
            whole.execute_script(
                f"choose('{side}'); draw(); plot();return [answer.map(i => STIMULI[i].set), "
                "CONDITIONS.map(n => stimulus[n]), toHand(1), place, "
                "$('scene').getAttribute('aria-valuenow'), $('tip').value, $('load').value, "
                "$('scene').toDataURL()]"
            )
        )
        assert not whole.find_element("id", "pictures").is_displayed()
        assert not whole.find_element("id", "declared").is_displayed()
    assert told[0] == told[1]
    assert len(set(told[0][0])) == 1
    said = whole.execute_script(
        "return new Promise(done => setTimeout(() => done($('state').textContent), 300))"
    )
    assert said.startswith("Feel A and B")
    more = whole.execute_script(
        "const found = answer.map(i => buildPath(STIMULI[i].variants[0], radius()))"
        ".map(one => predict(one, 1, tool).angle);"
        "return found[0] === found[1] ? -1 : found[0] > found[1] ? 0 : 1"
    )
    whole.find_element("id", "say-b" if more == 1 else "say-a").click()
    assert whole.find_element("id", "score").text.startswith("1 of 1 right; A was ")
    whole.execute_script("document.getElementById('blind').click()")
    assert whole.find_element("id", "pictures").is_displayed()


@pytest.mark.browser
def test_what_the_user_did_is_saved_as_compare_reads_it(browser, tmp_path):
    """The page's own drag of the block of 50 um is less than one difference away."""
    from stepblocks.simulators.compare import compare_record

    text, command = browser.execute_script(
        "$('block').value = 4; choose('block'); startRecord(); let x = -2e-4; hand = wanted = x;"
        "probe.place(x); while (x < 1.2e-4) { x += 2e-7; const f = probe.tick(x, 1 / RATE);"
        " record.push([x, probe.x, f, probe.ring, probe.events]); }"
        "for (let i = 0; i < 1500; i++)"
        " record.push([x, probe.x, probe.tick(x, 1 / RATE), probe.ring, 1]);"
        "let saved; const make = URL.createObjectURL; URL.createObjectURL = blob => { saved = blob;"
        " return make.call(URL, blob); }; stopRecord(); URL.createObjectURL = make;"
        "return saved.text().then(text => [text, $('compare').textContent])"
    )
    (tmp_path / "record.csv").write_text(text)
    assert command.startswith("stepblocks compare feel-step-050.csv --to ")
    assert command.endswith('--load "0.3 N" --friction 0.15 --tip-radius "125 um"')
    found = compare_record(
        tmp_path / "record.csv", ROOT / "stimuli" / "paper-ten.toml" / "step-050"
    )
    assert found.set_index("part")["difference_jnd"]["score"] < 1.0


@pytest.mark.browser
@pytest.mark.parametrize(
    "change",
    [
        "$('block').value = 7; choose('block')",
        "$('load').value = 0.9; $('load').dispatchEvent(new Event('input'))",
        "$('tip').value = 60; $('tip').dispatchEvent(new Event('change'))",
        "$('ring').click()",
        "Math.random = () => 0; $('blind').click()",  # the pair is step-010 and step-020
    ],
)
def test_a_record_is_of_one_stimulus_under_one_condition(browser, page, change):
    """Whatever else is changed ends the record, which keeps the name and condition it began with.

    Blind mode drew its pair first, so that the saved file bore the name of the block A.
    """
    browser.execute_script("$('block').value = 4; choose('block'); startRecord();")
    browser.execute_script("record.push([0, 0, 0, 0, 0])")
    saved, going, command = browser.execute_script(
        "let saved; const click = HTMLAnchorElement.prototype.click;"
        "HTMLAnchorElement.prototype.click = function () { saved = this.download; };"
        f"{change}; HTMLAnchorElement.prototype.click = click;"
        "return [saved, record, $('compare').textContent]"
    )
    browser.get(page.as_uri())
    assert (saved, going) == ("feel-step-050.csv", None)
    assert shlex.split(command)[3:] == [
        *("--to", f"{ROOT / 'stimuli' / 'paper-ten.toml'}/step-050"),
        *("--load", "0.3 N", "--friction", "0.15", "--tip-radius", "125 um"),
    ]


PAD = """
window.pulses = [];
const playEffect = async (kind, how) => pulses.push([kind, how.duration, how.weakMagnitude]);
const pad = { axes: [1, 0], buttons: [{ pressed: false }], vibrationActuator: { playEffect } };
navigator.getGamepads = () => [null, pad];
$('block').value = 4; choose('block');
"""


@pytest.mark.browser
def test_the_stick_of_a_gamepad_drags_and_the_release_shakes_it(browser, page):
    """A stub of the Gamepad API, for Chromium without hardware has none."""
    from selenium.webdriver.support.ui import WebDriverWait

    browser.execute_script(PAD)
    WebDriverWait(browser, 30).until(lambda window: window.execute_script("return pulses.length"))
    seen = browser.execute_script(
        "return [pulses, probe.events, place, tool.decay, probe.released]"
    )
    pulses, events, place, decay, released = seen
    browser.get(page.as_uri())
    assert (len(pulses), events) == (1, 1)
    assert place > 0.0
    # three decay times, 5 N for the whole strength
    assert pulses[0] == ["dual-rumble", math.ceil(3e3 * decay), pytest.approx(released / 5.0)]
    assert released == pytest.approx(
        0.3 * math.tan(math.acos(1 - 50 / 125) + math.atan(0.15)), rel=5e-3
    )


@pytest.mark.parametrize("width", [390, 1400])
@pytest.mark.browser
def test_the_page_to_feel_fits_every_screen(browser, width):
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    wide = browser.execute_script("return [document.documentElement.scrollWidth, innerWidth]")
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    assert wide[0] <= wide[1] == width


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The page of all shipped sets, as `stepblocks feel stimuli` writes it."""
    path = tmp_path_factory.mktemp("whole") / "all.html"
    write_feel_page(ROOT / "stimuli", path)
    profile = tmp_path_factory.mktemp("profile")
    with browser_without_network("window-size=1200,1100", f"user-data-dir={profile}") as window:
        window.get(path.as_uri())
        yield window


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
