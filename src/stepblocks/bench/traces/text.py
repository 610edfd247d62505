"""Traces in text: a CSV per trial."""

from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from stepblocks.bench.faults import FaultKind, TraceError
from stepblocks.bench.signal import join_first
from stepblocks.bench.traces.reader import TextLayout, TraceReader, TrialPlace

if TYPE_CHECKING:
    import pandas as pd

_LONGEST_REASON = 120  # letters of a message of pandas


class TextReader(TraceReader["pd.DataFrame", "pd.DataFrame"]):
    """Reads a file of one trial; columns without names are counted from 0."""

    def open(self, path: Path, layout: TextLayout) -> "AbstractContextManager[pd.DataFrame]":
        """Read the whole file."""
        import pandas as pd

        header = 0 if layout.is_named else None
        try:
            table = pd.read_csv(
                path,
                sep=layout.delimiter,
                decimal=layout.decimal,
                skiprows=layout.skip_lines,
                header=header,
                skipinitialspace=True,
                float_precision="round_trip",
            )
        except (ValueError, UnicodeDecodeError, OSError) as error:
            text = str(error).strip() or type(error).__name__
            reason = text.splitlines()[0][:_LONGEST_REASON]
            raise TraceError(FaultKind.UNREADABLE, f"{path.name}: {reason}") from error
        if layout.is_named:
            table.columns = [str(name).strip() for name in table.columns]
        table.attrs["file"] = path.name
        return nullcontext(table)

    def find_group(self, file: "pd.DataFrame", place: TrialPlace) -> "pd.DataFrame":
        """Return the file itself."""
        return file

    def read_column(self, group: "pd.DataFrame", name: str | int) -> ArrayLike:
        """Return one column."""
        if name not in group.columns:
            raise TraceError(
                FaultKind.UNKNOWN_CHANNEL,
                f"{group.attrs['file']} has no {name!r}, it has "
                + join_first(map(str, group.columns)),
            )
        return np.asarray(group[name])
