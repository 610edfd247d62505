"""A session is put together without harm: its archive stays in its folder, its file the user's."""

import asyncio
import hashlib
import io
import tomllib
import zipfile
from dataclasses import replace

import pytest

pytest.importorskip("nicegui")

from nicegui import ui
from nicegui.elements.upload_files import SmallFileUpload
from nicegui.testing.user_simulation import user_simulation

from stepblocks.errors import BenchError, PipelineError
from stepblocks.loop.declared_checks import CalibrationCheck, Declared, RateCheck, SessionCheck
from stepblocks.loop.record import convert_to_json_values, format_json_document
from stepblocks.window import texts
from stepblocks.window.bench_page import BenchForm
from stepblocks.window.declaration_check import list_check_rows, read_check_result
from stepblocks.window.folder import Folder
from stepblocks.window.jobs import JobList
from stepblocks.window.session_files import SETTINGS, SessionDraft, unpack_session
from stepblocks.window.trace_picture import read_and_draw_trace
from stepblocks.window.window import Window

DECLARED = """# of the second bench
schema = 1

[probe]
spring_constant = "9.81 N/mm"  # certified
tip_radius = "125 um"

[acquisition]
sample_rate = "10 kHz"
traces = "traces/{trial:04d}.csv"
[acquisition.channels]
tangential = "fx_n"
normal = "fy_n"
"""
TRACE = "t_s,fx_n,fy_n,note\n" + "".join(f"{i / 1e4},{i % 7},1.0,a\n" for i in range(50))
BY_NAME = {setting.name: setting for setting in SETTINGS}


def pack(files):
    """An archive of files by their names."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, text in files.items():
            archive.writestr(name, text)
    return buffer.getvalue()


FILES = {"session.toml": DECLARED, "traces/0001.csv": TRACE, "traces/0002.csv": "x"}


@pytest.mark.parametrize("around", ["", "bench 1/"])
def test_an_archive_becomes_the_folder_that_it_holds(around, tmp_path):
    unpack_session(pack({around + name: text for name, text in FILES.items()}), tmp_path / "a")
    found = sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*.*"))
    assert found == ["a/session.toml", "a/traces/0001.csv", "a/traces/0002.csv"]


@pytest.mark.parametrize("name", ["../evil", "/evil", "a/../../evil", "..\\evil", "a/..\\..\\e"])
def test_an_archive_that_leads_out_of_its_folder_writes_nothing(name, tmp_path):
    with pytest.raises(PipelineError, match="must lie in its folder"):
        unpack_session(pack({"session.toml": DECLARED, name: "evil"}), tmp_path / "in" / "a")
    assert list(tmp_path.rglob("*")) == []


def test_a_damaged_archive_is_refused_and_leaves_no_part_of_a_session(tmp_path):
    """Bytes in the middle of a compressed member, which its list at the end cannot tell."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("session.toml", DECLARED)
        archive.writestr("traces/0001.csv", TRACE)
    content = bytearray(buffer.getvalue())
    begin = content.index(b"traces/0001.csv") + len("traces/0001.csv")
    content[begin : begin + 20] = b"\xff" * 20
    with pytest.raises(PipelineError, match="sound zip"):
        unpack_session(bytes(content), tmp_path / "a")
    # one name for a file and for a folder
    with pytest.raises(PipelineError):
        unpack_session(pack({"session.toml": DECLARED, "b": "0", "b/c": "1"}), tmp_path / "a")
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_archive_too_large_or_there_already_is_refused(tmp_path, monkeypatch):
    with pytest.raises(PipelineError, match="sound zip"):
        unpack_session(b"PK no archive", tmp_path / "a")
    monkeypatch.setattr("stepblocks.window.session_files._MOST_BYTES", 100)
    with pytest.raises(PipelineError, match="at most 100 bytes"):
        unpack_session(pack({"a": "0" * 101}), tmp_path / "a")
    monkeypatch.setattr("stepblocks.window.session_files.MOST_FILES", 2)
    with pytest.raises(PipelineError, match="at most 2 files"):
        unpack_session(pack(FILES), tmp_path / "a")
    (tmp_path / "b").mkdir()
    with pytest.raises(PipelineError, match="which is kept"):
        unpack_session(pack({"a": "0"}), tmp_path / "b")


