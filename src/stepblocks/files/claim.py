"""A folder of a run that can be resumed: it belongs to one plan, whose file lies in it."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass

from stepblocks.errors import PipelineError
from stepblocks.files.store import ResultStore


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

    def claim_folder(self, store: ResultStore) -> None:
        """Write the plan into a folder, or make sure that the same one lies there.

        Raises
        ------
        PipelineError
            If the folder holds results of another plan, or results without one.
        """
        if self._holds_plan(store):
            if self._read_digest(store) != self.digest:
                raise PipelineError(
                    f"folder holds {self.other_words}, or of another version of "
                    f"stepblocks; choose another folder [{store.location}]"
                )
            return
        # looked for again: another run of the same plan may have begun meanwhile
        if store.has_any(self.results) and not self._holds_plan(store):
            raise PipelineError(
                f"folder holds {self.result_words} without {self.file_name}; choose another "
                f"folder [{store.location}]"
            )
        text = json.dumps(self.record, indent=1, sort_keys=True) + "\n"
        store.write(self.file_name, text.encode())

    def _holds_plan(self, store: ResultStore) -> bool:
        """Tell whether a plan lies in a folder."""
        return store.has_any(self.file_name)

    def _read_digest(self, store: ResultStore) -> object:
        """Read the digest of the plan that a folder was filled by."""
        try:
            content = store.read(self.file_name) or b""
            return json.loads(content.decode("utf-8")).get("digest")
        except (OSError, ValueError, AttributeError, RecursionError) as error:
            raise PipelineError(
                f"{self.file_name} cannot be read; choose another folder [{store.location}]"
            ) from error


def hash_plan(content: Mapping[str, object]) -> str:
    """Hash plain values, whatever the order of their keys."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
