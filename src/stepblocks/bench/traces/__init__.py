"""The traces of a session, as CSV or in one of the formats of this folder."""

from stepblocks.bench.traces.formats import READERS
from stepblocks.bench.traces.session_traces import Drags, Traces

__all__ = ["READERS", "Drags", "Traces"]
