"""Take away from our own modules what Windows and macOS do not have.

Python imports this file by its name when its folder stands on the path, in workers and confined
readers as well. Only `stepblocks` is deprived: the libraries have another half for Windows, which
does not run here. No process is started by a fork.
"""

import builtins
import multiprocessing
import os
import signal
import types

LACKING_MODULES = {"fcntl", "resource", "pwd", "grp", "termios"}
LACKING_NAMES = {
    "os": {
        *("fork", "forkpty", "getuid", "geteuid", "getpgid", "killpg", "setsid", "nice", "mkfifo"),
        *("sched_getaffinity", "sched_setscheduler", "sched_param", "SCHED_FIFO"),
        *(
            "O_DIRECTORY",
            "O_NOFOLLOW",
            "O_NONBLOCK",
            "statvfs",
            "chown",
            "fchmod",
            "wait",
            "WNOHANG",
        ),
    },
    "signal": {
        *("SIGKILL", "SIGXCPU", "SIGXFSZ", "SIGHUP", "SIGPIPE", "SIGALRM", "SIGPROF", "SIGUSR1"),
        *("alarm", "setitimer", "pthread_kill"),
    },
}

_really_import = builtins.__import__


def _copy_without(module: types.ModuleType, names: set[str]) -> types.ModuleType:
    """Return a module like another, without some of its names."""
    poorer = types.ModuleType(module.__name__)
    poorer.__dict__.update(
        {name: value for name, value in vars(module).items() if name not in names}
    )
    return poorer


_POORER = {
    "os": _copy_without(os, LACKING_NAMES["os"]),
    "signal": _copy_without(signal, LACKING_NAMES["signal"]),
}


def _import(name, globals=None, locals=None, fromlist=(), level=0):
    importer = (globals or {}).get("__name__", "")
    # the confined reader's main module is ours, too
    is_ours = importer.partition(".")[0] == "stepblocks" or (
        importer == "__main__" and "stepblocks" in str((globals or {}).get("__file__", ""))
    )
    if not is_ours:
        return _really_import(name, globals, locals, fromlist, level)
    if name in LACKING_MODULES:
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)
    if name in _POORER:
        return _POORER[name]
    return _really_import(name, globals, locals, fromlist, level)


builtins.__import__ = _import
multiprocessing.get_all_start_methods = lambda: ["spawn"]
multiprocessing.set_start_method("spawn", force=True)


def _refuse_fork(*_: object) -> None:
    raise OSError("this system has no fork")


if hasattr(os, "fork"):
    os.fork = _refuse_fork
