"""From a stimulus to its drawing as DXF, SVG and PDF."""

import math
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from typing import Any

import matplotlib as mpl

from stepblocks.files.atomic import write_atomically
from stepblocks.parts.conditions import NO_ORDER, OrderSpec
from stepblocks.parts.kind import Part
from stepblocks.parts.kinds.crown_on_tooth import CrownOnTooth
from stepblocks.parts.kinds.margin import MarginBlock
from stepblocks.parts.kinds.sheath import Sheath
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.kinds.tips import HookTip, StraightTip
from stepblocks.parts.on_paper import describe_default_demands, format_limits
from stepblocks.workshop.blocks import (
    draw_margin_block_views,
    draw_step_block_views,
)
from stepblocks.workshop.sheet import (
    FONT,
    HEIGHT,
    TOP_OF_TITLE,
    WIDTH,
    Sheet,
    use_decimal_comma,
)
from stepblocks.workshop.turned import (
    draw_crown_views,
    draw_hook_tip_views,
    draw_sheath_views,
    draw_straight_tip_views,
)

FORMATS = ("dxf", "svg", "pdf")
_TABLE_ROWS = 11  # of the table of a series
_MOST_ROWS = 40  # of notes over the title block
_CAPITAL = 0.729  # height of a capital of the font over its size


# who draws a kind on a sheet and returns lines for its notes; without views everything is said in
# words
VIEWS: Mapping[type, Callable[[Sheet, Any], list[str]]] = {
    StepBlock: draw_step_block_views,
    MarginBlock: draw_margin_block_views,
    CrownOnTooth: draw_crown_views,
    StraightTip: draw_straight_tip_views,
    HookTip: draw_hook_tip_views,
    Sheath: draw_sheath_views,
}


def write_drawing(
    folder: Path, part: Part, formats: Sequence[str] = FORMATS, order: OrderSpec = NO_ORDER
) -> list[Path]:
    """Draw a part with its views; what none of them shows stands in words."""
    return _write_all(folder, f"{part.id}.drawing", formats, lambda: draw_part_sheet(part, order))


def write_series_drawing(
    folder: Path, name: str, blocks: Sequence[StepBlock], order: OrderSpec
) -> list[Path]:
    """Draw blocks that differ in their heights only, eleven in the table of each sheet."""
    written = []
    count = math.ceil(len(blocks) / _TABLE_ROWS)
    for number in range(count):
        some = blocks[number * _TABLE_ROWS : (number + 1) * _TABLE_ROWS]
        stem = f"{name}.series-{number + 1}" if number else f"{name}.series"
        draw = partial(draw_part_sheet, some[0], order, (name, f"{number + 1} of {count}", some))
        written += _write_all(folder, stem, FORMATS, draw)
    return written


