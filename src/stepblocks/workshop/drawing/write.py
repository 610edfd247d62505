"""From a stimulus to its drawing as DXF, SVG and PDF, and back from the DXF to the numbers that stand on it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from stepblocks.artefacts.numbers import limits_text
from stepblocks.atomic import beside
from stepblocks.errors import MachiningError
from stepblocks.parts.characteristics import Characteristic
from stepblocks.parts.kind import Part
from stepblocks.parts.kinds.crown_on_tooth import CrownOnTooth
from stepblocks.parts.kinds.margin import MarginBlock
from stepblocks.parts.kinds.sheath import Sheath
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.kinds.tips import HookTip, StraightTip
from stepblocks.parts.revolution import Turned
from stepblocks.workshop.drawing.blocks import gauge_sheet, margin_block_views, step_block_views
from stepblocks.workshop.drawing.sheet import HEIGHT, WIDTH, Sheet
from stepblocks.workshop.drawing.turned import (
    crown_views,
    hook_tip_views,
    sheath_views,
    straight_tip_views,
    turned_views,
)
from stepblocks.workshop.gauge_route import GaugePair

FORMATS = ("dxf", "svg", "pdf")
# who draws a kind on a sheet and returns lines for its notes; without views everything is said in words
VIEWS: Mapping[type, Callable[[Sheet, Any], list[str]]] = {
    StepBlock: step_block_views,
    MarginBlock: margin_block_views,
    CrownOnTooth: crown_views,
    StraightTip: straight_tip_views,
    HookTip: hook_tip_views,
    Sheath: sheath_views,
    Turned: turned_views,  # any other turned kind
}


@dataclass(frozen=True)
class DrawnDimension:
    """A dimension read back from a DXF file."""

    key: str  # of the characteristic
    number: int  # on the drawing
    value: float  # what the drawn geometry measures at the scale of its view [m]
    lower: float  # signed deviation [m]
    upper: float  # signed deviation [m]
    text: str  # what is printed


def write_drawing(folder: Path, stimulus: Part, formats: Sequence[str] = FORMATS) -> list[Path]:
    """Draw a part."""
    if set(formats) - set(FORMATS):
        raise MachiningError(f"formats must be of {', '.join(FORMATS)}, got {', '.join(formats)}")
    return _write_all(folder, f"{stimulus.id}.drawing", formats, lambda: _part_sheet(stimulus))


def write_gauge_drawing(folder: Path, block: StepBlock, pair: GaugePair) -> list[Path]:
    """Draw the two-piece block of a pair of gauge blocks."""
    return _write_all(folder, f"{block.id}.gauge", FORMATS, lambda: gauge_sheet(block, pair))


def _part_sheet(stimulus: Part) -> Sheet:
    sheet = Sheet(list(stimulus.characteristics()))
    draw = next((VIEWS[kind] for kind in type(stimulus).__mro__ if kind in VIEWS), None)
    notes = draw(sheet, stimulus) if draw else []
    # what no view shows is said in words, with its number
    lines = [f"{n}  {one.label}: {_limits(one)}" for n, one in sheet.listed.values() if n not in sheet.numbers]
    demands, said = stimulus.face_demands, " (by default)"
    if stimulus.has_working_faces:
        said = f" (by default: {', '.join(demands.defaults)})" if demands.defaults else ""
    lines += [f"Working faces Ra {demands.roughness * 1e6:.2f} um or better{said}.", *notes]
    sheet.notes((232.0, 66.0 + 5.0 * len(lines)), lines)
    sheet.border(stimulus.titled, stimulus.id.upper(), stimulus.material.designation)
    return sheet


def _limits(one: Characteristic) -> str:
    if one.quantity == "angle":
        low, high = (math.degrees(value) for value in (one.lower, one.upper))
        return f"{math.degrees(one.nominal):g} deg {high:+g}/{low:+g} deg"
    return limits_text(one.nominal, one.lower, one.upper)


def _write_all(folder: Path, name: str, formats: Sequence[str], draw: Callable[[], Sheet]) -> list[Path]:
    import ezdxf

    paths = [folder / f"{name}.{form}" for form in formats]
    before = ezdxf.options.write_fixed_meta_data_for_testing
    ezdxf.options.write_fixed_meta_data_for_testing = True  # no time of day, no random identifiers
    try:
        with _shipped_fonts():
            sheet = draw()
            for path in paths:
                with beside(path) as draft:
                    if path.suffix == ".dxf":
                        # ezdxf takes classes from a set, whose order differs by process
                        for kind in sorted(sheet.document.entitydb.dxf_types_in_use()):
                            sheet.document.classes.add_class(kind)
                        sheet.document.saveas(draft)
                    else:
                        _render(sheet, draft)
    finally:
        ezdxf.options.write_fixed_meta_data_for_testing = before
    return paths


@contextmanager
def _shipped_fonts() -> Iterator[None]:
    """Let ezdxf see only the fonts that matplotlib carries, and give it back its own afterwards.

    ezdxf looks fonts up in one manager per process, filled from the folders of the system; text widths, and with them
    the outlines in SVG and PDF, would differ where another version of the font is installed.
    """
    from ezdxf.fonts import fonts

    before, glyphs = fonts.font_manager, fonts.TrueTypeFont._glyph_caches
    fonts.font_manager, fonts.TrueTypeFont._glyph_caches = _fonts_of_matplotlib()
    try:
        yield
    finally:
        fonts.font_manager, fonts.TrueTypeFont._glyph_caches = before, glyphs


@cache
def _fonts_of_matplotlib() -> tuple[Any, dict[str, Any]]:
    import matplotlib as mpl
    from ezdxf.fonts.font_manager import FontManager

    manager = FontManager()
    manager.scan_folder(Path(mpl.get_data_path()) / "fonts" / "ttf")
    return manager, {}


def _render(sheet: Sheet, path: Path) -> None:
    """Write SVG or PDF, by the suffix."""
    import matplotlib as mpl
    from ezdxf.addons.drawing import Frontend, RenderContext
    from ezdxf.addons.drawing.config import BackgroundPolicy, ColorPolicy, Configuration, LineweightPolicy
    from ezdxf.addons.drawing.matplotlib import MatplotlibBackend
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with mpl.rc_context({"svg.hashsalt": "stepblocks", "svg.fonttype": "path"}):
        figure = Figure(figsize=(WIDTH / 25.4, HEIGHT / 25.4))
        FigureCanvasAgg(figure)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        configuration = Configuration(
            background_policy=BackgroundPolicy.WHITE,
            color_policy=ColorPolicy.BLACK,
            lineweight_policy=LineweightPolicy.ABSOLUTE,
            lineweight_scaling=72.0 / 25.4,
            min_lineweight=0.2,  # the backend takes millimetres for points
        )
        backend = MatplotlibBackend(axes, adjust_figure=False)
        Frontend(RenderContext(sheet.document), backend, config=configuration).draw_layout(sheet.space, finalize=True)
        axes.set_xlim(0.0, WIDTH)
        axes.set_ylim(0.0, HEIGHT)
        axes.set_aspect("auto")  # the figure has the sheet's own proportions
        axes.set_position((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        dated = ("Date",) if path.suffix == ".svg" else ("CreationDate", "ModDate")
        figure.savefig(path, metadata=dict.fromkeys(dated), dpi=150)


def drawn_dimensions(path: Path) -> list[DrawnDimension]:
    """Read the dimensions of a drawing back from its DXF file."""
    import ezdxf

    try:
        document = ezdxf.readfile(path)
    except (OSError, ezdxf.DXFError, UnicodeDecodeError, ValueError) as error:
        raise MachiningError(
            f"drawing must be a DXF file, got: {' '.join(str(error).split())[:120]} [{path.name}]"
        ) from error
    found = []
    for entity in document.modelspace().query("DIMENSION"):
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
        found.append(DrawnDimension(str(tags[0].value), int(tags[1].value), measured / 1e3, lower, upper, text=printed))
    return sorted(found, key=lambda one: one.number)
