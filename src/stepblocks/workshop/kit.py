"""Everything a workshop gets of the apparatus beside its parts: assembly, lists, pictures."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from stepblocks.artefacts.step.kit_assembly import write_kit_assembly
from stepblocks.errors import MachiningError
from stepblocks.files.atomic import replace_text
from stepblocks.files.tables import write_table
from stepblocks.parts.apparatus.declared import Apparatus
from stepblocks.parts.apparatus.interference import find_interferences
from stepblocks.parts.apparatus.layout import (
    list_assembly_stages,
    list_components,
    list_made_component_names,
)
from stepblocks.parts.conditions import OrderSpec
from stepblocks.parts.kind import Part
from stepblocks.parts.kinds.kit_part import KitPart
from stepblocks.workshop.drawing import write_assembly_drawing
from stepblocks.workshop.kit_lists import (
    format_session_lines,
    tabulate_flexure,
    tabulate_loads,
    tabulate_parts,
)
from stepblocks.workshop.kit_pictures import write_stage_pictures

_SHOWN_INTERFERENCES = 5  # in a message


def find_complete_kits(parts: Sequence[Part]) -> list[Apparatus]:
    """Find the kits of which every part that is made is among some parts."""
    names: dict[str, set[str]] = {}
    kits: dict[str, Apparatus] = {}
    for part in parts:
        if isinstance(part, KitPart):
            kits[part.kit.id] = part.kit
            names.setdefault(part.kit.id, set()).add(part.component)
    whole = []
    for identity, kit in kits.items():
        if names[identity].issuperset(list_made_component_names(kit)):
            whole.append(kit)
    return whole


def write_kit_assembly_files(folder: Path, kit: Apparatus, order: OrderSpec) -> list[Path]:
    """Write what belongs to a kit as a whole, beside the files of its parts.

    That is the assembly as STEP and as a drawing, the tables of parts, loads and flexure, the lines
    for a session file, and pictures of the stages of assembly.

    Parameters
    ----------
    folder : Path
        Where the files go.
    kit : Apparatus
        What is declared.
    order : OrderSpec
        What the title block says of the order.

    Returns
    -------
    list of Path
        What is written.

    Raises
    ------
    MachiningError
        If two components share volume somewhere on the travel; nothing is written then.
    """
    _refuse_interferences(kit)
    assembly = folder / f"{kit.id}.assembly.step"
    write_kit_assembly(assembly, kit, order)
    written = [assembly, *write_assembly_drawing(folder, kit, order)]
    tables = {
        "parts": tabulate_parts(kit),
        "loads": tabulate_loads(kit),
        "flexure": tabulate_flexure(kit),
    }
    for name, rows in tables.items():
        path = folder / f"{kit.id}.{name}.csv"
        write_table(pd.DataFrame(rows), path)
        written.append(path)
    session = folder / f"{kit.id}.session.toml"
    replace_text(session, format_session_lines(kit))
    written.append(session)
    written += write_stage_pictures(folder, kit.id, list_assembly_stages(kit))
    return written


def _refuse_interferences(kit: Apparatus) -> None:
    """Refuse a kit in which components share volume somewhere on the travel."""
    found = find_interferences(list_components(kit), kit.travel.nominal)
    if not found:
        return
    shown = "; ".join(str(interference) for interference in found[:_SHOWN_INTERFERENCES])
    if len(found) > _SHOWN_INTERFERENCES:
        shown += f"; and {len(found) - _SHOWN_INTERFERENCES} more"
    raise MachiningError(f"components must have room over the whole travel: {shown} [{kit.id}]")
