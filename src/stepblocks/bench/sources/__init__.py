"""Where traces come from: one module per file format, each with the same two methods."""

from __future__ import annotations

from stepblocks.bench.sources.base import TraceFault, TraceSource
from stepblocks.bench.sources.opening import open_source, read_trace

__all__ = ["TraceFault", "TraceSource", "open_source", "read_trace"]
