"""A bench session while it is put together: an archive becomes a folder, its settings a form."""

import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from io import BytesIO
from pathlib import Path, PurePosixPath
from typing import Any

import tomlkit

from stepblocks.errors import BenchError, PipelineError
from stepblocks.files.atomic import make_draft_folder, move_into_place, replace_text
from stepblocks.files.packed import unpack_folder
from stepblocks.files.text import is_file
from stepblocks.mistakes import shorten_value
from stepblocks.window import texts
from stepblocks.window.gate import MOST_FILES
from stepblocks.window.saving import hold_for_saving
from stepblocks.window.toml_text import BYTE_ORDER_MARK, MalformedTomlError, parse_toml_document

SESSION_FILE = "session.toml"
# what a damaged archive ends in, a compression that is not known (a RuntimeError), and a password
_UNSOUND = (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError)
_MOST_BYTES = 1_000_000_000  # of all files of an archive together


class ChannelPart(Enum):
    """What a channel of the traces declares; the value is its key."""

    COLUMN = "column"
    UNIT = "unit"
    FACTOR = "factor"


@dataclass(frozen=True)
class Setting:
    """A field of ``session.toml`` that the form asks for.

    Attributes
    ----------
    path : tuple of str
        Its tables and its name.
    label : str
    part : ChannelPart, optional
        Which part of a channel of the traces it is; None where it is no channel.
    """

    path: tuple[str, ...]
    label: str
    part: ChannelPart | None = None

    @property
    def is_column(self) -> bool:
        """Whether it names a column of the traces."""
        return self.part is ChannelPart.COLUMN

    @property
    def name(self) -> str:
        """Its name with dots, as in a message."""
        if self.part in (None, ChannelPart.COLUMN):
            return ".".join(self.path)
        return ".".join((*self.path, self.part.value))


def _list_channel_settings(channel: str, label: str) -> tuple[Setting, ...]:
    """List the settings of a channel in the form: its column, its unit and its factor."""
    path = ("acquisition", "channels", channel)
    return (
        Setting(path, label, ChannelPart.COLUMN),
        Setting(path, texts.UNIT_PART, ChannelPart.UNIT),
        Setting(path, texts.FACTOR_PART, ChannelPart.FACTOR),
    )


SETTINGS = (
    *_list_channel_settings("tangential", texts.TANGENTIAL),
    *_list_channel_settings("normal", texts.NORMAL),
    *_list_channel_settings("time", texts.TIME),
    Setting(("acquisition", "sample_rate"), texts.SAMPLE_RATE),
    Setting(("acquisition", "range"), texts.RANGE),
    Setting(("acquisition", "traces"), texts.TRACES),
    Setting(("probe", "spring_constant"), texts.SPRING),
    Setting(("probe", "tip_radius"), texts.TIP_RADIUS),
)


def unpack_session(content: bytes, folder: Path) -> None:
    """Unpack an archive of a session into a folder that is not there yet.

    A single folder around all files of the archive is left out.

    Raises
    ------
    PipelineError
        If it is no archive, holds too much, leads out of the folder, or the folder is there.
    """
    if folder.exists():
        raise PipelineError(texts.FOLDER_IS_THERE.format(name=folder.name))
    try:
        with zipfile.ZipFile(BytesIO(content)) as archive:
            entries = [entry for entry in archive.infolist() if not entry.is_dir()]
            if not entries:
                raise PipelineError(texts.EMPTY_ARCHIVE)
            if len(entries) > MOST_FILES:
                raise PipelineError(
                    texts.TOO_MANY_FILES.format(most=MOST_FILES, count=len(entries))
                )
            size = sum(entry.file_size for entry in entries)
            if size > _MOST_BYTES:
                raise PipelineError(texts.TOO_MANY_BYTES.format(most=_MOST_BYTES, size=size))
            files = {entry.filename: archive.read(entry) for entry in entries}
    except _UNSOUND as error:
        raise PipelineError(texts.UNSOUND_ARCHIVE.format(reason=error)) from error
    for name in files:
        if "\\" in name or ".." in PurePosixPath(name).parts or name.startswith("/"):
            raise PipelineError(texts.ARCHIVED_OUTSIDE.format(name=shorten_value(name)))
    with make_draft_folder(folder) as draft:
        unpack_folder(_strip_common_folder(files), draft)
        move_into_place(draft, folder)


