"""A file that is changed by a form stays the user's: comments, order, and what is not changed."""

import asyncio
import io
import re
import threading
import time
import tomllib
from pathlib import Path

import pytest
import trimesh

pytest.importorskip("nicegui")

from nicegui import core, ui
from nicegui.testing.user_simulation import user_simulation

from oracles.shipped import load_shipped
from stepblocks.declaration.read import load_set
from stepblocks.declaration.set import list_kinds
from stepblocks.errors import PipelineError, StimulusError
from stepblocks.predict.kept import KeptPredictions
from stepblocks.predict.run import predict_set
from stepblocks.window.draft import Draft, StanzaPlace, find_field_of_mistake, list_form_fields
from stepblocks.window.felt import draw_profile_as_svg, predict_felt
from stepblocks.window.latest_work import LatestWork
from stepblocks.window.part_view import make_part_view_in_worker
from stepblocks.window.saving import hold_for_saving
from stepblocks.window.session_files import SessionDraft
from stepblocks.window.size_slider import list_slidable_sizes, read_size_range
from stepblocks.window.window import Window

ROOT = Path(__file__).resolve().parents[2]
BLOCK = StanzaPlace("step_block", 0)
WRITTEN = """# of the second batch
title = "Mine"

[[step_block]]   # the low one
height = "25 um" # as ordered
id = "low"
"""


@pytest.mark.parametrize("path", sorted((ROOT / "stimuli").glob("*.toml")), ids=lambda p: p.stem)
def test_a_file_that_is_not_changed_stays_the_same_bytes(path):
    draft = Draft(path)
    assert draft.text == path.read_text(encoding="utf-8")
    for place in draft.list_stanzas():
        for field in list_form_fields(place.kind):
            draft.write_field(place, field.path, draft.read_field(place, field.path))
    assert tomllib.loads(draft.text) == tomllib.loads(path.read_text(encoding="utf-8"))
    assert draft.check().stimuli == load_set(path)


