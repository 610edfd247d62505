"""Effects that do not ship: a package offers them, or a user's own file."""

import os
import runpy
from functools import cache
from importlib.metadata import entry_points
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
    # what was changed since is another file, also to workers, which begin with it
    offered = f"{path.stat().st_mtime_ns if path.exists() else 0}:{path}"
    found = _run_laws(offered)
    os.environ[_OFFERED] = offered
    return found


@cache
def _run_laws(offered: str) -> tuple[Law, ...]:
    path = offered.partition(":")[2]
    try:
        names = runpy.run_path(path)
    except Exception as error:  # what a file of somebody else raises
        reason = f"{type(error).__name__}: {' '.join(str(error).split()):.200}"
        raise ContactError(f"laws cannot be loaded, {reason} [{path}]") from error
    # by their names or in lists; one that has a name and stands in a list is one
    offers = [one if isinstance(one, list | tuple) else [one] for one in names.values()]
    laws = {id(law): law for some in offers for law in some if isinstance(law, Law)}
    found = tuple(laws.values())
    ContactError.require(found, f"laws must be stepblocks.Law, and there is none [{path}]")
    return found


def list_offered_laws() -> list[Law]:
    """Return entry points of the group ``stepblocks.effects``, then what `offer_laws` was given."""
    own = [one.load() for one in entry_points(group="stepblocks.effects")]
    if _OFFERED in os.environ:
        own += _run_laws(os.environ[_OFFERED])
    if wrong := [one for one in own if not isinstance(one, Law)]:
        raise ContactError(
            f"entry points of stepblocks.effects must be a Law, got {wrong[0]!r:.60}"
        )
    return own
