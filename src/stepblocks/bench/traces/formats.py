"""The formats of traces by their names in session.toml."""

from typing import Any

from stepblocks.bench.traces.hdf5 import Hdf5Reader
from stepblocks.bench.traces.mat import MatReader
from stepblocks.bench.traces.reader import TraceReader
from stepblocks.bench.traces.tdms import TdmsReader
from stepblocks.bench.traces.text import TextReader
from stepblocks.bench.traces.wav import WavReader

READERS: dict[str, TraceReader[Any, Any]] = {
    "csv": TextReader(),
    "hdf5": Hdf5Reader(),
    "tdms": TdmsReader(),
    "mat": MatReader(),
    "wav": WavReader(),
}
