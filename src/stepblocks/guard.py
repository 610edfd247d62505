"""The border of the library: a public function refuses a call that it cannot follow in one line."""

import difflib
import functools
import inspect
import numbers
import reprlib
import warnings
from collections.abc import Callable, Mapping
from typing import ParamSpec, TypeVar

from stepblocks.errors import StepblocksError, UsageError

P = ParamSpec("P")
R = TypeVar("R")

# keywords of version 0.1, kept until version 2
_RENAMED = {"how": "options", "said": "description"}
# what Python and its libraries raise over a value of a wrong type, shape or size
_MISUSE = (
    *(TypeError, AttributeError, ValueError, LookupError, ArithmeticError),
    *(RecursionError, MemoryError),
)


def guard(function: Callable[P, R], name: str) -> Callable[P, R]:
    """Return a function under its public name; it answers a wrong call with a `UsageError`."""

    @functools.wraps(function)
    def guarded(*values: P.args, **named: P.kwargs) -> R:
        for old in _RENAMED.keys() & named.keys():
            warnings.warn(
                f"{name}: {old!r} is now the keyword {_RENAMED[old]!r}; it goes in version 2",
                DeprecationWarning,
                stacklevel=2,
            )
            named[_RENAMED[old]] = named.pop(old)
        # of a matrix as seed NumPy ends the interpreter
        UsageError.require(
            isinstance(named.get("seed", 0), numbers.Integral),
            f"seed must be a whole number, got {type(named.get('seed')).__name__}",
        )
        try:
            return function(*values, **named)
        except StepblocksError:
            raise
        except _MISUSE as error:
            # the cause stays attached, since it may also be a mistake of this program
            raise UsageError(_describe_misuse(function, name, values, named, error)) from error

    guarded.__module__ = "stepblocks"
    guarded.__qualname__ = name
    return guarded


def guard_class(kind: type[R]) -> type[R]:
    """Let the construction of a public class answer as a public function; it stays that class."""
    make = kind.__init__
    # neither Python's own, of abstract classes and errors, nor one that is guarded
    if inspect.isfunction(make) and not hasattr(make, "__wrapped__"):
        kind.__init__ = guard(make, "__init__")  # type: ignore[method-assign]
    return kind


def _describe_misuse(
    function: Callable[..., object],
    name: str,
    values: tuple[object, ...],
    named: Mapping[str, object],
    error: Exception,
) -> str:
    # Say what is wrong with a call, or with the construction of what is its first value
    if name == "__init__":
        name = type(values[0]).__name__
        if type(error).__name__ == "ValidationError":  # in the words of the readers of files
            from stepblocks import mistakes

            found = mistakes.list_mistakes(error, type(values[0]), named)  # type: ignore[arg-type]
            return f"{name}: {' '.join('; '.join(text for _, text in found).split())}"
    signature = inspect.signature(function)
    try:
        given = signature.bind(*values, **named).arguments
    except TypeError as wrong:
        return f"{name}: {_describe_call(signature, named, wrong)}"
    for key, value in given.items():
        wanted = signature.parameters[key].annotation
        # a number or a text may be taken for another; what is ours may not
        ours = inspect.isclass(wanted) and wanted.__module__.startswith("stepblocks.")
        if ours and not isinstance(value, wanted):
            return " ".join(
                f"{name}: {key} must be a {wanted.__name__}, got {reprlib.repr(value)}".split()
            )
    shown = (f"{key}={reprlib.repr(value)}" for key, value in given.items() if key != "self")
    reason = " ".join(f"{type(error).__name__}: {error}".split())
    return f"{name} cannot use these values: {reason:.200} [{' '.join(' '.join(shown).split())}]"


def _describe_call(
    signature: inspect.Signature, named: Mapping[str, object], error: TypeError
) -> str:
    # Say what is wrong with a call, and for an unknown keyword which ones there are
    known = [name for name in signature.parameters if name != "self"]
    unknown = [name for name in named if name not in known]
    if not unknown or any(one.kind is one.VAR_KEYWORD for one in signature.parameters.values()):
        return str(error)
    close = difflib.get_close_matches(unknown[0], known, 1)
    hint = f"did you mean {close[0]}?" if close else f"known are {', '.join(known)}"
    return f"{unknown[0]!r} is not a keyword; {hint}"
