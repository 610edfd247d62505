"""From a stimulus to its drawing as DXF, SVG and PDF."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from stepblocks.artefacts.on_paper import describe_default_demands
from stepblocks.atomic import write_atomically
from stepblocks.parts.conditions import OrderSpec
from stepblocks.parts.kind import Part
from stepblocks.parts.kinds.crown_on_tooth import CrownOnTooth
from stepblocks.parts.kinds.machined import Box, Machined
from stepblocks.parts.kinds.margin import MarginBlock
from stepblocks.parts.kinds.sheath import Sheath
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.kinds.tips import HookTip, StraightTip
from stepblocks.parts.revolution import Turned
from stepblocks.workshop.blocks import (
    draw_gauge_sheet,
    draw_margin_block_views,
    draw_step_block_views,
)
from stepblocks.workshop.gauge_route import GaugePair
from stepblocks.workshop.sheet import FONT, HEIGHT, TOP_OF_TITLE, WIDTH, Point, Sheet, choose_scale
from stepblocks.workshop.turned import (
    draw_crown_views,
    draw_hook_tip_views,
    draw_sheath_views,
    draw_straight_tip_views,
    draw_turned_views,
)

FORMATS = ("dxf", "svg", "pdf")
_NOTHING_SAID = OrderSpec()
_MOST_ROWS = 40  # of notes over the title block
_ROOM = (150.0, 150.0)  # for the three views [mm]
_GAP = 32.0  # between views [mm]
_CAPITAL = 0.729  # height of a capital of the font over its size


def draw_machined_views(
    sheet: Sheet, part: Machined, room: Point = _ROOM, foot: float = 110.0
) -> list[str]:
    """Draw a part; where its bores lie is said in words, by their numbers."""
    low, high = part.extent
    size = [1e3 * (b - a) for a, b in zip(low, high, strict=True)]
    scale = choose_scale(
        min((room[0] - _GAP) / (size[0] + size[1]), (room[1] - _GAP) / (size[1] + size[2]))
    )
    left, base = 45.0, foot + size[1] * scale + _GAP
    # which axes lie along the sheet, the corner of each view, and the axis that looks out of it
    views = {
        "front": (0, 2, left, base, "y"),
        "top": (0, 1, left, base - _GAP - size[1] * scale, "z"),
        "left": (1, 2, left + size[0] * scale + _GAP, base, "x"),
    }
    for name, (u, v, x, y, out) in views.items():
        k = 1e3 * scale
        for one in part.boxes:
            corner = x + (one.low[u] - low[u]) * k, y + (one.low[v] - low[v]) * k
            far = (
                corner[0] + (one.high[u] - one.low[u]) * k,
                corner[1] + (one.high[v] - one.low[v]) * k,
            )
            sheet.rectangle(
                corner, far, "HIDDEN" if _is_covered(one, part.boxes, (u, v), out) else "OUTLINE"
            )
        for cylinder in (*part.rods, *part.bores):
            left_of, under = x - low[u] * k, y - low[v] * k
            if cylinder.axis == out:
                middle = left_of + cylinder.start[u] * k, under + cylinder.start[v] * k
                sheet.circle(middle, 0.5 * cylinder.diameter * k)
            else:
                ends = zip(cylinder.ends[u], cylinder.ends[v], strict=True)
                corner, far = ((left_of + a * k, under + b * k) for a, b in ends)
                sheet.rectangle(corner, far, "HIDDEN" if cylinder in part.bores else "OUTLINE")
        sheet.text((x, y - 5.0), f"{name} {scale:g}:1", 2.0)
    wide, deep, tall = (length * scale for length in size)
    top = base - _GAP - deep
    for key, start, end, along in (  # over all, as far as it has plane ends
        ("length", (left, top), (left + wide, top), (left, top - 12.0)),
        ("width", (left, top), (left, top + deep), (left - 12.0, top)),
        ("height", (left, base), (left, base + tall), (left - 12.0, base)),
    ):
        if key in sheet.listed:
            sheet.dimension(key, start, end, along, scale, upright=key != "length")
    notes = [f"{part.standard}." if part.standard else "Break all edges by 0.3 mm; no burr."]
    threads = sorted({one.thread for one in part.bores if one.thread})
    return notes + [
        f"Threads: {', '.join(threads)}, tapped where the bore is said to be for them."
    ] * bool(threads)


def _is_covered(one: Box, boxes: tuple[Box, ...], axes: tuple[int, int], out: str) -> bool:
    """Tell whether another box hides this one.

    The top is seen from above, the other views from the front and from the left.
    """
    w = "xyz".index(out)
    before = [
        each
        for each in boxes
        if (each.high[w] > one.high[w] if out == "z" else each.low[w] < one.low[w])
    ]
    return any(
        all(each.low[k] <= one.low[k] and each.high[k] >= one.high[k] for k in axes)
        for each in before
    )


# who draws a kind on a sheet and returns lines for its notes; without views everything is said in
# words
VIEWS: Mapping[type, Callable[[Sheet, Any], list[str]]] = {
    StepBlock: draw_step_block_views,
    MarginBlock: draw_margin_block_views,
    CrownOnTooth: draw_crown_views,
    StraightTip: draw_straight_tip_views,
    HookTip: draw_hook_tip_views,
    Sheath: draw_sheath_views,
    Turned: draw_turned_views,  # any other turned kind
    Machined: draw_machined_views,
}


def write_drawing(
    folder: Path, part: Part, formats: Sequence[str] = FORMATS, order: OrderSpec = _NOTHING_SAID
) -> list[Path]:
    """Draw a part with its views; what none of them shows stands in words."""
    return _write_all(folder, f"{part.id}.drawing", formats, lambda: _draw_part_sheet(part, order))


def write_gauge_drawing(
    folder: Path, block: StepBlock, pair: GaugePair, order: OrderSpec
) -> list[Path]:
    """Draw the two-piece block of a pair of gauge blocks."""
    return _write_all(
        folder,
        f"{block.id}.gauge",
        FORMATS,
        lambda: draw_gauge_sheet(block, pair, _list_order_fields(order)),
    )


def write_assembly_drawing(
    folder: Path, name: str, parts: Sequence[Machined], order: OrderSpec
) -> list[Path]:
    """Draw the parts of an assembly where they are, each by its boxes and rods."""
    boxes, rods = (
        [one for part in parts for one in getattr(part, kind)] for kind in ("boxes", "rods")
    )
    whole = parts[0].model_copy(
        update={"boxes": tuple(boxes), "rods": tuple(rods), "bores": (), "between": ()}
    )
    mass = f"{math.fsum(part.mass for part in parts) * 1e3:.4g} g"

    def draw() -> Sheet:
        sheet = Sheet([])
        draw_machined_views(sheet, whole, (330.0, 245.0), 35.0)
        sheet.border(
            "Assembly",
            {"identity": name.upper(), "material": "by part", "mass": mass}
            | _list_order_fields(order),
        )
        return sheet

    return _write_all(folder, f"{name}.assembly", FORMATS, draw)


def _list_order_fields(order: OrderSpec) -> dict[str, str]:
    said = {
        "drawn by": order.author or "-",
        "date": order.date or "-",
        "revision": order.revision or "-",
    }
    return {**said, "quantity": str(order.quantity)}


def _draw_part_sheet(stimulus: Part, order: OrderSpec) -> Sheet:
    sheet = Sheet(list(stimulus.characteristics()))
    draw = next((VIEWS[kind] for kind in type(stimulus).__mro__ if kind in VIEWS), None)
    notes, governing = (
        draw(sheet, stimulus) if draw else [],
        stimulus.governing_field.replace("_", " "),
    )
    # what no view shows is said in words, with its number
    left = [(key, n, one) for key, (n, one) in sheet.listed.items() if n not in sheet.numbers]
    lines = [(f"{n}  {one.label}: {sheet.limits(key)}", key) for key, n, one in left]
    if stimulus.has_working_faces:
        notes += filter(None, [describe_default_demands(stimulus)])
    elif governing:
        rough = stimulus.face_demands["roughness"].upper * 1e6
        notes.append(
            f"Ra {rough:.2f} um or better where a tip touches, from the tolerance of the "
            f"{governing}."
        )
    lines += [(note, "") for note in notes]
    rows = min(len(lines), _MOST_ROWS)
    for start in range(0, len(lines), _MOST_ROWS):  # the columns of a long list start level
        at = 232.0 + 92.0 * (start // _MOST_ROWS), TOP_OF_TITLE - 1.0 + 5.0 * rows
        sheet.notes(at, lines[start : start + _MOST_ROWS])
    mass = stimulus.material.density.value * math.fsum(stimulus.volumes())
    told = {
        "identity": stimulus.id.upper(),
        "material": stimulus.material.designation,
        "mass": f"{mass * 1e3:.4g} g",
    }
    sheet.border(stimulus.drawing_title, told | _list_order_fields(order))
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
                    _render(sheet, draft)
    return paths


@contextmanager
def _pin_ezdxf() -> Iterator[None]:
    """Let ezdxf write no time and no random identifier, and use matplotlib's fonts only."""
    import ezdxf
    from ezdxf.fonts import fonts

    options = ezdxf.options
    before = (
        options.write_fixed_meta_data_for_testing,
        fonts.font_manager,
        fonts.TrueTypeFont._glyph_caches,
    )
    options.write_fixed_meta_data_for_testing = True
    fonts.font_manager, fonts.TrueTypeFont._glyph_caches = _load_fonts()
    try:
        yield
    finally:
        (
            options.write_fixed_meta_data_for_testing,
            fonts.font_manager,
            fonts.TrueTypeFont._glyph_caches,
        ) = before


