"""From a stimulus to its drawing as DXF, SVG and PDF, and back from the DXF to the numbers that stand on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stepblocks.artefacts.numbers import limits_text
from stepblocks.atomic import beside
from stepblocks.errors import MachiningError
from stepblocks.parts.characteristics import Characteristic, characteristics_of
from stepblocks.parts.kind import Part
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.revolution import Turned
from stepblocks.workshop.drawing.lettering_font import shipped_fonts
from stepblocks.workshop.gauge_route import GaugePair


@dataclass(frozen=True)
class DrawnDimension:
    """A dimension read back from a DXF file."""

    key: str  # Key of the characteristic
    number: int  # Its number on the drawing
    value: float  # What the drawn geometry measures at the scale of its view [m]
    lower: float  # Deviations [m]
    upper: float
    text: str  # What is printed


def write_drawing(folder: Path, stimulus: Part, formats: tuple[str, ...] = ("dxf", "svg", "pdf")) -> list[Path]:
    """Draw a part."""
    if set(formats) - {"dxf", "svg", "pdf"}:
        raise MachiningError(f"formats must be of dxf, svg, pdf, got {', '.join(formats)}")
    listed = characteristics_of(stimulus)
    numbered = {one.key: (index, one) for index, one in enumerate(listed, start=1)}
    return _write_all(folder, f"{stimulus.id}.drawing", formats, lambda: _drawn(stimulus, listed, numbered))


def write_gauge_drawing(folder: Path, block: StepBlock, pair: GaugePair) -> list[Path]:
    """Draw the two-piece block of a pair of gauge blocks."""
    from stepblocks.workshop.drawing.gauge_views import gauge_sheet

    return _write_all(folder, f"{block.id}.gauge", ("dxf", "svg", "pdf"), lambda: gauge_sheet(block, pair))


def _write_all(folder: Path, name: str, formats: tuple[str, ...], draw: Callable[[], Any]) -> list[Path]:
    import ezdxf

    paths = []
    before = ezdxf.options.write_fixed_meta_data_for_testing
    ezdxf.options.write_fixed_meta_data_for_testing = True  # no time of day, no random identifiers
    try:
        with shipped_fonts():
            sheet = draw()
            for form in formats:
                path = folder / f"{name}.{form}"
                with beside(path) as draft:
                    if form == "dxf":
                        _register_classes(sheet.document)
                        sheet.document.saveas(draft)
                    else:
                        _render(sheet, draft)
                paths.append(path)
    finally:
        ezdxf.options.write_fixed_meta_data_for_testing = before
    return paths


def _register_classes(document: Any) -> None:
    """Register the classes in use in alphabetical order; ezdxf takes them from a set, whose order differs by process."""
    for name in sorted(document.entitydb.dxf_types_in_use()):
        document.classes.add_class(name)


def _drawn(stimulus: Part, listed: list[Characteristic], numbered: dict[str, tuple[int, Characteristic]]) -> Any:
    from stepblocks.workshop.drawing.block_views import margin_block_views, step_block_views
    from stepblocks.workshop.drawing.round_views import crown_views, tip_views, turned_views
    from stepblocks.workshop.drawing.sheath_views import sheath_views
    from stepblocks.workshop.drawing.sheet import Sheet

    views: dict[str, Callable[[Any, Any, Any], list[str]]] = {
        "step_block": step_block_views,
        "margin_block": margin_block_views,
        "crown_on_tooth": crown_views,
        "straight_tip": tip_views,
        "hook_tip": tip_views,
        "sheath": sheath_views,
    }
    sheet = Sheet()
    if stimulus.stanza in views:
        notes = views[stimulus.stanza](sheet, stimulus, numbered)
    else:  # a kind without views of its own: its half sections where it is turned, all else in words
        notes = turned_views(sheet, stimulus, numbered) if isinstance(stimulus, Turned) else []
    # what no view shows is said in words, with its number
    lines = [f"{number}  {one.label}: {_note(one)}" for number, one in numbered.values() if number not in sheet.numbers]
    demands, said = stimulus.face_demands, " (by default)"
    if stimulus.has_working_faces:
        said = f" (by default: {', '.join(demands.defaults)})" if demands.defaults else ""
    lines += [f"Working faces Ra {demands.roughness * 1e6:.2f} um or better{said}.", *notes]
    sheet.notes((232.0, 66.0 + 5.0 * len(lines)), lines)
    sheet.border(
        [
            ("identity", stimulus.id.upper()),
            ("material", stimulus.material.designation),
            ("unit", "mm"),
            ("general tolerances", "ISO 2768-m"),
            ("tolerancing", "ISO 8015, ISO 1101"),
            ("reference temperature", "20 deg C (ISO 1)"),
            ("edges", "ISO 13715"),
            ("projection, size", "first angle, A3"),
        ],
        stimulus.titled,
    )
    return sheet


def _note(one: Characteristic) -> str:
    if one.quantity == "angle":
        import math

        low, high = (math.degrees(value) for value in (one.lower, one.upper))
        return f"{math.degrees(one.nominal):g} deg {high:+g}/{low:+g} deg"
    return limits_text(one.nominal, one.lower, one.upper)


def _render(sheet: Any, path: Path) -> None:
    import matplotlib as mpl
    from ezdxf.addons.drawing import Frontend, RenderContext
    from ezdxf.addons.drawing.config import BackgroundPolicy, ColorPolicy, Configuration, LineweightPolicy
    from ezdxf.addons.drawing.matplotlib import MatplotlibBackend
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from stepblocks.workshop.drawing.sheet import HEIGHT, WIDTH

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
        metadata = (
            {"Date": None}
            if path.suffix == ".svg"
            else {"CreationDate": None, "ModDate": None}
            if path.suffix == ".pdf"
            else {}
        )
        figure.savefig(path, metadata=metadata, dpi=150)


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
        found.append(
            DrawnDimension(
                str(tags[0].value),
                int(tags[1].value),
                measured / 1e3,
                -float(style.get("dimtm", 0.0)) / 1e3,
                float(style.get("dimtp", 0.0)) / 1e3,
                printed,
            )
        )
    return sorted(found, key=lambda one: one.number)