@pytest.mark.parametrize("name", ["a.csv", ".zip", "..zip", "zip", "a\0.zip"])
def test_a_dropped_file_that_is_no_archive_by_its_name_is_not_taken(name, tmp_path):
    with pytest.raises(PipelineError):
        BenchForm(Folder(tmp_path), JobList(tmp_path)).choose_session_folder(name)


def test_settings_are_changed_where_they_stand_and_comments_stay(tmp_path):
    path = tmp_path / "session.toml"
    path.write_text(DECLARED)
    draft, other = SessionDraft(tmp_path), SessionDraft(tmp_path)
    for setting in SETTINGS:
        draft.write_setting(setting, draft.read_setting(setting))
    draft.save()
    assert path.read_text() == DECLARED
    draft.write_setting(BY_NAME["acquisition.channels.tangential"], "fz_n")
    draft.save()
    assert path.read_text() == DECLARED.replace("fx_n", "fz_n")
    with pytest.raises(PipelineError, match="was changed since it was opened here"):
        other.save()


def test_a_unit_and_a_factor_make_a_column_a_table_and_a_number_stays_a_number(tmp_path):
    path = tmp_path / "session.toml"
    path.write_text(DECLARED)
    draft = SessionDraft(tmp_path)
    draft.write_setting(BY_NAME["acquisition.channels.tangential.unit"], "mN")
    draft.write_setting(BY_NAME["acquisition.channels.tangential.factor"], "-1")
    draft.write_setting(BY_NAME["acquisition.channels.normal.factor"], "2.35 N/V")
    draft.save()
    channels = tomllib.loads(path.read_text())["acquisition"]["channels"]
    assert channels["tangential"] == {"column": "fx_n", "unit": "mN", "factor": -1.0}
    assert channels["normal"] == {"column": "fy_n", "factor": "2.35 N/V"}
    assert path.read_text().startswith("# of the second bench")
    again = SessionDraft(tmp_path)
    assert again.read_setting(BY_NAME["acquisition.channels.tangential"]) == "fx_n"
    again.write_setting(BY_NAME["acquisition.channels.tangential"], "fz_n")
    again.write_setting(BY_NAME["acquisition.channels.tangential.unit"], "")
    again.save()
    channels = tomllib.loads(path.read_text())["acquisition"]["channels"]
    assert channels["tangential"] == {"column": "fz_n", "factor": -1.0}
    with pytest.raises(BenchError, match="time must have a column before it has a unit"):
        again.write_setting(BY_NAME["acquisition.channels.time.unit"], "ms")


def test_a_session_without_a_file_begins_with_what_is_said(tmp_path):
    draft = SessionDraft(tmp_path)
    draft.write_setting(BY_NAME["acquisition.channels.normal"], 'f"y')
    draft.save()
    assert SessionDraft(tmp_path).read_setting(BY_NAME["acquisition.channels.normal"]) == 'f"y'
    (tmp_path / "session.toml").write_text("acquisition = 1\n[")
    with pytest.raises(BenchError, match="must be TOML"):
        SessionDraft(tmp_path)


@pytest.mark.parametrize("pattern", ["../{trial}.csv", "/etc/{trial}.csv", "a.h5", "", "{"])
def test_no_trace_is_looked_for_outside_the_session(pattern, tmp_path):
    (tmp_path / "1.csv").write_text(TRACE)
    folder = tmp_path / "session"
    folder.mkdir()
    (folder / "session.toml").write_text(f'[acquisition]\ntraces = "{pattern}"\n')
    assert SessionDraft(folder).find_first_trace() is None


def test_the_columns_with_numbers_of_the_first_trace_are_offered(tmp_path):
    unpack_session(pack(FILES), tmp_path / "a")
    trace = SessionDraft(tmp_path / "a").find_first_trace()
    assert trace == tmp_path / "a" / "traces" / "0001.csv"
    picture = read_and_draw_trace(trace)
    assert picture.columns == ("t_s", "fx_n", "fy_n")
    assert picture.image.startswith("data:image/png;base64,iVBOR")


