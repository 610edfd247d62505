"""From an empty folder by clicks alone, in a real browser: each gives what its commands give."""

import shlex
import shutil
import time
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

pytest.importorskip("nicegui")

from oracles.loop_folder import write_explained_session
from oracles.window_browser import Clicker, open_browser, serve, wait_for
from stepblocks.cli import main
from stepblocks.declaration.read import load_set
from stepblocks.rehearse.run import simulate_session

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def driver():
    with open_browser("window-size=1280,1000") as opened:
        yield opened


@pytest.fixture
def page(driver, tmp_path):
    """A user of a window on an empty folder, and that folder."""
    folder = tmp_path / "clicked"
    folder.mkdir()
    with serve(folder) as (address, _):
        driver.get(address)
        driver.get_log("browser")  # of the window before
        user = Clicker(driver)
        user.see("Nothing here yet")
        yield user, folder
        faults = [entry for entry in driver.get_log("browser") if is_fault(entry)]
        driver.get("about:blank")
    assert faults == []


def is_fault(entry):
    """Tell whether the console speaks of a fault of the page itself."""
    is_of_page = "/folder/" not in entry["message"] and "REFUSED" not in entry["message"]
    return entry["level"] == "SEVERE" and is_of_page


def list_bytes(folder: Path):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def repeat(lines, folder, monkeypatch):
    """Type commands in a folder."""
    monkeypatch.chdir(folder)
    for line in lines:
        assert main(shlex.split(line)[1:]) in (0, 1, 3), line


def test_a_set_of_eight_blocks_one_jnd_apart(page, tmp_path, monkeypatch):
    user, folder = page
    user.click("Set")
    line = user.see("stepblocks design-set")
    user.click("Run: Design a set")
    user.see("done")
    user.see("Change the set in a form")
    typed = tmp_path / "typed"
    typed.mkdir()
    repeat([line], typed, monkeypatch)
    assert list_bytes(folder) == list_bytes(typed)
    assert (folder / "even.toml").read_text(encoding="utf-8").count("[[step_block]]") == 8


def drag(driver, selector, share):
    """Drag an element along by a share of the width of what holds it, as a hand does."""
    begin, end, height = driver.execute_script(
        "const found = document.querySelector(arguments[0]);"
        "found.scrollIntoView({block: 'center'});"
        "const box = found.getBoundingClientRect();"
        "const wide = found.closest('.axis').getBoundingClientRect().width;"
        "const begin = box.left + box.width / 2;"
        "return [begin, begin + arguments[1] * wide, box.top + 8];",
        selector,
        share,
    )
    hand = {"button": "left", "y": height, "buttons": 1, "clickCount": 1}
    press = {**hand, "type": "mousePressed", "x": begin}
    driver.execute_cdp_cmd("Input.dispatchMouseEvent", press)
    for step in range(1, 6):
        place = begin + (end - begin) * step / 5
        driver.execute_cdp_cmd(
            "Input.dispatchMouseEvent", {**hand, "type": "mouseMoved", "x": place}
        )
        time.sleep(0.2)
    driver.execute_cdp_cmd("Input.dispatchMouseEvent", {**hand, "type": "mouseReleased", "x": end})


def test_targets_that_a_hand_drags_are_those_of_the_command_and_its_file(
    page, tmp_path, monkeypatch
):
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.keys import Keys

    user, folder = page
    user.click("Set")
    user.find("[data-target='7']")
    user.see("As the command designs it.")
    drag(user.driver, "[data-target='7']", 0.1)
    dragged = user.see("--targets=")
    targets = [float(word.split("=")[1].split()[0]) for word in shlex.split(dragged)[3:-1]]
    assert len(targets) == 8
    assert targets[:7] == pytest.approx([2 * 10 ** (0.15 * n) for n in range(7)], rel=0.01)
    assert targets[7] > 1.2 * 2 * 10 ** (0.15 * 7)
    user.driver.execute_script("document.querySelector(\"[data-target='0']\").focus()")
    ActionChains(user.driver).send_keys(Keys.ARROW_RIGHT).perform()
    line = user.see("'--targets=2.05 uJ'")
    user.see("As the command designs it.")
    sizes = [found.text for found in user.driver.find_elements("css selector", ".axis-block")]
    user.click("Run: Design a set")
    user.see("Change the set in a form")
    typed = tmp_path / "typed"
    typed.mkdir()
    repeat([line], typed, monkeypatch)
    assert list_bytes(folder) == list_bytes(typed)
    made = [part.height.nominal for part in load_set(folder / "even.toml").stimuli]
    assert sizes == [f"{1e6 * height:.3g} µm" for height in made]