def _strip_common_folder(files: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return files without the single folder around all of them."""
    tops = {PurePosixPath(name).parts[0] for name in files}
    is_wrapped = len(tops) == 1 and all("/" in name for name in files)
    if not is_wrapped:
        return dict(files)
    return {name.partition("/")[2]: content for name, content in files.items()}


class SessionDraft:
    """The settings of a session that is being put together; comments and order stay.

    Parameters
    ----------
    folder : Path
        Of the session.

    Raises
    ------
    BenchError
        If its file is no TOML.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._path = folder / SESSION_FILE
        self._before = self._read_text_or_none()
        try:
            text = self._before or "schema = 1\n"
            self._document = parse_toml_document(text.removeprefix(BYTE_ORDER_MARK))
        except MalformedTomlError as error:
            raise BenchError(texts.NO_TOML.format(name=SESSION_FILE, reason=error)) from error

    def _read_text_or_none(self) -> str | None:
        """Return the file as it stands; None where there is none."""
        if self._path.is_dir():
            raise BenchError(texts.FOLDER_FOR_FILE.format(name=SESSION_FILE))
        if not is_file(self._path):
            return None
        try:
            return self._path.read_bytes().decode("utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise BenchError(texts.NO_TEXT.format(name=SESSION_FILE, reason=error)) from error

    def read_setting(self, setting: Setting) -> str:
        """Return what the file says of a setting; empty where it says nothing or holds a table."""
        value: Any = self._document
        for name in setting.path:
            if not isinstance(value, Mapping) or name not in value:
                return ""
            value = value[name]
        if setting.part is not None:
            value = _read_channel_part(value, setting.part)
        return "" if isinstance(value, Mapping) else str(value)

    def write_setting(self, setting: Setting, text: str) -> None:
        """Set a setting; an empty text leaves it as it is, but takes a unit or factor away."""
        text = " ".join(text.split())
        if text == self.read_setting(setting):
            return
        if not text and setting.part in (None, ChannelPart.COLUMN):
            return
        table: Any = self._document
        for name in setting.path[:-1]:
            if name not in table:
                table[name] = tomlkit.table()
            table = table[name]
            if not isinstance(table, Mapping):
                raise BenchError(texts.NO_TABLE.format(name=name, field=setting.path[-1]))
        if setting.part is None:
            table[setting.path[-1]] = text
        else:
            _write_channel_part(table, setting, setting.part, text)

    def save(self) -> None:
        """Write the file.

        Raises
        ------
        PipelineError
            If somebody changed it meanwhile, or it cannot be written.
        """
        text = tomlkit.dumps(self._document)
        if self._before is not None and self._before.startswith(BYTE_ORDER_MARK):
            text = BYTE_ORDER_MARK + text
        with hold_for_saving(self._path):
            if self._read_text_or_none() != self._before:
                raise PipelineError(texts.WAS_CHANGED.format(name=SESSION_FILE))
            replace_text(self._path, text)
        self._before = text

    def find_first_trace(self) -> Path | None:
        """Return the first trace in text that the pattern of traces means; None without one."""
        pattern = self.read_setting(Setting(("acquisition", "traces"), ""))
        parts = PurePosixPath(pattern).parts
        is_inside = bool(parts) and ".." not in parts and not pattern.startswith("/")
        if not is_inside or not pattern.endswith((".csv", ".txt", ".tsv")):
            return None
        begin, _, field_and_end = pattern.partition("{")
        if field_and_end:
            end = field_and_end.partition("}")[2]
            pattern = f"{begin}*{end}"
        return next(iter(sorted(self.folder.glob(pattern))), None)


def _read_channel_part(channel: object, part: ChannelPart) -> object:
    """Return a part of a channel, which may be its column alone; empty where it has no such."""
    if isinstance(channel, Mapping):
        return channel.get(part.value, "")
    if part is ChannelPart.COLUMN:
        return channel
    return ""


def _write_channel_part(channels: Any, setting: Setting, part: ChannelPart, text: str) -> None:
    """Set a part of a channel; with a unit or factor its column alone becomes a table."""
    name = setting.path[-1]
    channel = channels.get(name)
    if not isinstance(channel, Mapping):
        if part is ChannelPart.COLUMN:
            channels[name] = text
            return
        if channel is None:
            raise BenchError(texts.NO_COLUMN.format(name=name, part=part.value))
        table = tomlkit.inline_table()
        table[ChannelPart.COLUMN.value] = channel
        channels[name] = table
        channel = channels[name]
    if not text:
        del channel[part.value]
    elif part is ChannelPart.FACTOR:
        channel[part.value] = _parse_factor(text)
    else:
        channel[part.value] = text


def _parse_factor(text: str) -> float | str:
    """Return a factor as a number where it is one, else as it is written (2.35 N/V)."""
    try:
        return float(text)
    except ValueError:
        return text
