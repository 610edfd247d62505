"""Formats that traces are read from: one file each, and one line in the table below."""

from __future__ import annotations

from stepblocks.bench.sources import hdf5, mat, tdms, text
from stepblocks.bench.sources.base import Format, Place, TextLayout, TraceError

__all__ = ["FORMATS", "Format", "Place", "TextLayout", "TraceError"]

FORMATS: dict[str, Format] = {"csv": text.FORMAT, "hdf5": hdf5.FORMAT, "tdms": tdms.FORMAT, "mat": mat.FORMAT}
