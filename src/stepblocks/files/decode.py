"""The one decoder of text that others wrote: UTF-8, UTF-16, or a code page of Windows.

A mark at the begin decides; without one, what is valid UTF-8 is UTF-8. Anything else is taken as
the code page of Western Windows, and the reader says so.
"""

import codecs
from dataclasses import dataclass

from stepblocks.errors import StepblocksError

__all__ = [
    "DecodedText",
    "decode_text",
    "decode_unicode",
    "normalise_encoding_name",
    "strip_byte_order_mark",
]

# the longer marks first: that of UTF-32 begins as that of UTF-16 does
_ENCODING_BY_MARK = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
_MARK = "\ufeff"
_PROBED_BYTES = 4096  # in which UTF-16 without a mark shows itself
_FEWEST_ZEROS = 0.4  # share of the high bytes that are zero where the text is mostly Latin
_MOST_ZEROS = 0.05  # share of the low bytes that may be
_WESTERN = "cp1252"
# what may be declared: encodings of text alone, none of which runs code or unpacks bytes
_DECLARABLE = (
    *("utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "ascii"),
    *("iso8859-1", "iso8859-2", "iso8859-5", "iso8859-9", "iso8859-15", "mac-roman"),
    *("cp437", "cp850", "cp932", "cp936", "cp949", "cp950", "cp1250", "cp1251", "cp1252"),
    *("cp1253", "cp1254", "cp1255", "cp1256", "cp1257", "shift_jis", "gb18030", "big5", "euc_kr"),
)


@dataclass(frozen=True)
class DecodedText:
    """A text, and how its bytes were read.

    Attributes
    ----------
    text : str
        Without a mark.
    encoding : str
        Name of the encoding, as Python knows it.
    note : str
        What had to be assumed; empty where the bytes leave no doubt.
    """

    text: str
    encoding: str
    note: str = ""


def normalise_encoding_name(name: str) -> str:
    """Return Python's name of an encoding; raise a ValueError if it is not one of text."""
    try:
        known = codecs.lookup(name).name
    except (LookupError, ValueError):
        known = ""
    if known not in {codecs.lookup(encoding).name for encoding in _DECLARABLE}:
        known_names = "such as utf-8, utf-16, cp1252 or iso8859-1"
        raise ValueError(f"encoding must be one of text, {known_names}, got {name!r}")
    return known


def decode_text(
    raw: bytes, place: object, raises: type[StepblocksError], encoding: str | None = None
) -> DecodedText:
    """Decode the bytes of a text file.

    Parameters
    ----------
    raw : bytes
        The whole file.
    place : object
        Its name, for messages.
    raises : type of StepblocksError
        Raised where the bytes are no text of the encoding.
    encoding : str, optional
        What the file is declared to be, as `normalise_encoding_name` returns it; by default it is
        found.

    Returns
    -------
    DecodedText
        The text without its mark.
    """
    if encoding is not None:
        return DecodedText(_decode_as(raw, encoding, place, raises), encoding)
    for mark, marked in _ENCODING_BY_MARK.items():
        if raw.startswith(mark):
            return DecodedText(_decode_as(raw, marked, place, raises), marked)
    unmarked = _find_unmarked_utf16(raw)
    if unmarked:
        text = _decode_as(raw, unmarked, place, raises)
        return DecodedText(text, unmarked, f"read as {unmarked.upper()} without a mark")
    try:
        return DecodedText(raw.decode("utf-8"), "utf-8")
    except UnicodeDecodeError as error:
        text = _decode_western(raw, error, place, raises)
    return DecodedText(text, _WESTERN, "read as Windows-1252 (cp1252), since it is no UTF-8")


def decode_unicode(raw: bytes) -> str:
    """Decode UTF-8, or the encoding of the byte order mark; the mark is left out.

    Raises
    ------
    UnicodeDecodeError
        If the bytes are something else.
    """
    for mark, marked in _ENCODING_BY_MARK.items():
        if raw.startswith(mark):
            return strip_byte_order_mark(raw.decode(marked))
    return raw.decode("utf-8")


def strip_byte_order_mark(text: str) -> str:
    """Return a text without the byte order mark at its beginning, if there is one."""
    return text.removeprefix(_MARK)


def _decode_as(raw: bytes, encoding: str, place: object, raises: type[StepblocksError]) -> str:
    """Decode by a known encoding, without the mark."""
    try:
        return strip_byte_order_mark(raw.decode(encoding))
    except (UnicodeDecodeError, UnicodeError) as error:
        start = getattr(error, "start", 0)
        line = raw[:start].count(b"\n") + 1
        raise raises(
            f"text must be {encoding}: byte {start} is not [{place}, line {line}]"
        ) from error


def _find_unmarked_utf16(raw: bytes) -> str:
    """Return ``utf-16-le`` or ``utf-16-be`` for UTF-16 without a mark, else an empty text."""
    probe = raw[:_PROBED_BYTES]
    probe = probe[: len(probe) - len(probe) % 2]
    if len(probe) < 4:
        return ""
    pairs = len(probe) / 2
    even_zeros = probe[0::2].count(0) / pairs
    odd_zeros = probe[1::2].count(0) / pairs
    if odd_zeros > _FEWEST_ZEROS and even_zeros < _MOST_ZEROS:
        return "utf-16-le"
    if even_zeros > _FEWEST_ZEROS and odd_zeros < _MOST_ZEROS:
        return "utf-16-be"
    return ""


def _decode_western(
    raw: bytes, reason: UnicodeDecodeError, place: object, raises: type[StepblocksError]
) -> str:
    """Decode bytes that are not UTF-8 by the code page of Western Windows."""
    try:
        return raw.decode(_WESTERN)
    except UnicodeDecodeError as error:
        line = raw[: reason.start].count(b"\n") + 1
        raise raises(
            "text must be UTF-8, UTF-16 or Windows-1252 (or its encoding be declared), byte "
            f"{reason.start} is none of them [{place}, line {line}]"
        ) from error
