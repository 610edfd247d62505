"""Compiled code is kept where something can be written, and works where nothing can."""

import os
from pathlib import Path

import numba

from stepblocks.compute import compiled


def test_without_a_place_for_compiled_code_a_folder_of_the_process_takes_its_place(monkeypatch):
    def refuse(**options):
        raise RuntimeError("cannot cache function: no locator available")

    monkeypatch.setattr(numba, "njit", refuse)
    monkeypatch.setattr(numba.config, "CACHE_DIR", "")
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    compiled._prepare_numba_cache()
    folder = numba.config.CACHE_DIR
    assert os.environ["NUMBA_CACHE_DIR"] == folder
    assert Path(folder).is_dir()