@cache
def _load_fonts() -> tuple[Any, dict[str, object]]:
    import matplotlib as mpl
    from ezdxf.fonts.font_manager import FontManager

    manager = FontManager()
    manager.scan_folder(Path(mpl.get_data_path()) / "fonts" / "ttf")
    return manager, {}


def _render(sheet: Sheet, path: Path) -> None:
    """Draw what the DXF holds; its letters stay letters, which can be searched."""
    import matplotlib as mpl
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
        colours = {"background_policy": BackgroundPolicy.WHITE, "color_policy": ColorPolicy.BLACK}
        # the backend takes millimetres for points
        lines = {"lineweight_policy": LineweightPolicy.ABSOLUTE, "lineweight_scaling": 72.0 / 25.4}
        configuration = Configuration(**colours, **lines, min_lineweight=0.2)
        font = FontProperties(fname=Path(mpl.get_data_path()) / "fonts" / "ttf" / FONT)

        def letters(
            text: str, transform: Any, properties: Any, cap_height: float, dxftype: str = "TEXT"
        ) -> None:
            origin, ahead = (
                transform.transform((0.0, 0.0, 0.0)),
                transform.transform((1.0, 0.0, 0.0)),
            )
            turned = math.degrees(math.atan2(ahead.y - origin.y, ahead.x - origin.x))
            size = cap_height * (ahead - origin).magnitude * 72.0 / 25.4 / _CAPITAL
            how: dict[str, Any] = {
                "rotation": turned,
                "rotation_mode": "anchor",
                "parse_math": False,
            }
            axes.text(
                origin.x,
                origin.y,
                text.strip(),
                fontsize=size,
                fontproperties=font.copy(),
                va="baseline",
                **how,
            )

        backend = MatplotlibBackend(axes, adjust_figure=False)
        frontend = Frontend(RenderContext(sheet.document), backend, config=configuration)
        frontend.pipeline.draw_text = letters
        frontend.draw_layout(sheet.space, finalize=True)
        whole = {
            "xlim": (0.0, WIDTH),
            "ylim": (0.0, HEIGHT),
            "aspect": "auto",
            "position": (0.0, 0.0, 1.0, 1.0),
        }
        axes.set(**whole)  # the figure has the sheet's own proportions
        axes.set_axis_off()
        dated = ("Date",) if path.suffix == ".svg" else ("CreationDate", "ModDate")
        figure.savefig(path, metadata=dict.fromkeys(dated), dpi=150)
