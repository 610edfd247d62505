"""Compiled functions, kept for the next run where anything can be written, else for this run alone.

Numba keeps them beside their source or below the home folder. In a container, a laboratory account
or a package store it can write to neither, and refuses to compile; there a folder that ends with
the process takes its place.
"""

import atexit
import os
import shutil
import tempfile
from typing import Any

import numba as compiler

__all__ = ["njit", "numba"]


def _do_nothing_compiled() -> None:
    """Do nothing: it is compiled to try whether Numba can keep compiled functions."""


def _prepare_numba_cache() -> Any:
    """Return Numba; where it can keep compiled functions nowhere, give it a temporary folder."""
    try:
        compiler.njit(cache=True)(_do_nothing_compiled)
    except RuntimeError:
        # nobody else can write to it: Numba trusts what it finds there
        folder = tempfile.mkdtemp(prefix="stepblocks-compiled-")
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
        os.environ["NUMBA_CACHE_DIR"] = folder
        compiler.config.CACHE_DIR = folder
    return compiler


numba = _prepare_numba_cache()
njit = numba.njit
