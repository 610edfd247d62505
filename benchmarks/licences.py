"""List the licences of everything that is installed: ``make licences``.

One line each; those with a copyleft are marked. Exit code 1 where one is GPL or AGPL, which nothing
of ours may need.
"""

from __future__ import annotations

import re
import sys
from importlib.metadata import Distribution, distributions
from typing import Any

_TROVE = "License :: "
# whose own licence is permissive, and whose wheels carry a library that is not: as that library
# says, not the package
_WITHIN = {
    "cadquery-ocp": "OpenCASCADE: LGPL-2.1 with an exception",
    "nlopt": "Luksan's solvers: LGPL-2.1",
    "shapely": "GEOS: LGPL-2.1",
    "soundfile": "libsndfile: LGPL-2.1",
}
_NAMES = re.compile(r"Lesser General|\bLGPL|Mozilla|\bMPL", re.IGNORECASE)
_REFUSED = re.compile(r"\bA?GPL|(?<!Lesser )General Public|Affero", re.IGNORECASE)
_CHOICE = re.compile(r"\bOR\b|dual|exception|or later;", re.IGNORECASE)


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
    said = stated or ", ".join(listed) or (free[0][:60] if free else "not stated")
    within = _WITHIN.get(data["Name"].lower().replace("_", "-"))
    return f"{said}; {within}" if within else said


def main() -> int:
    """Print the table."""
    found = sorted(
        {
            (one.metadata["Name"], one.version, licence(one))
            for one in distributions()
            if one.metadata["Name"]
        }
    )
    refused = [
        row
        for row in found
        if _REFUSED.search(row[2]) and not _NAMES.search(row[2]) and not _CHOICE.search(row[2])
    ]
    print("| package | version | licence | copyleft |\n|---|---|---|---|")
    for name, version, said in found:
        mark = "GPL" if (name, version, said) in refused else "weak" if _NAMES.search(said) else ""
        print(f"| {name} | {version} | {said} | {mark} |")
    return int(bool(refused))


if __name__ == "__main__":
    sys.exit(main())