def test_a_study_of_six_simulated_participants_to_its_table(page, tmp_path, monkeypatch):
    user, folder = page
    lines = ["stepblocks new block mine.toml"]
    user.click("Run: Write a commented file")
    user.see("done")
    user.click("Study")
    user.see("stepblocks study design mine.toml")
    user.type("Participants", "6")
    lines.append(user.see("--participants=6"))
    user.click("Run: Design a study")
    user.see("Write blinded run sheets")
    lines.append(user.see("stepblocks study simulate"))
    user.click("Run: Let simulated participants answer")
    user.see("270 simulated answers")
    lines.append(user.see("stepblocks study analyse"))
    user.click("Run: Analyse the answers")
    frame = user.find("iframe.report")
    user.driver.switch_to.frame(frame)
    user.see("participants")
    user.driver.switch_to.default_content()
    typed = tmp_path / "typed"
    typed.mkdir()
    repeat(lines, typed, monkeypatch)
    assert list_bytes(folder) == list_bytes(typed)
    assert (folder / "study" / "report" / "results.csv").is_file()


def test_an_order_of_three_blocks_to_its_bundle(page, tmp_path, monkeypatch):
    user, folder = page
    user.click("Declare")
    user.type("Stimulus file, there or new (such as mine.toml)", "three.toml")
    user.click("Open")
    for number, (name, height) in enumerate((("low", "25"), ("mid", "50"), ("high", "100"))):
        if number:
            user.click("Add")
            user.see_field("id", "")
        user.type("id", name)
        user.type("height", f"{height} um")
        user.see(f"step_block: {name}")
    user.click("Save")
    user.see("three.toml is saved")
    user.click("Build")
    lines = [user.see(f"stepblocks {word} three.toml") for word in ("build", "workshop")]
    user.click("Run: Build, read back")
    user.see("Verdict of every file")
    user.click("Run: Bundle for the workshop")
    user.see("Take three.quotation.zip")
    lines.append(user.see("stepblocks export three.toml"))
    user.click("Run: Scenes for the simulator mujoco")
    user.see("done", number=3)
    typed = tmp_path / "typed"
    typed.mkdir()
    declared = (folder / "three.toml").read_text(encoding="utf-8")
    (typed / "three.toml").write_text(declared, encoding="utf-8")
    repeat(lines, typed, monkeypatch)
    made = list_bytes(folder)
    assert made == list_bytes(typed)
    assert {"out/three/three.quotation.zip", "out/index.html"} < made.keys()
    assert "out/scenes-mujoco/three/low/mujoco/scene.xml" in made


def test_a_scan_that_leaves_three_answers_open_to_its_certificate(page, tmp_path, monkeypatch):
    """Unit, part and stylus: two are asked for, and without the third nothing is proven."""
    user, folder = page
    user.click("Run: Write a commented file")
    user.see("done")
    scan = Path(__file__).parents[1] / "data" / "scan-without-unit.csv"
    user.click("Inspect")
    user.drop(scan)
    user.see("unit")
    user.type("Unit, where the file says none (um; x=mm,z=um)", "um")
    user.click("Look")
    user.see("Profile of 1000 points")
    user.choose("Part that was scanned", "(mine.toml)")
    user.type("Radius of the stylus (2 um; optical: 0 um)", "0 um")
    line = user.see("'--stylus-radius=0 um'")
    user.click("Run: Judge the scan")
    user.see("step-025.certificate.pdf")
    typed = tmp_path / "typed"
    (typed / "scans").mkdir(parents=True)
    (typed / "scans" / scan.name).write_bytes(scan.read_bytes())
    repeat(["stepblocks new block mine.toml", line], typed, monkeypatch)
    assert list_bytes(folder) == list_bytes(typed)


PLAN = """
schema = 1
seed = 5
format = "csv"
[design]
heights = ["20 um", "40 um", "60 um", "80 um"]
loads = ["0.5 N", "1.1 N"]
speeds = ["2 mm/s", "10 mm/s"]
trials = 48
days = 1
[[effects]]                # friction runs in, which nobody declares
slot = "friction"
change = "multiply"
form = "exponential"
covariate = "run_order"
size = 0.8
span = 12
"""


def pack_session(base):
    """A zip file of a simulated session, without what only its simulation knows."""
    (base / "plan.toml").write_text(PLAN, encoding="utf-8")
    simulate_session(base / "plan.toml", base / "simulated")
    archive = base / "b1.zip"
    with zipfile.ZipFile(archive, "w") as packed:
        for path in sorted((base / "simulated").rglob("*")):
            if path.is_file() and path.name != "truth.csv":
                packed.write(path, path.relative_to(base / "simulated").as_posix())
    return archive


