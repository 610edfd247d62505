"""From a stimulus to its drawing as DXF, SVG and PDF."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from stepblocks.artefacts.on_paper import demands_by_default
from stepblocks.atomic import beside
from stepblocks.errors import MachiningError
from stepblocks.parts.conditions import OrderSpec
from stepblocks.parts.kind import Part
from stepblocks.parts.kinds.crown_on_tooth import CrownOnTooth
from stepblocks.parts.kinds.machined import Machined
from stepblocks.parts.kinds.margin import MarginBlock
from stepblocks.parts.kinds.sheath import Sheath
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.kinds.tips import HookTip, StraightTip
from stepblocks.parts.revolution import Turned
from stepblocks.workshop.blocks import gauge_sheet, margin_block_views, step_block_views
from stepblocks.workshop.gauge_route import GaugePair
from stepblocks.workshop.machined import machined_views
from stepblocks.workshop.sheet import FONT, HEIGHT, TOP_OF_TITLE, WIDTH, Sheet
from stepblocks.workshop.turned import crown_views, hook_tip_views, sheath_views, straight_tip_views, turned_views

FORMATS = ("dxf", "svg", "pdf")
_NOTHING_SAID = OrderSpec()
_MOST_ROWS = 40  # of notes over the title block
_CAPITAL = 0.729  # height of a capital of the font over its size
# who draws a kind on a sheet and returns lines for its notes; without views everything is said in words
VIEWS: Mapping[type, Callable[[Sheet, Any], list[str]]] = {
    StepBlock: step_block_views,
    MarginBlock: margin_block_views,
    CrownOnTooth: crown_views,
    StraightTip: straight_tip_views,
    HookTip: hook_tip_views,
    Sheath: sheath_views,
    Turned: turned_views,  # any other turned kind
    Machined: machined_views,
}


def write_drawing(
    folder: Path, stimulus: Part, formats: Sequence[str] = FORMATS, order: OrderSpec = _NOTHING_SAID
) -> list[Path]:
    """Draw a part with its views; what none of them shows stands in words."""
    if set(formats) - set(FORMATS):
        raise MachiningError(f"formats must be of {', '.join(FORMATS)}, got {', '.join(formats)}")
    return _write_all(folder, f"{stimulus.id}.drawing", formats, lambda: _part_sheet(stimulus, order))


def write_gauge_drawing(
    folder: Path, block: StepBlock, pair: GaugePair, order: OrderSpec = _NOTHING_SAID
) -> list[Path]:
    """Draw the two-piece block of a pair of gauge blocks."""
    return _write_all(folder, f"{block.id}.gauge", FORMATS, lambda: gauge_sheet(block, pair, _ordered(order)))


def _ordered(order: OrderSpec) -> dict[str, str]:
    told = {"drawn by": order.author, "date": order.date, "revision": order.revision}
    return {**{name: value or "-" for name, value in told.items()}, "quantity": str(order.quantity)}


def _part_sheet(stimulus: Part, order: OrderSpec) -> Sheet:
    sheet = Sheet(list(stimulus.characteristics()))
    draw = next((VIEWS[kind] for kind in type(stimulus).__mro__ if kind in VIEWS), None)
    notes, governing = draw(sheet, stimulus) if draw else [], stimulus.governed_by.replace("_", " ")
    # what no view shows is said in words, with its number
    left = [(key, n, one) for key, (n, one) in sheet.listed.items() if n not in sheet.numbers]
    lines = [f"{n}  {one.label}: {sheet.limits(key)}" for key, n, one in left]
    if stimulus.has_working_faces and stimulus.face_demands.defaults:
        notes.append(demands_by_default(stimulus))
    if governing and not stimulus.has_working_faces:
        rough = stimulus.face_demands.roughness * 1e6
        notes.append(f"Ra {rough:.2f} um or better where a tip touches, from the tolerance of the {governing}.")
    lines += notes
    keys = dict(enumerate(key for key, _, _ in left))
    rows = min(len(lines), _MOST_ROWS)
    for start in range(0, len(lines), _MOST_ROWS):  # the columns of a long list start level
        at = 232.0 + 92.0 * (start // _MOST_ROWS), TOP_OF_TITLE - 1.0 + 5.0 * rows
        part = {index - start: key for index, key in keys.items() if start <= index < start + _MOST_ROWS}
        sheet.notes(at, lines[start : start + _MOST_ROWS], part)
    mass = stimulus.material.density * math.fsum(stimulus.volumes())
    told = {"identity": stimulus.id.upper(), "material": stimulus.material.designation, "mass": f"{mass * 1e3:.4g} g"}
    sheet.border(stimulus.titled, told | _ordered(order))
    return sheet


def _write_all(folder: Path, name: str, formats: Sequence[str], draw: Callable[[], Sheet]) -> list[Path]:
    paths = [folder / f"{name}.{form}" for form in formats]
    with _same_everywhere():
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
    return paths


@contextmanager
def _same_everywhere() -> Iterator[None]:
    """Let ezdxf write no time and no random identifier, and see only the fonts that matplotlib carries."""
    import ezdxf
    from ezdxf.fonts import fonts

    options = ezdxf.options
    before = options.write_fixed_meta_data_for_testing, fonts.font_manager, fonts.TrueTypeFont._glyph_caches
    options.write_fixed_meta_data_for_testing = True
    fonts.font_manager, fonts.TrueTypeFont._glyph_caches = _fonts_of_matplotlib()
    try:
        yield
    finally:
        options.write_fixed_meta_data_for_testing, fonts.font_manager, fonts.TrueTypeFont._glyph_caches = before


@cache
def _fonts_of_matplotlib() -> tuple[Any, dict[str, Any]]:
    import matplotlib as mpl
    from ezdxf.fonts.font_manager import FontManager

    manager = FontManager()
    manager.scan_folder(Path(mpl.get_data_path()) / "fonts" / "ttf")
    return manager, {}


def _render(sheet: Sheet, path: Path) -> None:
    """Draw what the DXF holds; its letters stay letters, which can be searched."""
    import matplotlib as mpl
    from ezdxf.addons.drawing import Frontend, RenderContext
    from ezdxf.addons.drawing.config import BackgroundPolicy, ColorPolicy, Configuration, LineweightPolicy
    from ezdxf.addons.drawing.matplotlib import MatplotlibBackend
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.font_manager import FontProperties

    with mpl.rc_context({"svg.hashsalt": "stepblocks", "svg.fonttype": "none", "pdf.fonttype": 42}):
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
        font = FontProperties(fname=Path(mpl.get_data_path()) / "fonts" / "ttf" / FONT)

        def letters(text: str, transform: Any, properties: Any, cap_height: float, dxftype: str = "TEXT") -> None:
            origin, ahead = transform.transform((0.0, 0.0, 0.0)), transform.transform((1.0, 0.0, 0.0))
            turned = math.degrees(math.atan2(ahead.y - origin.y, ahead.x - origin.x))
            size = cap_height * (ahead - origin).magnitude * 72.0 / 25.4 / _CAPITAL
            how: dict[str, Any] = {"rotation": turned, "rotation_mode": "anchor", "parse_math": False}
            axes.text(origin.x, origin.y, text.strip(), fontsize=size, fontproperties=font.copy(), va="baseline", **how)

        backend = MatplotlibBackend(axes, adjust_figure=False)
        frontend = Frontend(RenderContext(sheet.document), backend, config=configuration)
        frontend.pipeline.draw_text = letters
        frontend.draw_layout(sheet.space, finalize=True)
        axes.set_xlim(0.0, WIDTH)
        axes.set_ylim(0.0, HEIGHT)
        axes.set_aspect("auto")  # the figure has the sheet's own proportions
        axes.set_position((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        dated = ("Date",) if path.suffix == ".svg" else ("CreationDate", "ModDate")
        figure.savefig(path, metadata=dict.fromkeys(dated), dpi=150)
