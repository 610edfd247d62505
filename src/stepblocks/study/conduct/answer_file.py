"""The answers of one participant on the disk, each there before the next trial is shown."""

from collections.abc import Sequence
from pathlib import Path

from stepblocks.errors import StudyError
from stepblocks.files.atomic import replace_text
from stepblocks.files.tables import format_csv
from stepblocks.files.text import is_file
from stepblocks.study.analysis.judgements import STAMPS
from stepblocks.study.columns import Row
from stepblocks.study.design.read import SheetRow, read_answers
from stepblocks.study.design.sheet import list_sheet_columns

# Columns beside those of a run sheet: when the trial was shown and answered (UTC), the time
# between, and what the participant noted
TIMES = (*STAMPS, "comment")


class AnswerFile:
    """The file of a run.

    Parameters
    ----------
    path : Path
        Of the file.
    experiment : str
        Kind of experiment.
    """

    def __init__(self, path: Path, experiment: str) -> None:
        self.path = path
        self._experiment = experiment
        self._columns = (*list_sheet_columns(experiment), *TIMES)

    def read_answered_rows(self) -> list[SheetRow]:
        """Read the answered trials; a last line that a crash cut short is dropped.

        Raises
        ------
        StudyError
            If they cannot be read.
        """
        if not self.path.exists():
            return []
        if not is_file(self.path):
            raise StudyError(f"answers cannot be read: Not a plain file [{self.path}]")
        text = self.path.read_text(encoding="utf-8-sig")
        whole = text
        if not text.endswith("\n"):
            whole = text[: text.rfind("\n") + 1]
        header = ",".join(self._columns)
        if whole != text:
            replace_text(self.path, whole or header + "\n")
        return read_answers(self.path, self._experiment)

    def was_saved_by_other_program(self) -> bool:
        """Return whether another program saved the file, with other separators or decimals."""
        text = self.path.read_text(encoding="utf-8-sig")
        return text.partition("\n")[0] != ",".join(self._columns)

    def write_answered_rows(self, rows: Sequence[Row]) -> None:
        """Write all answered trials."""
        cells = [{name: row.get(name, "") for name in self._columns} for row in rows]
        replace_text(self.path, format_csv(cells, self._columns))