def click_point(driver, trial):
    """Click where the chart draws the last series' point of a trial."""
    place = driver.execute_script(
        "const box = document.querySelector('.nicegui-echart');"
        "box.scrollIntoView({block: 'center'});"
        "const chart = getElement(Number(box.id.slice(1))).chart;"
        "const points = chart.getOption().series[1].data;"
        "const point = points.find(found => found.name === arguments[0]);"
        "const [x, y] = chart.convertToPixel({seriesIndex: 1}, point.value);"
        "const frame = box.getBoundingClientRect();"
        "return [Math.round(frame.left + x), Math.round(frame.top + y)];",
        trial,
    )
    for kind in ("mousePressed", "mouseReleased"):
        event = {"type": kind, "x": place[0], "y": place[1], "button": "left", "clickCount": 1}
        driver.execute_cdp_cmd("Input.dispatchMouseEvent", event)


def test_a_session_with_an_undeclared_effect_to_its_finding_and_a_corrected_prediction(
    page, tmp_path, monkeypatch
):
    user, folder = page
    archive = pack_session(tmp_path)
    user.click("Run: Write a commented file")
    user.see("done")
    user.click("Bench")
    user.drop(archive)
    user.see("First trace; its columns: time_s, fx_n, fy_n")
    lines = [user.see("stepblocks measure sessions/b1 --check")]
    user.click("Run: Hold some trials")
    user.see("16 of 16 trials could be measured.")
    user.see("spring constant")
    lines.append(user.see("stepblocks loop sessions/b1"))
    user.click("Run: Find what the model lacks")
    user.see("Friction runs in")
    user.see("Error on trials held out, before and after")
    user.see("Held apart: none")
    user.see("The next experiment")
    user.find("canvas")
    time.sleep(1.0)  # the chart draws itself
    click_point(user.driver, "7")
    user.see("--trials=7")
    user.find("img[src^='data:image/png']")
    lines.append(user.see("stepblocks predict sessions/b1 --model"))
    user.click("Run: Predict the trials of the session")
    user.see("48 trials predicted, 0 of them not ok")
    user.click("Use the model on the page to declare")
    user.type("Stimulus file, there or new (such as mine.toml)", "mine.toml")
    user.click("Open")
    user.see("energy with the model, µJ (95 %)")
    user.see("stepblocks build mine.toml -o out --model out/b1-loop/model.json")
    typed = tmp_path / "typed"
    shutil.copytree(folder / "sessions", typed / "sessions")
    repeat(["stepblocks new block mine.toml", *lines], typed, monkeypatch)
    assert list_bytes(folder) == list_bytes(typed)
    predicted = pd.read_csv(folder / "out" / "b1-loop-predicted.csv")
    measured = pd.read_csv(folder / "out" / "b1-loop" / "features.csv")["vibration_energy_j"]
    errors = {}
    for name in ("vibration_energy_j", "nominal_vibration_energy_j"):
        errors[name] = np.sqrt(np.mean(np.log(measured / predicted[name]) ** 2))
    assert errors["vibration_energy_j"] < 0.5 * errors["nominal_vibration_energy_j"]


def drop_folder(driver, selector, folder):
    """Drop a folder of the disk, as a hand does that drags it out of a file manager."""
    place = driver.execute_script(
        "const box = document.querySelector(arguments[0]).getBoundingClientRect();"
        "return [box.left + box.width / 2, box.top + box.height / 2];",
        selector,
    )
    data = {"items": [], "files": [str(folder)], "dragOperationsMask": 1}
    for kind in ("dragEnter", "dragOver", "drop"):
        event = {"type": kind, "x": place[0], "y": place[1], "data": data}
        driver.execute_cdp_cmd("Input.dispatchDragEvent", event)
        time.sleep(0.3)


def test_a_session_that_is_dropped_or_chosen_as_a_folder_is_there_byte_for_byte(page, tmp_path):
    user, folder = page
    session = tmp_path / "b ü"
    for name, content in (
        ("session.toml", b"schema = 1\n"),
        ("traces/deep/0001.csv", b"t_s,fx_n\n" + b"0,1\n" * 1000),
        ("traces/\u03b1.bin", bytes(range(256)) * 300),
        ("empty.txt", b""),
    ):
        (session / name).parent.mkdir(parents=True, exist_ok=True)
        (session / name).write_bytes(content)
    user.click("Bench")
    user.find(".takes-folders")
    drop_folder(user.driver, ".takes-folders", session)
    user.see_field("Session (its folder)", "sessions/b ü")
    assert list_bytes(folder / "sessions" / "b ü") == list_bytes(session)
    (tmp_path / "b2").mkdir()
    chosen = session.rename(tmp_path / "b2" / "chosen")
    user.find("input[webkitdirectory]").send_keys(str(chosen))
    user.see_field("Session (its folder)", "sessions/chosen")
    assert list_bytes(folder / "sessions" / "chosen") == list_bytes(chosen)
    user.find("input[webkitdirectory]").send_keys(str(chosen))
    user.see("folder already, which is kept")
    assert {path.name for path in folder.rglob("*.zip")} == set()


