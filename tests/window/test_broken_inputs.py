"""Whatever is dropped or typed: a message on the page, no traceback, nothing half-written.

And nothing outside the folder. The message is that of the command line, which reads the same file.
"""

import asyncio
import io
import struct
import zipfile

import pytest

pytest.importorskip("nicegui")

from nicegui import ElementFilter, ui
from nicegui.elements.upload_files import SmallFileUpload
from nicegui.testing.user_simulation import user_simulation

from stepblocks.declaration.read import load_set
from stepblocks.errors import StepblocksError
from stepblocks.quantities import format_units
from stepblocks.scans.read import read_scan
from stepblocks.window.draft import Draft
from stepblocks.window.scan_picture import read_and_draw_scan
from stepblocks.window.session_files import SessionDraft
from stepblocks.window.window import Window

GARBAGE = bytes(range(256)) * 40
DECLARED = '[[step_block]]\nid = "low"\nheight = "25 um"\n'
GIGABYTE = 1_000_000_000


def pack(files, compression=zipfile.ZIP_DEFLATED):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", compression) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return buffer.getvalue()


def declare_size(archive, size):
    """The archive with another size of its first file in its list at the end: a bomb."""
    place = archive.rindex(b"PK\x01\x02") + 24
    return archive[:place] + struct.pack("<I", size) + archive[place + 4 :]


def damage(archive, name):
    """The archive with bytes of the middle of a member overwritten."""
    begin = archive.index(name.encode()) + len(name)
    return archive[:begin] + b"\xff" * 12 + archive[begin + 12 :]


def encrypt(archive):
    """The archive with the flag of a password on every member."""
    return archive.replace(b"PK\x01\x02\x14\x03\x14\x00\x00", b"PK\x01\x02\x14\x03\x14\x00\x01")


TEXTS = {
    "empty.csv": b"",
    "blank.csv": b"\n\n \n",
    "header-alone.csv": b"x_um,z_um\n",
    "one-row.csv": b"x_um,z_um\n0,1\n",
    "words.csv": b"x_um,z_um\nleft,low\nright,high\n",
    "no-unit.csv": b"x,z\n0,1\n1,2\n2,3\n",
    "ragged.csv": b"x_um,z_um\n0,1\n1\n2,3,4\n",
    "binary.csv": GARBAGE,
    "no-utf-16.csv": b"\xff\xfex\x00_\xd8",
    "nul.csv": b"x_um,z_um\n0,\x00\n1,\x00\n",
    "huge-numbers.csv": b"x_um,z_um\n0,1e400\n1,1e400\n2,1e400\n",
    "backwards.csv": b"x_um,z_um\n0,1\n0,2\n0,3\n0,4\n",
    "page.txt": b"<!doctype html><html><body>none of ours</body></html>",
    "archive.csv": pack({"a.csv": "x_um,z_um\n0,1\n"}),
    "points.ply": b"ply\nformat ascii 1.0\nelement vertex 99\nend_header\n0 0 0\n",
    "surface.stl": b"solid none\n",
    "surface.obj": b"v 0 0\nf 1 2 3\n",
    "values.json": b'{"x": [0, 1',
    "evil.exe": b"MZ",
    ".hidden.csv": b"x_um,z_um\n0,1\n1,2\n",
}
INSTRUMENTS = {
    "empty.sur": b"",
    "garbage.gwy": GARBAGE,
    "garbage.sdf": GARBAGE,
    "garbage.tif": GARBAGE,
    "cut.x3p": pack({"main.xml": "<a/>"})[:40],
    "bomb.x3p": declare_size(pack({"main.xml": "0" * 1000}), 4 * GIGABYTE),
    "no-scan.plux": pack({"index.xml": "<xml/>"}),
}
SESSIONS = {
    "text.zip": b"no archive",
    "empty.zip": b"",
    "bomb.zip": declare_size(pack({"session.toml": "0" * 1000}), 4 * GIGABYTE),
    "up.zip": pack({"session.toml": DECLARED, "../evil.csv": "evil"}),
    "root.zip": pack({"/evil.csv": "evil"}),
    "damaged.zip": damage(pack({"session.toml": DECLARED * 20}), "session.toml"),
    "locked.zip": encrypt(pack({"session.toml": DECLARED})),
    "both.zip": pack({"b": "0", "b/c": "1", "session.toml": ""}),
    "session.rar": b"Rar!",
    "nothing.zip": pack({}),
    "folders.zip": pack({"a/": "", "a/b/": ""}),
    "..zip": pack({"session.toml": ""}),
    "no-toml.zip": pack({"session.toml": "[[["}),
    "no-text.zip": pack({"session.toml": b"\xff\xfe\x00"}),
    "table-as-text.zip": pack(
        {
            "session.toml": '[acquisition]\ntraces = "{trial}.csv"\n',
            "1.csv": b"\x00\x01",
        }
    ),
}
NAMES = (
    "../secret.toml",
    "/etc/passwd",
    "a\0b.toml",
    "notes.txt",
    f"{'a' * 400}.toml",
    "broken.toml",
    "latin.toml",
    "folder.toml",
)
ENTRIES = (
    "1e400 um",
    "25 kg",
    "-5 um",
    "nan um",
    "a" * 3000,
    '"',
    "{",
    "[[[",
    "\0",
    "=1+1",
    "٣ um",
)


