"""Where traces come from: one module per file format, each with the same two methods."""

from __future__ import annotations

from stepblocks.bench.sources.base import TraceError, TraceSource
from stepblocks.bench.sources.opening import open_source, read_trace

__all__ = ["TraceError", "TraceSource", "open_source", "read_trace"]
