"""The numbers that stand on a drawing, read back from its DXF file by ezdxf."""

from dataclasses import dataclass

import ezdxf


@dataclass(frozen=True)
class DrawnDimension:
    """A dimension read back from the file."""

    key: str  # of the characteristic
    number: int  # on the drawing
    value: float  # what the drawn geometry measures at the scale of its view [m]
    lower: float  # signed deviation [m]
    upper: float  # signed deviation [m]
    text: str  # what is printed


def drawn_dimensions(path):
    """Dimensions of a drawing, in the order of their numbers."""
    found = []
    for entity in ezdxf.readfile(path).modelspace().query("DIMENSION"):
        if not entity.has_xdata("STEPBLOCKS"):
            continue
        tags = entity.get_xdata("STEPBLOCKS")
        style = entity.override()
        measured = float(entity.get_measurement()) * float(style.get("dimlfac", 1.0))
        printed = "".join(
            part.plain_text() if part.dxftype() == "MTEXT" else part.dxf.text
            for part in entity.virtual_entities()
            if part.dxftype() in ("MTEXT", "TEXT")
        )
        lower, upper = -float(style.get("dimtm", 0.0)) / 1e3, float(style.get("dimtp", 0.0)) / 1e3
        found.append(
            DrawnDimension(
                str(tags[0].value), int(tags[1].value), measured / 1e3, lower, upper, text=printed
            )
        )
    return sorted(found, key=lambda one: one.number)