def list_messages():
    """The messages of mistakes on a page."""
    labels = ElementFilter(kind=ui.label)
    return [label.text for label in labels if "mistake" in label.classes]


async def wait_for_message(user):
    for _ in range(600):
        with user:
            found = list_messages()
        if found:
            return found
        await asyncio.sleep(0.1)
    raise AssertionError("no message")


async def drop_all(folder, path, files):
    """Drop each file on a page, and return what the page says of it."""
    messages = {}
    async with user_simulation(root=Window(folder).build) as user:
        for name, content in files.items():
            await user.open(path)
            upload = next(iter(user.find(marker="drop").elements))
            await upload.handle_uploads([SmallFileUpload(name, "", content)])
            messages[name] = await wait_for_message(user)
    return messages


def list_files(folder):
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def drop_scans(base, files):
    folder = base / "lab"
    folder.mkdir()
    messages = asyncio.run(drop_all(folder, "/inspect", files))
    for name, (message,) in messages.items():
        assert "Traceback" not in message
        path = folder / "scans" / name
        if path.exists():  # what is taken is there as a whole, and read as the command reads it
            with pytest.raises(StepblocksError) as caught:
                read_scan(path)
            assert message == format_units(caught.value), name
    assert list_files(base) == {
        f"lab/scans/{name}": content
        for name, content in files.items()
        if name not in ("evil.exe", ".hidden.csv")
    }


@pytest.mark.long
def test_a_broken_scan_in_text_is_a_message_of_the_command(tmp_path):
    drop_scans(tmp_path, TEXTS)


async def drop_too_large(folder):
    """Hand in what the browser itself refuses for its size; return what each page says of it."""
    messages = []
    async with user_simulation(root=Window(folder).build) as user:
        for path in ("/inspect", "/bench"):
            await user.open(path)
            user.find(marker="drop").trigger("rejected")
            messages += await wait_for_message(user)
    return messages


def test_a_file_that_is_too_large_is_refused_with_a_message(tmp_path):
    expected = "a file that is handed in must have at most 256 MB"
    assert asyncio.run(drop_too_large(tmp_path)) == [expected, expected]


async def drop_many(folder, number):
    """Drop scans one behind another, and one that is none; return the name that is looked at."""
    async with user_simulation(root=Window(folder).build) as user:
        await user.open("/inspect")
        upload = next(iter(user.find(marker="drop").elements))
        content = b"x_um,z_um\n" + b"".join(b"%d,%d\n" % (row, row % 3) for row in range(50))
        files = [SmallFileUpload(f"s{place}.csv", "", content) for place in range(number)]
        files.insert(3, SmallFileUpload("none.exe", "", b""))
        await upload.handle_uploads(files)
        await user.should_see(marker="description", retries=200)
        for _ in range(100):
            if len(list((folder / "scans").glob("*.csv"))) == number:
                break
            await asyncio.sleep(0.05)
        await asyncio.sleep(0.5)
        with user:
            return list_messages()


