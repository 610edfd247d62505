"""A folder in memory: what a worker of another machine made travels back so."""

from collections.abc import Mapping
from pathlib import Path, PurePosixPath

from stepblocks.errors import PipelineError

PackedFolder = Mapping[str, bytes]


def pack_folder(folder: Path) -> dict[str, bytes]:
    """Read all files of a folder; their names are relative to it, with slashes."""
    files = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            files[path.relative_to(folder).as_posix()] = path.read_bytes()
    return files


def unpack_folder(files: PackedFolder, folder: Path) -> None:
    """Write packed files into an empty folder.

    Raises
    ------
    PipelineError
        If a name leads out of the folder.
    """
    for name, content in files.items():
        parts = PurePosixPath(name).parts
        if not parts or ".." in parts or PurePosixPath(name).is_absolute():
            raise PipelineError(f"a worker must return files below its folder, got {name!r}")
        path = folder.joinpath(*parts)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
