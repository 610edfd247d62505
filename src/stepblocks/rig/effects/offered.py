"""Effects that do not ship: a package offers them, or a user's own file."""

import os
import runpy
from functools import cache
from importlib import metadata
from pathlib import Path

from stepblocks.errors import ContactError
from stepblocks.lawsearch.law import Law

_OFFERED = "STEPBLOCKS_LAWS"  # environment variable: the file of the laws that a user offers


def offer_laws(file: str | Path) -> tuple[Law, ...]:
    """Offer the laws of a Python file of your own to all that follows in this process.

    `loop_session` asks for them as for those that ship, and models that hold them can be read.

    Parameters
    ----------
    file : str or Path
        Every `Law` that it defines is offered. It is run as a script: give none that you would not
        run.

    Returns
    -------
    tuple of Law
        What it defines.

    Raises
    ------
    ContactError
        If it cannot be run, or defines no law.
    """
    path = Path(file).resolve()
    # a file that was changed since is another one, also to workers, which begin with it
    changed_ns = 0
    if path.exists():
        changed_ns = path.stat().st_mtime_ns
    laws = _load_laws_from_file(path, changed_ns)
    os.environ[_OFFERED] = f"{changed_ns}:{path}"
    return laws


@cache
def _load_laws_from_file(path: Path, changed_ns: int) -> tuple[Law, ...]:
    """Run a file as it was at a time [ns] and return the laws that it defines."""
    try:
        names = runpy.run_path(str(path))
    except Exception as error:  # what a file of somebody else raises
        reason = f"{type(error).__name__}: {' '.join(str(error).split()):.200}"
        raise ContactError(f"laws cannot be loaded, {reason} [{path}]") from error
    # by their names or in lists; one that has a name and stands in a list is one
    laws: dict[int, Law] = {}
    for value in names.values():
        candidates = [value]
        if isinstance(value, list | tuple):
            candidates = list(value)
        for candidate in candidates:
            if isinstance(candidate, Law):
                laws[id(candidate)] = candidate
    if not laws:
        raise ContactError(f"laws must be stepblocks.Law, and there is none [{path}]")
    return tuple(laws.values())


@cache
def find_cached_entry_points(group: str) -> metadata.EntryPoints:
    """Return the entry points of a group, searched only once: it reads every installed package."""
    return metadata.entry_points(group=group)


def list_offered_laws() -> list[Law]:
    """Return entry points of the group ``stepblocks.effects``, then what `offer_laws` was given."""
    offered: list[Law] = []
    for entry in find_cached_entry_points(group="stepblocks.effects"):
        law = entry.load()
        if not isinstance(law, Law):
            raise ContactError(f"entry points of stepblocks.effects must be a Law, got {law!r:.60}")
        offered.append(law)
    if _OFFERED in os.environ:
        changed_ns, _, path = os.environ[_OFFERED].partition(":")
        offered += _load_laws_from_file(Path(path), int(changed_ns))
    return offered
