"""A folder of a run that can be resumed: it belongs to one plan, whose file lies in it."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from stepblocks.errors import PipelineError
from stepblocks.files.atomic import replace_text
from stepblocks.files.text import measure_file_size


@dataclass(frozen=True)
class FolderClaim:
    """What claims a folder.

    Attributes
    ----------
    file_name : str
        File of the plan.
    results : str
        Pattern of what a run writes, such as ``"part-*.parquet"``.
    result_words, other_words : str
        What a run writes, and what a folder of another plan holds, in words for messages.
    digest : str
        Of all that the results depend on.
    record : mapping
        Contents of the plan's file, with the digest in it.
    """

    file_name: str
    results: str
    result_words: str
    other_words: str
    digest: str
    record: Mapping[str, object]

    def take(self, folder: Path) -> None:
        """Write the plan into a folder, or make sure that the same one lies there.

        Raises
        ------
        PipelineError
            If the folder holds results of another plan, or results without one.
        """
        path = folder / self.file_name
        if path.exists():
            if self._read_digest(path, folder) != self.digest:
                raise PipelineError(
                    f"folder holds {self.other_words}, or of another version of "
                    f"stepblocks; choose another folder [{folder}]"
                )
            return
        # looked for again: another run of the same plan may have begun meanwhile
        if any(folder.glob(self.results)) and not path.exists():
            raise PipelineError(
                f"folder holds {self.result_words} without {self.file_name}; choose another "
                f"folder [{folder}]"
            )
        replace_text(path, json.dumps(self.record, indent=1, sort_keys=True) + "\n")

    def _read_digest(self, path: Path, folder: Path) -> object:
        """Digest of the plan that a folder was filled by."""
        try:
            measure_file_size(path)  # refuses a pipe, which would be waited for
            return json.loads(path.read_text(encoding="utf-8")).get("digest")
        except (OSError, ValueError, AttributeError, RecursionError) as error:
            raise PipelineError(
                f"{self.file_name} cannot be read; choose another folder [{folder}]"
            ) from error


def hash_plan(content: Mapping[str, object]) -> str:
    """Hash plain values, whatever the order of their keys."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