CHECK = SessionCheck(
    looked_at=16,
    measured=15,
    reason="gap: 3 ms without samples",
    spring_constant=9810.0,
    spring=CalibrationCheck(Declared.SPRING, 0.501, 0.49, 0.512, contradicts=True, slip=0.5),
    load=CalibrationCheck(Declared.LOAD, 1.0, 0.99, 1.01, contradicts=False),
    rate=RateCheck(5000.0, 2.0, 2.0, 2.0, contradicts=True),
    ring_frequency=150.0,
    rings_as_usual=False,
    slip="the ramps show a spring of 4.92 N/mm",
    digest="0",
)


def test_what_the_traces_say_of_the_declaration_is_shown_with_intervals_and_likely_slips():
    spring, load, rate, ring = list_check_rows(CHECK)
    assert (spring.declared, spring.shown) == ("9.81 N/mm", "4.915 (4.807 to 5.023) N/mm")
    assert spring.ratio == "0.501 (0.490 to 0.512)"
    assert spring.verdict == "contradicted: about 1/2 of it"
    assert load.verdict == "agrees"
    assert (rate.shown, rate.verdict) == ("10000 Hz", "contradicted: about 2 times as much")
    assert ring.shown == "150 Hz"


def test_a_check_reads_back_as_it_was_written_and_a_damaged_one_is_one_line(tmp_path):
    path = tmp_path / "check.json"
    path.write_text(format_json_document({"schema": 1, **convert_to_json_values(CHECK)}))
    assert read_check_result(path) == CHECK
    for text in ("", "[]", '{"spring": 1}'):
        path.write_text(text)
        with pytest.raises(PipelineError, match="check of a session must be"):
            read_check_result(path)


async def open_checked(folder):
    """Open a session that was checked before; return what the page says."""
    async with user_simulation(root=Window(folder).build) as user:
        await user.open("/bench?session=b1")
        await user.should_see(marker="check", retries=100)
        return [label.text for label in user.find(kind=ui.label).elements]


@pytest.mark.long
def test_a_check_of_another_declaration_is_said_to_be_old(tmp_path):
    unpack_session(pack(FILES), tmp_path / "b1")
    (tmp_path / "out").mkdir()
    digest = hashlib.sha256((tmp_path / "b1" / "session.toml").read_bytes()).hexdigest()
    for written, is_old in ((digest, False), ("0", True)):
        document = {"schema": 1, **convert_to_json_values(replace(CHECK, digest=written))}
        (tmp_path / "out" / "b1-check.json").write_text(format_json_document(document))
        shown = asyncio.run(open_checked(tmp_path))
        assert "stepblocks measure b1 --check out/b1-check.json" in shown
        assert "the ramps show a spring of 4.92 N/mm" in shown
        assert (texts.CHECK_IS_OLD in shown) is is_old


async def drop_and_save(folder):
    """Drop an archive, name another column, and save; return what the page says then."""
    async with user_simulation(root=Window(folder).build) as user:
        await user.open("/bench")
        upload = next(iter(user.find(marker="drop").elements))
        content = pack({**FILES, "trials.csv": "trial\n"})
        await upload.handle_uploads([SmallFileUpload("b1.zip", "application/zip", content)])
        await user.should_see("First trace; its columns: t_s, fx_n, fy_n", retries=100)
        field = next(iter(user.find(marker="acquisition.channels.time").elements))
        field.set_value("t_s")
        user.find("Save").click()
        await user.should_see("b1 is saved", retries=50)
        await user.should_see("stepblocks loop sessions/b1 -o out/b1-loop")
        return [label.text for label in user.find(kind=ui.label).elements]


def test_a_dropped_session_is_opened_and_what_is_wrong_with_it_is_said(tmp_path):
    asyncio.run(drop_and_save(tmp_path))
    text = (tmp_path / "sessions" / "b1" / "session.toml").read_text()
    assert text.startswith("# of the second bench\n")
    assert 'time = "t_s"' in text
