"""Archives of several files whose bytes depend on nothing but what they hold."""

import io
import zipfile
from collections.abc import Callable

_PINNED_DATE = (1980, 1, 1, 0, 0, 0)  # the earliest that a zip archive can hold


def _keep_member_content(content: bytes) -> bytes:
    """Return a member as it is."""
    return content


def pin_archive_times(
    archive: bytes, change_member: Callable[[bytes], bytes] = _keep_member_content
) -> bytes:
    """Return a zip archive with the times of its members pinned.

    Parameters
    ----------
    archive : bytes
        Zip archive.
    change_member : callable
        From the content of a member to what takes its place.
    """
    buffer = io.BytesIO()
    with (
        zipfile.ZipFile(io.BytesIO(archive)) as source,
        zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=6) as target,
    ):
        for name in source.namelist():
            entry = zipfile.ZipInfo(name, _PINNED_DATE)
            target.writestr(entry, change_member(source.read(name)), zipfile.ZIP_DEFLATED)
    return buffer.getvalue()
