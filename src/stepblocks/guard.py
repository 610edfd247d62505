"""The border of the library: a public function refuses a call that it cannot follow in one line."""

import difflib
import functools
import inspect
import reprlib
from collections.abc import Callable, Mapping
from typing import ParamSpec, TypeVar

from stepblocks.errors import StepblocksError, UsageError

P = ParamSpec("P")
R = TypeVar("R")

# what Python and its libraries raise over a value of a wrong type, shape or size
_MISUSE = (TypeError, AttributeError, ValueError, LookupError, ArithmeticError, RecursionError)


def guard(function: Callable[P, R], name: str) -> Callable[P, R]:
    """Return a function under its public name; it answers a wrong call with a `UsageError`."""
    signature = inspect.signature(function)

    @functools.wraps(function)
    def guarded(*values: P.args, **named: P.kwargs) -> R:
        try:
            given = signature.bind(*values, **named).arguments
        except TypeError as error:
            raise UsageError(f"{name}: {_describe_call(signature, named, error)}") from None
        try:
            return function(*values, **named)
        except StepblocksError:
            raise
        except _MISUSE as error:
            # the cause stays attached, since it may also be a mistake of this program
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            shown = " ".join(f"{key}={reprlib.repr(value)}" for key, value in given.items())
            raise UsageError(
                f"{name} cannot use these values: {reason:.200} [{' '.join(shown.split())}]"
            ) from error

    guarded.__module__, guarded.__qualname__ = "stepblocks", name
    return guarded


def _describe_call(
    signature: inspect.Signature, named: Mapping[str, object], error: TypeError
) -> str:
    # Say what is wrong with a call, and for an unknown keyword which ones there are
    known = [name for name, one in signature.parameters.items() if one.kind is not one.VAR_KEYWORD]
    unknown = [name for name in named if name not in known]
    if not unknown or len(known) < len(signature.parameters):
        return str(error)
    close = difflib.get_close_matches(unknown[0], known, 1)
    hint = f"did you mean {close[0]}?" if close else f"known are {', '.join(known)}"
    return f"{unknown[0]!r} is not a keyword; {hint}"