def test_comments_and_order_stay_where_a_value_is_changed(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(WRITTEN)
    draft = Draft(path)
    draft.write_field(BLOCK, ("height",), "30 um")
    draft.save()
    assert path.read_text() == WRITTEN.replace("25 um", "30 um")


@pytest.mark.parametrize(
    ("entry", "value"),
    [
        ("25 um", "25 um"),
        ('{ nominal = "25 um", tolerance = "1 um" }', {"nominal": "25 um", "tolerance": "1 um"}),
        ("0.15", 0.15),
        ("true", True),
        ('"true"', "true"),
        ("25 um\n[evil]\na = 1", "25 um [evil] a = 1"),
        ('25 um" # "', '25 um" # "'),
        ("../secret", "../secret"),
    ],
)
def test_what_is_typed_is_one_value_and_reads_back_as_typed(entry, value, tmp_path):
    draft = Draft(tmp_path / "mine.toml")
    place = draft.add_stanza("step_block")
    draft.write_field(place, ("height",), entry)
    assert tomllib.loads(draft.text) == {"step_block": [{"height": value}]}
    again = draft.read_field(place, ("height",))
    draft.write_field(place, ("height",), again)
    assert tomllib.loads(draft.text) == {"step_block": [{"height": value}]}


def test_an_emptied_field_is_left_out_with_the_table_that_held_it_alone(tmp_path):
    draft = Draft(tmp_path / "mine.toml")
    place = draft.add_stanza("step_block")
    draft.write_field(place, ("body", "mounting", "depth"), "4 mm")
    assert tomllib.loads(draft.text)["step_block"] == [{"body": {"mounting": {"depth": "4 mm"}}}]
    draft.write_field(place, ("body", "mounting", "depth"), " ")
    assert tomllib.loads(draft.text)["step_block"] == [{}]


def test_a_file_that_somebody_else_changed_meanwhile_is_not_overwritten(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(WRITTEN)
    first, second = Draft(path), Draft(path)
    first.write_field(BLOCK, ("height",), "30 um")
    second.write_field(BLOCK, ("height",), "40 um")
    first.save()
    first.write_field(BLOCK, ("height",), "31 um")
    first.save()
    with pytest.raises(PipelineError, match="was changed since it was opened here"):
        second.save()
    assert 'height = "31 um"' in path.read_text()


def test_what_is_no_declaration_is_not_saved(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(WRITTEN)
    draft = Draft(path)
    draft.write_field(BLOCK, ("height",), "25 kg")
    with pytest.raises(StimulusError, match="height"):
        draft.save()
    assert path.read_text() == WRITTEN


@pytest.mark.parametrize("kind", list_kinds())
def test_every_kind_has_a_form_with_the_fields_of_its_model(kind):
    fields = list_form_fields(kind)
    model = list_kinds()[kind]
    # what a scan says of a place is worked out: a file that states it is refused
    worked_out = {"station"} if kind == "scanned_margin" else set()
    assert {field.path[0] for field in fields} == set(model.model_fields) - worked_out
    names = [field.name for field in fields]
    assert len(set(names)) == len(names)
    assert [field.name for field in fields if not field.help] == []
    # defaults are in units, never in the words of the program
    assert not any(re.search(r"[(=]|None", field.default) for field in fields)
    assert not any("None" in field.help for field in fields)


@pytest.mark.parametrize(
    ("path", "entry"),
    [
        (("height",), "25 kg"),
        (("edge_radius",), "400 um"),
        (("body", "length"), "5"),
        (("body", "mounting", "spacing"), "30 mm"),
        (("material",), "cheese"),
        (("metrology", "kind"), "hole"),
    ],
)
def test_a_mistake_is_found_at_its_field(path, entry, tmp_path):
    target = tmp_path / "mine.toml"
    target.write_text(WRITTEN)
    draft = Draft(target)
    draft.write_field(BLOCK, path, entry)
    mistakes = draft.check().mistakes
    found = [find_field_of_mistake(text, list_form_fields("step_block")) for _, text in mistakes]
    assert path in [field.path for field in found if field is not None], mistakes


def test_what_is_shown_as_felt_is_the_first_row_of_the_prediction_of_each_part():
    path = ROOT / "stimuli" / "paper-four.toml"
    felt = predict_felt(load_set(path))
    table = predict_set(path, dragged=False).groupby("stimulus").first()
    assert [row.part for row in felt] == list(table.index)
    for row in felt:
        expected = table.loc[row.part]
        for text, name, unit in (
            (row.energy, "vibration_energy", "uj"),
            (row.force, "peak_force", "n"),
        ):
            shown = [float(part) for part in text.strip(")").replace("(", "to ").split("to")]
            columns = [f"{name}{end}_{unit}" for end in ("", "_95_low", "_95_high")]
            assert shown == pytest.approx(expected[columns].tolist(), rel=0.01)
        assert row.dragged == ""


def test_a_block_that_locks_says_so_and_the_drag_in_time_follows_the_formula(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(WRITTEN + '[[step_block]]\nid = "locks"\nheight = "120 um"\n')
    low, locks = predict_felt(load_set(path), dragged=True)
    table = predict_set(path, dragged=True).groupby("stimulus").first()
    energy = table.loc["low", "drag_vibration_energy_uj"]
    assert float(low.dragged) == pytest.approx(energy, rel=0.01)
    assert locks.energy == table.loc["locks", "status"] == "locked"


def test_a_profile_is_drawn_to_one_scale():
    """Of a sharp step the riser is as long, in the scale of its bar, as it is high."""
    part = load_shipped("paper-four").stimuli[1]
    picture = draw_profile_as_svg(part)
    points = picture.split('points="')[1].split('"')[0].split()
    corners = [tuple(map(float, point.split(","))) for point in points]
    riser = max(z for _, z in corners) - min(z for _, z in corners)
    wide = max(x for x, _ in corners) - min(x for x, _ in corners)
    assert riser / wide == pytest.approx(50.0 / (2 * 4 * 50.0), rel=0.01)


async def declare(folder):
    """Make a file of one block by clicks and typing alone; return what the page showed."""
    async with user_simulation(root=Window(folder).build) as user:
        await user.open("/declare?file=mine.toml")
        entries = {}
        for name in ("id", "height"):
            entries[name] = next(iter(user.find(marker=name, kind=ui.input).elements))
        entries["id"].set_value("low")
        height = entries["height"]
        height.set_value("25 kg")
        for _ in range(100):
            if height.error:
                break
            await asyncio.sleep(0.1)
        error = height.error
        height.set_value("25 um")
        await user.should_see(marker="felt", retries=100)
        user.find("Save").click()
        await user.should_see("mine.toml is saved")
        await user.should_see("stepblocks predict mine.toml")
        return error


def test_a_file_is_declared_by_clicks_and_a_mistake_stands_at_its_field(tmp_path):
    error = asyncio.run(declare(tmp_path))
    assert error.startswith("height")
    text = (tmp_path / "mine.toml").read_text()
    assert text == '[[step_block]]\nid = "low"\nheight = "25 um"\n'
    assert [part.id for part in load_set(tmp_path / "mine.toml").stimuli] == ["low"]


async def open_file(folder, name):
    async with user_simulation(root=Window(folder).build) as user:
        await user.open(f"/declare?file={name}")
        return [label.text for label in user.find(kind=ui.label).elements]


@pytest.mark.repeats
@pytest.mark.parametrize("name", ["../secret.toml", "/etc/x.toml", "a/../../secret.toml", "a.txt"])
def test_a_name_outside_the_folder_is_not_opened(name, tmp_path):
    folder = tmp_path / "lab"
    folder.mkdir()
    (tmp_path / "secret.toml").write_text('title = "secret"')
    shown = asyncio.run(open_file(folder, name))
    assert any("must lie in the folder" in text or "must end in" in text for text in shown)
    assert not any("secret" in text for text in shown if "must" not in text)


@pytest.mark.parametrize(
    "entry", ["", "25 kg", "-5 um", "0 um", '{ values = ["25 kg"] }', "1.2.3 um", "{", "[1]", "7"]
)
def test_what_holds_no_length_has_no_slider(entry):
    assert list_slidable_sizes(entry) == []


@pytest.mark.parametrize(
    ("entry", "name", "changed"),
    [
        ("25 um", "", "30 um"),
        ('{nominal = "25 um", tolerance = "1 um"}', "nominal", '"30 um", tolerance = "1 um"}'),
        ('{values = ["20 um", "25 um"], source = "a"}', "values 2", '["20 um", "30 um"], source'),
        ('{from = "10 um", to = "25 um", step = "5 um"}', "to", 'to = "30 um", step = "5 um"}'),
    ],
)
def test_a_slider_changes_one_size_of_an_entry_and_leaves_the_rest_as_typed(entry, name, changed):
    (size,) = [size for size in list_slidable_sizes(entry) if size.place_label == name]
    assert size.range.value == 25.0
    assert changed in size.replace_in_entry(entry, 30.0)
    assert len(size.replace_in_entry(entry, 30.0)) == len(entry)
    assert size.replace_in_entry("40 mm", 30.0) == ("30 um" if name == "" else "40 mm")


def test_an_end_of_a_series_moves_by_whole_distances_of_its_sizes():
    low, high = list_slidable_sizes('{from = "10 um", to = "100 um", step = "10 um"}')
    assert (low.range.low, low.range.high, low.range.step) == (10.0, 20.0, 10.0)
    assert (high.range.low, high.range.high, high.range.step) == (20.0, 200.0, 10.0)


def test_a_slider_goes_from_a_fifth_to_the_double_in_the_unit_that_was_typed():
    found = read_size_range("0.025 mm")
    assert (found.low, found.high, found.unit) == (0.005, 0.05, "mm")
    assert found.format_value_with_unit(0.0312345) == "0.03123 mm"


async def slide(folder):
    """Move the slider of a height; return the height, and what is felt at the end."""
    async with user_simulation(root=Window(folder).build) as user:
        await user.open("/declare?file=mine.toml")
        await user.should_see(marker="felt", retries=200)
        (slider,) = user.find(marker="slider").elements
        (height,) = user.find(marker="height", kind=ui.input).elements
        (table,) = user.find(marker="felt").elements
        for value in (26.0, 28.0, 30.0):
            slider.set_value(value)
        for _ in range(600):
            if table.rows and table.rows[0]["dragged"]:
                break
            await asyncio.sleep(0.1)
        return height.value, table.rows


def test_what_is_felt_follows_a_slider_by_the_formula_and_the_drag_and_nothing_is_saved(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(WRITTEN)
    height, (row,) = asyncio.run(slide(tmp_path))
    assert height == "30 um"
    assert path.read_text() == WRITTEN
    path.write_text(WRITTEN.replace("25 um", "30 um"))
    (expected,) = predict_felt(load_set(path), dragged=True)
    assert row == vars(expected)


async def slide_while_slow_work_hangs(folder, is_let, monkeypatch):
    """Move a slider three times while drag and kernel never end; return what stands each time."""
    begun = []

    def drag(*_, dragged=False, **__):
        assert dragged
        begun.append("drag")
        is_let.wait(60.0)
        return []

    def build(*_):
        begun.append("solid")
        is_let.wait(60.0)
        raise PipelineError("not built")

    monkeypatch.setattr("stepblocks.window.declare_page.predict_felt", drag)
    monkeypatch.setattr("stepblocks.window.part_view.make_part_view_in_worker", build)
    seen = []
    try:
        async with user_simulation(root=Window(folder).build) as user:
            await user.open("/declare?file=mine.toml")
            await user.should_see(marker="felt", retries=200)
            (slider,) = user.find(marker="slider").elements
            (table,) = user.find(marker="felt").elements
            (solid,) = user.find(marker="show-part").elements
            solid.set_value(True)
            for _ in range(600):
                if {"drag", "solid"} <= set(begun):
                    break
                await asyncio.sleep(0.05)
            slow = len(begun)
            for value in (26.0, 28.0, 30.0):
                before = table.rows[0]["energy"]
                slider.set_value(value)
                for _ in range(600):
                    if table.rows[0]["energy"] != before:
                        break
                    await asyncio.sleep(0.02)
                seen.append(table.rows[0]["energy"])
            slow = len(begun) - slow
            is_let.set()
    finally:
        is_let.set()
    return seen, slow


def test_the_formula_follows_a_slider_without_waiting_for_the_drag_or_the_kernel(
    tmp_path, monkeypatch
):
    """Both hang here for good: nothing of them lies on the way of the formula."""
    path = tmp_path / "mine.toml"
    path.write_text(WRITTEN)
    seen, slow = asyncio.run(slide_while_slow_work_hangs(tmp_path, threading.Event(), monkeypatch))
    expected = []
    for height in (26, 28, 30):
        path.write_text(WRITTEN.replace("25 um", f"{height} um"))
        expected.append(predict_felt(load_set(path))[0].energy)
    assert seen == expected
    assert slow == 0


def test_what_is_passed_over_is_left_out_and_the_last_value_is_always_followed(monkeypatch):
    done = []
    monkeypatch.setattr(core, "loop", None)

    async def follow():
        core.loop = asyncio.get_running_loop()
        stands = 0

        async def do():
            value = stands
            await asyncio.sleep(0.01)
            done.append(value)

        work = LatestWork(do)
        for number in range(1, 6):
            stands = number
            work.request()
            await asyncio.sleep(0.0)
        for _ in range(200):
            if done and done[-1] == 5:
                break
            await asyncio.sleep(0.01)

    asyncio.run(follow())
    assert done[-1] == 5
    assert len(done) < 5


def test_a_drag_that_nobody_wants_any_more_ends_before_its_next_part():
    stimuli = load_shipped("paper-four").keep_felt()
    kept = KeptPredictions()
    wanted = iter([True, False])
    speed = 5e-3
    assert kept.predict_reusing_kept(stimuli, False, speed, lambda: next(wanted)) is None
    # the part that was predicted until then is kept: those behind it alone are asked about
    wanted = iter([True] * (len(stimuli.stimuli) - 1))
    found = kept.predict_reusing_kept(stimuli, False, speed, lambda: next(wanted))
    assert len(found.rows) == len(
        KeptPredictions().predict_reusing_kept(stimuli, False, speed).rows
    )


def test_a_set_of_which_one_part_is_changed_is_felt_as_if_it_were_new():
    """What is kept of the parts that stay is what would be predicted of them again."""
    kept = {False: KeptPredictions(), True: KeptPredictions()}
    draft = Draft(ROOT / "stimuli" / "paper-four.toml")
    for entry in ('{values = ["25 um", "50 um"]}', '{values = ["25 um", "60 um"]}', "40 um"):
        draft.write_field(BLOCK, ("height",), entry)
        stimuli = draft.check().stimuli
        for dragged in (False, True):
            felt = predict_felt(stimuli, dragged=dragged, kept=kept[dragged])
            assert felt == predict_felt(stimuli, dragged=dragged)


@pytest.mark.repeats
@pytest.mark.parametrize("name", ["paper-ten", "crown-margins", "sheaths"])
def test_one_size_is_followed_within_a_tenth_of_a_second_and_a_second_by_the_drag(name):
    """By processor time, which another program of the machine does not lengthen."""
    draft = Draft(ROOT / "stimuli" / f"{name}.toml")
    place = next(iter(draft.list_stanzas()))
    fields = [field for field in list_form_fields(place.kind) if field.is_required]
    entries = {field.path: draft.read_field(place, field.path) for field in fields}
    path, size = next(
        (path, size) for path, entry in entries.items() for size in list_slidable_sizes(entry)[-1:]
    )
    kept = {False: KeptPredictions(), True: KeptPredictions()}
    spent = {False: [], True: []}
    for number in range(4):
        value = size.range.value + number * size.range.step
        draft.write_field(place, path, size.replace_in_entry(draft.read_field(place, path), value))
        begun = time.process_time()
        stimuli = draft.check().stimuli
        for dragged in (False, True):
            predict_felt(stimuli, dragged=dragged, kept=kept[dragged])
            spent[dragged].append(time.process_time() - begun)
    # the first of all loads what it needs
    assert min(spent[False][1:]) < 0.1
    assert min(spent[True][1:]) < 1.0


@pytest.mark.long
def test_the_part_is_shown_as_the_kernel_builds_it_with_its_drawing():
    stimuli = load_shipped("paper-four")
    view = make_part_view_in_worker(stimuli.stimuli[0], stimuli.order)
    (body,) = view.bodies
    mesh = trimesh.load(io.BytesIO(body), file_type="stl")
    assert mesh.is_watertight
    # the step of 25 um, stretched, stands over the lower face at z = 0
    assert mesh.bounds[1, 2] == pytest.approx(25e-3 * view.exaggeration, rel=1e-3)
    assert "apparatus-025" in view.drawing.lower()


async def leave_and_come_back(folder):
    """Type without saving, leave the page, come back; return what the field says each time."""
    async with user_simulation(root=Window(folder).build) as user:
        said = []

        def find():
            return next(iter(user.find(marker="height", kind=ui.input).elements))

        await user.open("/declare?file=mine.toml")
        find().set_value("44 um")
        user.client.delete()  # as the server does when a page was closed
        await user.open("/declare?file=mine.toml")
        await user.should_see("left unsaved")
        said.append(find().value)
        user.find("Discard them").click()
        await user.should_not_see("left unsaved")
        said.append(find().value)
        find().set_value("45 um")
        user.find("Save").click()
        await user.should_see("mine.toml is saved")
        user.client.delete()
        await user.open("/declare?file=mine.toml")
        await user.should_not_see("left unsaved")
        said.append(find().value)
        return said


def test_what_was_typed_and_not_saved_is_there_again_when_the_page_is_opened_anew(tmp_path):
    (tmp_path / "mine.toml").write_text(WRITTEN)
    assert asyncio.run(leave_and_come_back(tmp_path)) == ["44 um", "25 um", "45 um"]
    assert (tmp_path / "mine.toml").read_text() == WRITTEN.replace("25 um", "45 um")


def test_a_session_and_a_stimulus_file_are_saved_by_one_window_at_a_time(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(WRITTEN)
    (tmp_path / "session.toml").write_text("schema = 1\n")
    for draft in (Draft(path), SessionDraft(tmp_path)):
        saved = path if isinstance(draft, Draft) else tmp_path / "session.toml"
        with hold_for_saving(saved), pytest.raises(PipelineError, match="another window is saving"):
            draft.save()
        draft.save()
