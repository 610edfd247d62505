"""Where a resumable run keeps its results: a folder, or a place in an object store.

A store holds files by name, without folders in it. What is written is there whole or not at all:
a folder gets a finished file by renaming, an object store takes an object in one piece.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import TYPE_CHECKING

from stepblocks.errors import PipelineError
from stepblocks.files.atomic import lock_folder, replace_bytes
from stepblocks.files.text import is_file, measure_file_size

if TYPE_CHECKING:
    from fsspec import AbstractFileSystem


def is_object_store_address(place: str | Path) -> bool:
    """Tell whether a place is an address such as ``"s3://bucket/sweep"`` and no folder."""
    return isinstance(place, str) and "://" in place


def open_store(place: str | Path) -> "ResultStore":
    """Open the store that a user means.

    Parameters
    ----------
    place : str or Path
        A folder, or an address that fsspec knows, such as ``"s3://bucket/sweep"``.

    Returns
    -------
    FolderStore or ObjectStore

    Raises
    ------
    PipelineError
        If fsspec or its package for the protocol is missing, or the store cannot be reached.
    """
    if not is_object_store_address(place):
        return FolderStore(Path(place))
    return ObjectStore(str(place).rstrip("/"))


@dataclass(frozen=True)
class FolderStore:
    """A folder of this machine, or one that it shares with others."""

    folder: Path

    @property
    def location(self) -> str:
        """Path of the folder, for messages."""
        return str(self.folder)

    def read(self, name: str) -> bytes | None:
        """Return what a file holds; None where there is no such file.

        Raises
        ------
        OSError
            If there is something else of that name, or it cannot be read.
        """
        path = self.folder / name
        if not path.exists():
            return None
        measure_file_size(path)  # refuses a pipe, which would be waited for
        return path.read_bytes()

    def write(self, name: str, content: bytes) -> None:
        """Put a file in place, whole or not at all."""
        replace_bytes(self.folder / name, content)

    def remove(self, name: str) -> None:
        """Remove a file; what is no file stays."""
        path = self.folder / name
        if is_file(path):
            path.unlink()

    def has_any(self, pattern: str) -> bool:
        """Tell whether there is a file of such a name."""
        return any(self.folder.glob(pattern))

    @contextmanager
    def hold_share(self, share: str) -> Iterator[None]:
        """Make the folder and keep other runs of the same share out of it meanwhile."""
        with lock_folder(self.folder, share):
            yield


@dataclass(frozen=True)
class ObjectStore:
    """A place in a store that fsspec reaches, such as ``"s3://bucket/sweep"``.

    It is opened anew in each process. Object stores have no locks: two runs of one plan at the
    same time compute more than they must, and write the same bytes.
    """

    address: str

    @property
    def location(self) -> str:
        """Address of the store, for messages."""
        return self.address

    def read(self, name: str) -> bytes | None:
        """Return what an object holds; None where there is no such object."""
        system, path = self._find_system_and_path(name)
        with _translate_store_errors(self.address):
            try:
                content: bytes = system.cat_file(path)
            except FileNotFoundError:
                return None
            return content

    def write(self, name: str, content: bytes) -> None:
        """Put an object in place in one piece."""
        system, path = self._find_system_and_path(name)
        with _translate_store_errors(self.address):
            # where names have no root the first one is a bucket, which nobody asked to make
            if system.root_marker:
                system.makedirs(path.rpartition("/")[0], exist_ok=True)
            system.pipe_file(path, content)

    def remove(self, name: str) -> None:
        """Remove an object, where it is there."""
        system, path = self._find_system_and_path(name)
        with _translate_store_errors(self.address):
            if system.exists(path):
                system.rm_file(path)

    def has_any(self, pattern: str) -> bool:
        """Tell whether there is an object of such a name."""
        system, folder = self._find_system_and_path("")
        with _translate_store_errors(self.address):
            try:
                found = system.ls(folder.rstrip("/"), detail=False)
            except FileNotFoundError:
                return False
        return any(fnmatchcase(str(path).rpartition("/")[2], pattern) for path in found)

    @contextmanager
    def hold_share(self, share: str) -> Iterator[None]:
        """Make sure that the store can be reached; it has no locks."""
        self.has_any("*")
        yield

    def _find_system_and_path(self, name: str) -> "tuple[AbstractFileSystem, str]":
        """Return the file system and the path of an object."""
        try:
            from fsspec.core import url_to_fs
        except ImportError as error:
            raise PipelineError(
                "an address needs fsspec: install the extra with pip install "
                f"'stepblocks[cluster]' [{self.address}]"
            ) from error
        with _translate_store_errors(self.address):
            try:
                system, path = url_to_fs(f"{self.address}/{name}")
            except ValueError as error:
                raise PipelineError(
                    "address must be of a kind that fsspec knows, such as s3://bucket/sweep: "
                    f"{error} [{self.address}]"
                ) from error
        return system, path


ResultStore = FolderStore | ObjectStore


@contextmanager
def _translate_store_errors(address: str) -> Iterator[None]:
    """Turn what a store or its package says into an error that names the address."""
    try:
        yield
    except FileNotFoundError as error:
        raise PipelineError(f"store has no such place: {error} [{address}]") from error
    except ImportError as error:
        raise PipelineError(
            f"this kind of address needs a package that is not installed: {error} [{address}]"
        ) from error
    except PipelineError:
        raise
    except Exception as error:  # each store has errors of its own
        reason = " ".join(str(error).split()) or type(error).__name__
        raise PipelineError(f"store cannot be used: {reason} [{address}]") from error
