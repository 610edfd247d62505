"""Names that columns of predictions had before the same thing had one name in every table.

A table that was saved under an old name is still read. A column whose unit has changed with its
name is no alias: who asks for it is told the new name.
"""

from collections.abc import Collection
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

_ENDS = ("", "_low", "_high", "_95_low", "_95_high")
_FORCES = ("pull_force", "drag_pull_force", "surface_pull_force")
_OTHER_UNIT = {
    "height_m": "height_um",
    "edge_radius_m": "edge_radius_um",
    "tip_radius_m": "tip_radius_um",
    "marginal_gap_m": "marginal_gap_um",
    "horizontal_discrepancy_m": "horizontal_discrepancy_um",
    "vertical_discrepancy_m": "vertical_discrepancy_um",
    "speed_m_s": "speed_mm_s",
    "critical_angle_rad": "critical_angle_deg",
    "vibration_energy_j": "vibration_energy_uj",
    "drag_vibration_energy_j": "drag_vibration_energy_uj",
}


def _make_column_aliases() -> dict[str, str]:
    """Return the new name of each old one that means the same in the same unit."""
    aliases = {
        "step_height_um": "height_um",
        "drag_share": "drag_conversion",
        "direction": "drag",
    }
    for force in _FORCES:
        for end in _ENDS:
            aliases[f"{force}{end}_n"] = f"{force.replace('pull', 'peak')}{end}_n"
    return aliases


_ALIASES = _make_column_aliases()


def find_current_column_name(name: str, known: Collection[object]) -> str:
    """Return the name of a column in a table that may have it under its old or its new name.

    Parameters
    ----------
    name : str
        That somebody asks for.
    known : collection of str
        Names that the table has.

    Returns
    -------
    str
        The name in the table; as it is asked for where the table has neither.
    """
    if name in known:
        return name
    for old, new in _ALIASES.items():
        if name == old and new in known:
            return new
        if name == new and old in known:
            return old
    return name


def format_renamed_column_hint(name: str, known: Collection[object]) -> str:
    """Return a hint for a message about a column whose name and unit have changed."""
    now = _OTHER_UNIT.get(name)
    if now not in known:
        return ""
    return f"; {now} has taken its place"


def rename_old_columns(table: "pd.DataFrame") -> "pd.DataFrame":
    """Return a table with the new names of columns that mean the same in the same unit."""
    renamed = {}
    for old, new in _ALIASES.items():
        if old in table and new not in table:
            renamed[old] = new
    return table.rename(columns=renamed)