MANY = 2000
DROP_MANY = """
const data = new DataTransfer();
for (let number = 0; number < arguments[0]; number++) {
  const name = number % 400 === 7 ? `page-${number}.html` : `scan-${number}.csv`;
  data.items.add(new File([`x_um,z_um\n0,${number}\n1,0\n2,0\n`], name));
}
const field = document.querySelector('.q-uploader__input');
field.files = data.files;
field.dispatchEvent(new Event('change', { bubbles: true }));
"""


def test_of_two_thousand_files_that_are_dropped_at_once_each_is_taken_or_refused_by_name(page):
    """The page answers as before; the scans are whole, and offered."""
    user, folder = page
    user.click("Inspect")
    user.find(".q-uploader__input")
    user.driver.execute_script(DROP_MANY, MANY)
    refused = [f"page-{number}.html" for number in range(7, MANY, 400)]
    for name in refused:
        user.see(name)
    taken = {f"scan-{number}.csv" for number in range(MANY) if number % 400 != 7}
    scans = folder / "scans"
    # a file that is still written lies there under another name
    wait_for(lambda: {path.name for path in scans.glob("*")} == taken, "every scan")
    for number in (0, 999, MANY - 1):
        text = f"x_um,z_um\n0,{number}\n1,0\n2,0\n"
        assert (scans / f"scan-{number}.csv").read_text() == text
    user.type("Scan in the folder", "scans/scan-999.csv")
    user.click("Look")
    user.see("heights from 0 µm to 999 µm")
    user.click("Start")
    user.see(f"Scans and tables ({len(taken)})")


def test_a_server_that_is_killed_in_a_job_finds_it_again_when_it_starts(driver, tmp_path):
    """The build goes on without a window; the next one shows how far it is, and its verdicts."""
    declared = '[[step_block]]\nid = "low"\nheight = "25 um"\n'
    (tmp_path / "mine.toml").write_text(declared, encoding="utf-8")
    user = Clicker(driver)
    with serve(tmp_path) as (address, server):
        driver.get(address)
        user.click("Build")
        user.click("Run: Build, read back")
        user.see("running")
        server.kill()
        server.wait(60)
        driver.get("about:blank")
    with serve(tmp_path) as (address, _):
        driver.get(address)
        user.click("Work")
        user.see("stepblocks build mine.toml -o out")
        user.see("done")
        user.click("Build")
        user.see("Verdict of every file")
        user.click("Work")
        user.click("Run again: Build")
        # it has nothing to do and may be done before anyone sees it run
        user.see("1 stimuli, all up to date; nothing to do")
        user.see("done", number=2)
        driver.get("about:blank")
    assert (tmp_path / "out" / "index.html").is_file()


PAGES = (
    "",
    "declare?file=mine.toml",
    "build",
    "inspect?file=scan.csv",
    "bench",
    "bench?session=bench/b1",
    "study",
    "set",
    "work",
)
SIZES = ((1280, 1000), (820, 1180))  # a small screen, and a tablet held upright


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """A folder with a file of each kind."""
    folder = tmp_path_factory.mktemp("lab")
    declared = '[[step_block]]\nid = "low"\nheight = "25 um"\n'
    (folder / "mine.toml").write_text(declared, encoding="utf-8")
    rows = [f"{place},{25 * (place > 500)}" for place in range(1000)]
    (folder / "scan.csv").write_text("\n".join(["x_um,z_um", *rows]) + "\n", encoding="utf-8")
    for name, file in (("session", "session.toml"), ("study", "design.csv")):
        (folder / name).mkdir()
        (folder / name / file).touch()
    write_explained_session(folder)
    return folder


def test_no_page_has_a_serious_fault_of_access(driver, lab):
    """By axe-core, in light and dark, on a small screen and on a tablet."""
    pytest.importorskip("axe_core_python")
    from axe_core_python.selenium import Axe

    found = []
    with serve(lab) as (address, _):
        driver.get(address)
        base = address.partition("?")[0]
        user = Clicker(driver)
        for path in PAGES:
            driver.get(base + path)
            user.find("main h1")
            time.sleep(2.0)  # what is read from files comes later
            if "session=" in path:
                user.find("canvas")
            if "declare" in path:
                user.find(".q-slider")
            for size in SIZES:
                driver.set_window_size(*size)
                for colours in ("light", "dark"):
                    choose_colours(driver, colours)
                    for fault in Axe().run(driver)["violations"]:
                        if fault["impact"] in ("serious", "critical"):
                            places = [node["html"] for node in fault["nodes"]]
                            found.append((path, size, colours, fault["id"], places))
        driver.get("about:blank")
    choose_colours(driver, "light")
    assert found == []


def choose_colours(driver, colours):
    feature = {"name": "prefers-color-scheme", "value": colours}
    driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [feature]})
    time.sleep(0.3)
