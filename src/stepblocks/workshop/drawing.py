"""From a stimulus to its drawing as DXF, SVG and PDF."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from stepblocks.artefacts.on_paper import limits_text
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
from stepblocks.workshop.blocks import gauge_sheet, margin_block_views, step_block_views
from stepblocks.workshop.gauge_route import GaugePair
from stepblocks.workshop.sheet import HEIGHT, WIDTH, Sheet
from stepblocks.workshop.turned import crown_views, hook_tip_views, sheath_views, straight_tip_views, turned_views

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


def write_drawing(folder: Path, stimulus: Part, formats: Sequence[str] = FORMATS) -> list[Path]:
    """Draw a part with its views; what none of them shows stands in words."""
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
