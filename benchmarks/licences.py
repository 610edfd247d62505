"""List the licences of everything that is installed: ``make licences``.

One line each; those with a copyleft are marked. Exit code 1 where one is GPL, AGPL or SSPL, which
nothing of ours may need, or says nothing. Of a choice one side must be free, of a list all. Words
that are no operators of SPDX (``or`` in small letters) leave no choice: such a package is looked at
by a person and listed here.
"""

from __future__ import annotations

import re
import sys
from importlib.metadata import Distribution, distributions
from typing import Any

_TROVE = "License :: "
# whose metadata say too little, as the file of the licence in the package has it
_FOUND = {
    # of its exceptions, one file of Emacs is under the GPL, which no wheel carries
    "docutils": "public domain, BSD-2-Clause",
    "usd-core": "TOST-1.0: Apache-2.0 with a changed section 6 on trademarks",
}
# for these the exception lets any program carry the library
_GCC = "GPL-3.0-or-later WITH GCC-exception-3.1"
_EXCEPTED = {_GCC}
# whose own licence is permissive, and whose wheels carry a library that is not: as that library
# says, not the package
_WITHIN = {
    "axe-core-python": "axe-core: MPL-2.0",
    "cadquery-ocp": "OpenCASCADE: LGPL-2.1 with an exception",
    "numpy": f"libgfortran: {_GCC}",
    "scikit-learn": f"libgomp: {_GCC}",
    "scipy": f"libgfortran: {_GCC}",
    "nlopt": "Luksan's solvers: LGPL-2.1",
    "shapely": "GEOS: LGPL-2.1",
    "soundfile": "libsndfile: LGPL-2.1",
}
_NAMES = re.compile(r"Lesser General|\bLGPL|Mozilla|\bMPL", re.IGNORECASE)
_REFUSED = re.compile(
    r"(?<!L)(?<!Lesser )GPL|(?<!Lesser )(?<!Library )General Public|GNU Public|Affero"
    r"|SSPL|Server Side Public|^(not stated|unknown)$",
    re.IGNORECASE,
)
_GROUP = re.compile(r"\(([^()]*)\)")


def licence(one: Distribution) -> str:
    """Find what a distribution says of its licence, the shortest true form first."""
    data: Any = one.metadata  # a message: its protocol does not promise `get`
    trove = [
        name.rsplit(" :: ", 1)[-1]
        for name in data.get_all("Classifier", [])
        if name.startswith(_TROVE)
    ]
    # which says nothing, and stands before what does
    listed = [name for name in trove if name != "OSI Approved"]
    stated = (data.get("License-Expression") or "").strip()
    free = (data.get("License") or "").strip().splitlines()
    name = data["Name"].lower().replace("_", "-")
    said = _FOUND.get(name) or stated or ", ".join(listed) or (free[0] if free else "not stated")
    within = _WITHIN.get(name)
    return f"{said}; {within}" if within else said


def is_refused(said: str) -> bool:
    """Tell whether an expression of SPDX, or what stands in its place, leaves no free licence."""
    while group := _GROUP.search(said):
        inner = group[1]
        if " OR " in inner or " AND " in inner:
            inner = "GPL" if is_refused(inner) else "free"
        said = said[: group.start()] + inner + said[group.end() :]
    return any(
        all(
            any(_is_copyleft(name) for name in side.split(" AND ")) for side in listed.split(" OR ")
        )
        for listed in re.split("[;,]", said)
    )


def _is_copyleft(name: str) -> bool:
    of_what = " ".join(name.split()).rpartition(": ")[2]  # a library in a wheel stands before it
    return of_what not in _EXCEPTED and bool(_REFUSED.search(of_what))


def main() -> int:
    """Print the table."""
    found = sorted(
        {
            (one.metadata["Name"], one.version, licence(one))
            for one in distributions()
            if one.metadata["Name"]
        }
    )
    refused = [row for row in found if is_refused(row[2])]
    print("| package | version | licence | copyleft |\n|---|---|---|---|")
    for name, version, said in found:
        mark = (
            "refused" if (name, version, said) in refused else "weak" if _NAMES.search(said) else ""
        )
        print(f"| {name} | {version} | {said} | {mark} |")
    return int(bool(refused))


if __name__ == "__main__":
    sys.exit(main())
