"""List what `pip install .` puts on a disk: each distribution, its size, and who needs it.

python benchmarks/install_size.py ["stepblocks[sim]"] [--least MB]
python benchmarks/install_size.py cadquery trimesh manifold3d numpy pyvista
"""

import argparse
from collections import deque
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name


def demanded(roots: list[str]) -> dict[str, tuple[Distribution, set[str]]]:
    """Walk from distributions to all that they demand; by name, each with who demands it."""
    found: dict[str, tuple[Distribution, set[str]]] = {}
    queue = deque((Requirement(root), "you") for root in roots)
    seen: set[tuple[str, frozenset[str]]] = set()
    while queue:
        wanted, by = queue.popleft()
        name = canonicalize_name(wanted.name)
        if name in found:
            found[name][1].add(by)
        else:
            try:
                found[name] = (distribution(name), {by})
            except PackageNotFoundError:
                print(f"not installed: {name}, which {by} demands")
                continue
        if (name, frozenset(wanted.extras)) in seen:
            continue
        seen.add((name, frozenset(wanted.extras)))
        environments = [{"extra": extra} for extra in wanted.extras] or [{"extra": ""}]
        for text in found[name][0].requires or ():
            below = Requirement(text)
            if below.marker is None or any(below.marker.evaluate(one) for one in environments):
                queue.append((below, name))
    return found


def megabytes(one: Distribution) -> float:
    """Size of the files of a distribution, those that Python compiled left out."""
    files = [file for file in one.files or () if file.suffix != ".pyc"]
    places = {Path(str(one.locate_file(file))) for file in files}
    return sum(place.stat().st_size for place in places if place.is_file()) / 1e6


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "roots",
        nargs="*",
        default=["stepblocks"],
        help="what is asked for, such as stepblocks[sim]",
    )
    parser.add_argument(
        "--least", type=float, default=10.0, help="smallest size that has a line [MB]"
    )
    arguments = parser.parse_args()
    found = demanded(arguments.roots)
    sizes = {name: megabytes(one) for name, (one, _) in found.items()}
    print("| distribution | MB | demanded by |\n|---|---:|---|")
    for name in sorted(sizes, key=lambda name: -sizes[name]):
        if sizes[name] >= arguments.least:
            print(
                f"| {name} {found[name][0].version} | {sizes[name]:.0f} | "
                f"{', '.join(sorted(found[name][1]))} |"
            )
    few = [name for name in sizes if sizes[name] < arguments.least]
    print(f"| {len(few)} smaller ones | {sum(sizes[name] for name in few):.0f} | |")
    print(f"| **all {len(sizes)}** | **{sum(sizes.values()):.0f}** | |")


if __name__ == "__main__":
    main()
