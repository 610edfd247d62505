"""Predict a set, as it is declared or as it was built."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from stepblocks.contact.operating_point import PAPER
from stepblocks.declaration.read import load_set
from stepblocks.declaration.set import StimulusSet
from stepblocks.errors import PipelineError
from stepblocks.mistakes import shorten_value
from stepblocks.predict.as_built import predict_as_declared, predict_blocks_by_serial
from stepblocks.records.as_built import read_records_by_serial


def predict_set(
    stimuli: StimulusSet | str | Path,
    *,
    dragged: bool | None = None,
    speed: float = PAPER.speed,
    as_built: Sequence[str | Path] = (),
) -> pd.DataFrame:
    """Predict every stimulus of a set under every tip, load and friction that it asks for.

    Parameters
    ----------
    stimuli : StimulusSet, str or Path
        The set, or its file.
    dragged : bool, optional
        Whether each row is dragged in time as well; by default up to 10,000 rows.
    speed : float
        Of the handle in those drags [m/s].
    as_built : sequence of str or Path
        As-built records of inspected blocks, or folders of them, or of folders by serial number:
        what was measured counts in place of the nominal; where a surface was scanned, the columns
        ``surface_...`` stand behind, and where there are serial numbers, ``serial`` before.

    Returns
    -------
    pandas.DataFrame
        One row for each stimulus, tip, step, direction, friction and load, in that order; the
        columns of ``predictions.csv`` (docs/explanation/uncertainty.md), the unit in each name,
        with all digits; behind them ``jnd_to_next``, the just noticeable differences to the next
        higher stimulus, with its interval.

    Raises
    ------
    StepblocksError
        If the file cannot be read or declares something impossible.
    """
    if not isinstance(stimuli, StimulusSet | str | Path):
        raise PipelineError(f"stimuli must be a set or its file, got {shorten_value(stimuli)}")
    if not isinstance(stimuli, StimulusSet):
        stimuli = load_set(Path(stimuli))
    if not as_built:
        return pd.DataFrame(predict_as_declared(stimuli, dragged, speed).rows)
    groups = read_records_by_serial(list(map(Path, as_built)))
    rows = []
    for predicted in predict_blocks_by_serial(stimuli, groups, dragged, speed):
        rows += predicted.rows
    return pd.DataFrame(rows)
