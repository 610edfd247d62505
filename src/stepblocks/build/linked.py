"""Files that other commands leave beside the outputs of a build, for links on its page."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from stepblocks.build.manifest import RECORD, Link

WHOLE_FOLDER = ""  # stands for the folder in place of a part

_BESIDE = (
    Link("the page to feel", "feel.html"),
    Link("evidence", "evidence/evidence.html"),
    Link("the closed loop", "loop/report.html"),
    Link("the study", "study/report/report.html"),
)


class _Pattern(NamedTuple):
    """Files of one part: title, and where they lie; ``{}`` stands for set and part."""

    title: str
    pattern: str

    def find_files(self, output: Path, set_and_id: str) -> list[Path]:
        """Find them below an output folder, of a part by its ``set/id``."""
        identity = Path(set_and_id).name
        return sorted(output.glob(self.pattern.format(set_and_id, id=identity)))


_SCENE = _Pattern("scene", "scenes/{}/*/README.md")
# whatever else was written for a part, by the end of its name
_ANYTHING_ELSE = _Pattern("", "{}/{id}.*")
_OF_A_PART = (
    _Pattern("drawing", "{}/*.drawing.pdf"),
    _Pattern("drawing, SVG", "{}/*.drawing.svg"),
    _Pattern("drawing, DXF", "{}/*.drawing.dxf"),
    _Pattern("inspection sheet", "{}/*.inspection-sheet.html"),
    _Pattern("sheet to fill in", "{}/*.inspection-sheet.csv"),
    _Pattern("inspection plan", "{}/*.plan.qif"),
    _Pattern("setup sheet", "{}/*.setup.html"),
    _Pattern("stock", "{}/*.stock.step"),
    _Pattern("routes", "{}/*.routes.csv"),
    _Pattern("gauge blocks, STEP", "{}/*.gauge.step"),
    _Pattern("gauge blocks, drawing", "{}/*.gauge.pdf"),
    _Pattern("gauge blocks, SVG", "{}/*.gauge.svg"),
    _Pattern("gauge blocks, DXF", "{}/*.gauge.dxf"),
    _Pattern("inspection", "inspect/*{id}*.inspection.html"),
    _SCENE,
    _ANYTHING_ELSE,
)


def find_linked_files(output: Path, outputs: Iterable[str]) -> dict[str, list[Link]]:
    """Find files that other commands left beside the outputs of a build.

    Parameters
    ----------
    output : Path
        The output folder.
    outputs : iterable of str
        Names of what the build itself wrote.

    Returns
    -------
    dict of str to list of Link
        Those of the whole folder stand under the empty name, those of a part under ``set/id``.
    """
    known = set(outputs)
    ending = f"/{RECORD}"
    parts = sorted(name.removesuffix(ending) for name in known if name.endswith(ending))
    links = {WHOLE_FOLDER: list(_yield_whole_folder_links(output))}
    for part in parts:
        found = list(_yield_new_part_links(output, part, known))
        if found:
            links[part] = found
    return links


def _yield_whole_folder_links(output: Path) -> Iterator[Link]:
    """Yield links to the files that belong to the whole output or to a set, where they exist."""
    for link in _BESIDE:
        if (output / link.name).is_file():
            yield link
    for path in sorted(output.glob("*/*.series*")):
        yield Link(f"drawing of the series {path.name}", path.relative_to(output).as_posix())
    for title, pattern in (("parts list", "*/*.parts-list.csv"), ("papers", "*/*.quotation.zip")):
        for path in sorted(output.glob(pattern)):
            yield Link(f"{title} {path.name}", path.relative_to(output).as_posix())


def _yield_new_part_links(output: Path, part: str, known_names: set[str]) -> Iterator[Link]:
    """Yield the files of a part that are not known yet, and add them to the known ones."""
    for kind in _OF_A_PART:
        for path in kind.find_files(output, part):
            name = path.relative_to(output).as_posix()
            if name not in known_names:
                known_names.add(name)
                yield Link(_format_link_title(kind, path), name)


def _format_link_title(kind: _Pattern, path: Path) -> str:
    """Write the title of a link, by the kind of its file."""
    if kind is _SCENE:
        return f"{kind.title}: {path.parent.name}"
    if kind is _ANYTHING_ELSE:
        return path.name.partition(".")[2]
    return kind.title