def draw_part_sheet(
    stimulus: Part,
    order: OrderSpec = NO_ORDER,
    series: tuple[str, str, Sequence[StepBlock]] | None = None,
) -> Sheet:
    """Draw the sheet of a part.

    Of a series (its name, number of the sheet, blocks) the part is the first; it has the letter H
    for its height, and the heights of all stand in a table.
    """
    sheet = Sheet(list(stimulus.characteristics()))
    density = stimulus.material.density
    fields = {
        "identity": stimulus.id.upper(),
        "material": stimulus.material.order_text,
        "mass": "-"
        if density is None
        else use_decimal_comma(f"{density.value * math.fsum(stimulus.volumes()) * 1e3:.4g} g"),
        "drawn by": order.author or "-",
        "approved by": order.approved_by or "-",
        "owner": order.owner or "-",
        "date": order.date or "-",
        "revision": order.revision or "-",
        "quantity": str(order.quantity),
        "sheet": "1 of 1",
    }
    if series is not None:
        name, place, blocks = series
        sheet.letters = dict.fromkeys(("step_height", "groove_depth", "ridge_height"), "H")
        fields |= {
            "identity": f"{name.upper()}, series",
            "mass": "-",
            "quantity": f"{order.quantity} of each",
            "sheet": place,
        }
        heights = [
            (
                one.id.upper(),
                use_decimal_comma(
                    format_limits(one.height.nominal, one.height.lower, one.height.upper)
                ),
            )
            for one in blocks
        ]
        sheet.write_table((150.0, 84.0), [("identity, engraved", "H"), *heights], (42.0, 34.0))
    draw = next((VIEWS[kind] for kind in type(stimulus).__mro__ if kind in VIEWS), None)
    notes = draw(sheet, stimulus) if draw else []
    governing = stimulus.governing_field.replace("_", " ")
    # what no view shows is said in words, with its number
    lines = [
        (f"{n}  {one.label.replace('.', ',')}: {sheet.format_limits(key)}", key)
        for key, (n, one) in sheet.listed.items()
        if n not in sheet.numbers
    ]
    if stimulus.has_working_faces:
        sheet.draw_texture((100.0, 16.0))
        notes += filter(None, [describe_default_demands(stimulus)])
    elif governing:
        rough = use_decimal_comma(f"{stimulus.face_demands['roughness'].upper * 1e6:.2f}")
        notes.append(
            f"Ra {rough} µm or better where a tip touches, from the tolerance of the {governing}."
        )
    lines += [(note, "") for note in notes]
    rows = min(len(lines), _MOST_ROWS)
    for start in range(0, len(lines), _MOST_ROWS):  # the columns of a long list start level
        sheet.write_notes(
            (232.0 + 92.0 * (start // _MOST_ROWS), TOP_OF_TITLE - 1.0 + 5.0 * rows),
            lines[start : start + _MOST_ROWS],
        )
    sheet.draw_border(f"{stimulus.kind_name.capitalize()}, part drawing", fields)
    return sheet


def _write_all(
    folder: Path, name: str, formats: Sequence[str], draw: Callable[[], Sheet]
) -> list[Path]:
    paths = [folder / f"{name}.{form}" for form in formats]
    with _pin_ezdxf():
        sheet = draw()
        for path in paths:
            with write_atomically(path) as draft:
                if path.suffix == ".dxf":
                    # ezdxf takes classes from a set, whose order differs by process
                    for kind in sorted(sheet.document.entitydb.dxf_types_in_use()):
                        sheet.document.classes.add_class(kind)
                    sheet.document.saveas(draft)
                else:
                    random.seed(0)  # by which ezdxf moves the lines of a hatching a little
                    _render(sheet, draft)
    return paths


@contextmanager
def _pin_ezdxf() -> Iterator[None]:
    # Let ezdxf write no time and no random identifier, and use matplotlib's fonts only; the
    # random numbers of whoever draws go on where they were
    import ezdxf
    from ezdxf.fonts import fonts

    state = random.getstate()
    before = (
        ezdxf.options.write_fixed_meta_data_for_testing,
        fonts.font_manager,
        fonts.TrueTypeFont._glyph_caches,
    )
    ezdxf.options.write_fixed_meta_data_for_testing = True
    fonts.font_manager, fonts.TrueTypeFont._glyph_caches = _load_fonts()
    try:
        yield
    finally:
        random.setstate(state)
        (
            ezdxf.options.write_fixed_meta_data_for_testing,
            fonts.font_manager,
            fonts.TrueTypeFont._glyph_caches,
        ) = before


@cache
def _load_fonts() -> tuple[object, dict[str, object]]:
    from ezdxf.fonts.font_manager import FontManager

    manager = FontManager()
    manager.scan_folder(Path(mpl.get_data_path()) / "fonts" / "ttf")
    return manager, {}


def _render(sheet: Sheet, path: Path) -> None:
    # Draw what the DXF holds; its letters stay letters, which can be searched
    from ezdxf.addons.drawing import Frontend, RenderContext
    from ezdxf.addons.drawing.config import (
        BackgroundPolicy,
        ColorPolicy,
        Configuration,
        LineweightPolicy,
    )
    from ezdxf.addons.drawing.matplotlib import MatplotlibBackend
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.font_manager import FontProperties

    with mpl.rc_context({"svg.hashsalt": "stepblocks", "svg.fonttype": "none", "pdf.fonttype": 42}):
        figure = Figure(figsize=(WIDTH / 25.4, HEIGHT / 25.4))
        FigureCanvasAgg(figure)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        font = FontProperties(fname=Path(mpl.get_data_path()) / "fonts" / "ttf" / FONT)

        def draw_letters(
            text: str, transform: Any, properties: object, cap_height: float, dxftype: str = "TEXT"
        ) -> None:
            origin, ahead = (
                transform.transform((0.0, 0.0, 0.0)),
                transform.transform((1.0, 0.0, 0.0)),
            )
            axes.text(
                origin.x,
                origin.y,
                text.strip(),
                fontsize=cap_height * (ahead - origin).magnitude * 72.0 / 25.4 / _CAPITAL,
                fontproperties=font.copy(),
                va="baseline",
                rotation=math.degrees(math.atan2(ahead.y - origin.y, ahead.x - origin.x)),
                rotation_mode="anchor",
                parse_math=False,
            )

        frontend = Frontend(
            RenderContext(sheet.document),
            MatplotlibBackend(axes, adjust_figure=False),
            config=Configuration(
                background_policy=BackgroundPolicy.WHITE,
                color_policy=ColorPolicy.BLACK,
                lineweight_policy=LineweightPolicy.ABSOLUTE,
                lineweight_scaling=72.0 / 25.4,  # the backend takes millimetres for points
                min_lineweight=0.2,
            ),
        )
        frontend.pipeline.draw_text = draw_letters
        frontend.draw_layout(sheet.space, finalize=True)
        # the figure has the sheet's own proportions
        axes.set(
            xlim=(0.0, WIDTH), ylim=(0.0, HEIGHT), aspect="auto", position=(0.0, 0.0, 1.0, 1.0)
        )
        axes.set_axis_off()
        figure.savefig(
            path,
            metadata=dict.fromkeys(
                ("Date",) if path.suffix == ".svg" else ("CreationDate", "ModDate")
            ),
            dpi=150,
        )
