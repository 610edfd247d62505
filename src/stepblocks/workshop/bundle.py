"""An order as one thing: a parts list of a set, and its papers in one archive for a quotation."""

import io
import math
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from stepblocks.declaration.set import StimulusSet
from stepblocks.files.atomic import replace_bytes
from stepblocks.files.tables import write_table
from stepblocks.parts.kind import Part

# the earliest time that an archive can state: equal papers give equal bytes
_PINNED_TIME = (1980, 1, 1, 0, 0, 0)
_READ_BY_ALL = 0o644 << 16  # permissions of a file, where zip keeps them
_WITHOUT_STEP = "no STEP file yet: run build into this folder"


@dataclass(frozen=True)
class OrderedPart:
    """A line of a parts list."""

    part: Part
    folder: Path  # of its papers
    note: str = ""  # such as which block of the set has the same sizes


def write_bundle(folder: Path, stimuli: StimulusSet, ordered: Sequence[OrderedPart]) -> list[Path]:
    """Write the parts list of a set, and an archive of it with all papers of its parts.

    Parameters
    ----------
    folder : Path
        Of the set; the papers of its parts lie in folders below it.
    stimuli : StimulusSet
        Whose order it is.
    ordered : sequence of OrderedPart
        The parts, in the order of the set.

    Returns
    -------
    list of Path
        ``<set>.parts-list.csv`` and ``<set>.quotation.zip``.
    """
    table = folder / f"{stimuli.name}.parts-list.csv"
    rows = [_make_parts_list_row(item, stimuli, line) for item, line in enumerate(ordered, start=1)]
    write_table(pd.DataFrame(rows), table)
    archive = folder / f"{stimuli.name}.quotation.zip"
    papers = [table, *sorted(folder.glob("*.series*"))]
    for line in ordered:
        papers += sorted(
            path for path in line.folder.iterdir() if _is_quotation_paper(path, line.part)
        )
    _write_archive(archive, folder, papers)
    return [table, archive]


def _make_parts_list_row(
    item_number: int, stimuli: StimulusSet, ordered_part: OrderedPart
) -> dict[str, object]:
    """Make a line of the parts list."""
    part = ordered_part.part
    order = stimuli.order
    density = part.material.density
    mass = ""
    if density is not None:
        mass = f"{density.value * math.fsum(part.volumes()) * 1e3:.4g}"
    notes = [ordered_part.note]
    if not all((ordered_part.folder / f"{body}.step").is_file() for body in part.bodies):
        notes.append(_WITHOUT_STEP)
    return {
        "item": item_number,
        "part_number": part.id.upper(),
        "drawing_number": f"{stimuli.name}-{part.id}".upper(),
        "revision": order.revision,
        "quantity": order.count_ordered_parts(part.id),
        "kind": part.kind_name,
        "material": part.material.order_text,
        "mass_g": mass,
        "sizes": part.summary,
        "note": "; ".join(note for note in notes if note),
    }


def _is_quotation_paper(path: Path, part: Part) -> bool:
    """Tell whether a file is one that a workshop quotes from: drawings, solids, sheets."""
    if not path.is_file():
        return False
    names = {f"{part.id}.{ending}" for ending in _ENDINGS}
    names |= {f"{body}.step" for body in part.bodies}
    return path.name in names


_ENDINGS = (
    "step",
    "drawing.pdf",
    "drawing.dxf",
    "inspection-sheet.csv",
    "inspection-sheet.html",
    "plan.qif",
    "setup.html",
    "stock.step",
    "gauge.step",
    "gauge.pdf",
    "gauge.dxf",
    "routes.csv",
)


def _write_archive(archive: Path, folder: Path, papers: Sequence[Path]) -> None:
    """Write files into an archive under their names below a folder; equal files, equal bytes."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as opened:
        for path in papers:
            name = path.relative_to(folder).as_posix()
            entry = zipfile.ZipInfo(name, _PINNED_TIME)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = _READ_BY_ALL
            entry.create_system = 3  # as Unix writes it, on every system
            opened.writestr(entry, path.read_bytes())
    replace_bytes(archive, buffer.getvalue())