def test_of_many_dropped_scans_all_are_taken_and_few_are_drawn(tmp_path, monkeypatch):
    drawn = []

    def draw(path, *arguments):
        drawn.append(path.name)
        return read_and_draw_scan(path, *arguments)

    monkeypatch.setattr("stepblocks.window.inspect_page.read_and_draw_scan", draw)
    messages = asyncio.run(drop_many(tmp_path, 30))
    assert len(list((tmp_path / "scans").glob("*.csv"))) == 30
    assert len(drawn) < 10
    assert [text.partition(" ")[0] for text in messages] == ["ending"]


@pytest.mark.long
def test_a_broken_file_of_an_instrument_is_a_message_of_the_command(tmp_path):
    drop_scans(tmp_path, INSTRUMENTS)


@pytest.mark.long
def test_a_broken_archive_of_a_session_is_a_message_and_leaves_no_part(tmp_path):
    folder = tmp_path / "lab"
    folder.mkdir()
    messages = asyncio.run(drop_all(folder, "/bench", SESSIONS))
    assert not any("Traceback" in text for found in messages.values() for text in found)
    whole = ("no-toml", "no-text", "table-as-text")  # sound archives, of which a file is not
    assert {path.name for path in (folder / "sessions").iterdir()} == set(whole)
    assert {path.name for path in tmp_path.iterdir()} == {"lab"}


async def open_all(folder):
    """Open each name on the page to declare, then type each entry; return all messages."""
    messages = {}
    async with user_simulation(root=Window(folder).build) as user:
        for name in NAMES:
            await user.open("/declare")
            field = next(iter(user.find(kind=ui.input).elements))
            field.set_value(name)
            user.find("Open").click()
            messages[name] = await wait_for_message(user)
        await user.open("/declare?file=mine.toml")
        for entry in ENTRIES:
            field = next(iter(user.find(marker="height", kind=ui.input).elements))
            field.set_value(entry)
            for _ in range(600):
                if field.error:
                    break
                await asyncio.sleep(0.05)
            messages[entry] = [field.error or ""]
            field.set_value("25 um")
            for _ in range(600):
                if not field.error:
                    break
                await asyncio.sleep(0.05)
        field.set_value("25 kg")
        user.find("Save").click()
        messages["saved"] = await wait_for_message(user)
    return messages


@pytest.mark.long
def test_a_wrong_name_or_entry_is_a_message_where_it_was_typed_and_saves_nothing(tmp_path):
    folder = tmp_path / "lab"
    (folder / "folder.toml").mkdir(parents=True)
    (folder / "mine.toml").write_text(DECLARED)
    (folder / "broken.toml").write_text("[[step_block]]\nheight = \n")
    (folder / "latin.toml").write_bytes(b'title = "\xe4"\n')
    (tmp_path / "secret.toml").write_text('title = "secret"')
    before = list_files(tmp_path)
    messages = asyncio.run(open_all(folder))
    assert [name for name, found in messages.items() if not found[0]] == []
    assert not any("Traceback" in text for found in messages.values() for text in found)
    assert list_files(tmp_path) == before


SETTINGS = """schema = 1
[probe]
spring_constant = "9.81 N/mm"
tip_radius = "125 um"
[acquisition]
sample_rate = "10 kHz"
traces = "t/{trial}.csv"
[acquisition.channels]
tangential = "fx_n"
normal = "fy_n"
"""
BRACKETS = "[" * 3000 + "]" * 3000
# a session that lies in the folder: its files, and what the page says of it
FOUND = {
    "header-alone": ({"session.toml": SETTINGS, "t/1.csv": "time_s,fx_n\n"}, "named columns"),
    "without-log": ({"session.toml": SETTINGS}, ""),
    "latin": ({"session.toml": "title = 'Pr\xfcfung'".encode("latin-1")}, "UTF-8"),
    "deep": ({"session.toml": f"a = {BRACKETS}"}, "must be TOML"),
    "folder-as-file": ({"session.toml/a.txt": ""}, "must be a file, got a folder"),
    "folder-as-trace": ({"session.toml": SETTINGS, "t/1.csv/a.txt": ""}, "directory"),
    "damaged-check": ({"session.toml": SETTINGS, "../out/damaged-check-check.json": "[]"}, "check"),
    "damaged-loop": (
        {
            "session.toml": SETTINGS,
            "../out/damaged-loop-loop/result.json": '{"next_experiment": {"separates": 5}}',
        },
        "result of a loop",
    ),
}


def put_files(folder, files):
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())


async def open_found(folder):
    """Open each session, and then every page; return their messages and labels."""
    messages = {}
    labels = []
    async with user_simulation(root=Window(folder).build) as user:
        for name, (_, message) in FOUND.items():
            await user.open(f"/bench?session={name}")
            if message:
                messages[name] = await wait_for_message(user)
            if name in ("header-alone", "without-log"):
                await user.should_see(marker="acquisition.channels.tangential", retries=50)
        for page in ("/", "/declare?file=deep.toml", "/build", "/study", "/set"):
            await user.open(page)
            await asyncio.sleep(0.2)
            with user:
                labels += [label.text for label in ElementFilter(kind=ui.label)]
    return messages, labels


def test_whatever_lies_in_the_folder_every_page_opens_and_says_what_is_wrong(tmp_path):
    """Thousands of brackets in one file of the folder once ended every page."""
    folder = tmp_path / "lab"
    for name, (files, _) in FOUND.items():
        put_files(folder / name, files)
    (folder / "deep.toml").write_text(f'[[step_block]]\nid = "a"\nheight = {BRACKETS}\n')
    (folder / "zero.toml").touch()
    messages, labels = asyncio.run(open_found(folder))
    for name, found in messages.items():
        assert FOUND[name][1] in " ".join(found), name
    assert not any("500" in text or "Traceback" in text for text in labels)
    assert any("nested too deeply" in text for text in labels)


def test_a_stimulus_file_with_a_mark_at_its_begin_stays_the_same_bytes(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_bytes(b"\xef\xbb\xbf" + DECLARED.encode())
    draft = Draft(path)
    (place,) = draft.list_stanzas()
    draft.write_field(place, ("height",), "30 um")
    draft.save()
    assert path.read_bytes() == b"\xef\xbb\xbf" + DECLARED.replace("25", "30").encode()
    assert load_set(path).stimuli[0].id == "low"
    session = tmp_path / "session.toml"
    session.write_bytes(b"\xef\xbb\xbf" + SETTINGS.encode())
    draft = SessionDraft(tmp_path)
    draft.save()
    assert session.read_bytes() == b"\xef\xbb\xbf" + SETTINGS.encode()


async def say(folder, path, answers):
    """Type one answer after another into a form; return what the page says to each."""
    messages = {}
    async with user_simulation(root=Window(folder).build) as user:
        for name, answer in answers:
            await user.open(path)
            field = next(iter(user.find(marker=name).elements))
            field.set_value(answer)
            messages[answer] = await wait_for_message(user)
    return messages


@pytest.mark.repeats
@pytest.mark.parametrize(
    ("path", "names"), [("/set", ("file", "plot")), ("/study", ("folder", "answers", "report"))]
)
def test_no_form_gives_a_command_that_writes_outside_the_folder(path, names, tmp_path):
    folder = tmp_path / "lab"
    folder.mkdir()
    (folder / "mine.toml").write_text(DECLARED)
    (folder / "study").mkdir()
    (folder / "study" / "design.csv").touch()
    answers = [(name, f"../{name}") for name in names]
    messages = asyncio.run(say(folder, path, answers))
    assert all("must lie in the folder" in found[0] for found in messages.values())


def test_a_wrong_answer_of_a_set_is_a_message_that_names_it(tmp_path):
    answers = [("number", "1e9"), ("friction", "low"), ("load", "nan N"), ("targets", "5 kg")]
    messages = asyncio.run(say(tmp_path, "/set", answers))
    assert "number must be a whole number" in messages["1e9"][0]
    assert "friction must be a number" in messages["low"][0]
    assert "must be a force" in messages["nan N"][0]
