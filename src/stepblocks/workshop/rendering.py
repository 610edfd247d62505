"""From a sheet to its files: DXF, and SVG and PDF drawn from it."""

import math
import random
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib as mpl

from stepblocks.files.atomic import write_atomically
from stepblocks.workshop.paper import FONT, HEIGHT, WIDTH, Paper

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FORMATS = ("dxf", "svg", "pdf")
_CAPITAL = 0.729  # height of a capital of the font over its size
_MILLIMETRES_PER_INCH = 25.4
_POINTS_PER_INCH = 72.0
_RESOLUTION = 150  # of what cannot be drawn as lines [dots per inch]
_LEAST_LINE_WIDTH = 0.2  # [mm]
_HATCH_SEED = 0  # of the small random shifts with which ezdxf draws hatch lines
# of matplotlib: names by content, and letters as letters
_PINNED = {"svg.hashsalt": "stepblocks", "svg.fonttype": "none", "pdf.fonttype": 42}


def write_sheet_files(
    folder: Path, stem: str, formats: Sequence[str], draw_paper: Callable[[], Paper]
) -> list[Path]:
    """Draw a sheet and write it in each format.

    Parameters
    ----------
    folder : Path
        Where the files go.
    stem : str
        Of the files, without the suffix of the format.
    formats : sequence of str
        Of ``"dxf"``, ``"svg"`` and ``"pdf"``.
    draw_paper : callable
        Draws the sheet; it is called where ezdxf writes neither times nor random identifiers.

    Returns
    -------
    list of Path
        A file of each format.
    """
    paths = [folder / f"{stem}.{suffix}" for suffix in formats]
    with _make_ezdxf_deterministic(), mpl.rc_context(_PINNED):
        paper = draw_paper()
        draw_once = cache(partial(_render_as_figure, paper))
        for path in paths:
            with write_atomically(path) as draft:
                if path.suffix == ".dxf":
                    _save_dxf(paper, draft)
                else:
                    _save_svg_or_pdf(draw_once(), draft)
    return paths


def _save_dxf(paper: Paper, path: Path) -> None:
    """Save the drawing; ezdxf takes classes from a set, whose order differs by process."""
    for dxf_type in sorted(paper.document.entitydb.dxf_types_in_use()):
        paper.document.classes.add_class(dxf_type)
    paper.document.saveas(path)


@contextmanager
def _make_ezdxf_deterministic() -> Iterator[None]:
    """Let ezdxf write no time and no random identifier, and use matplotlib's fonts only.

    Random numbers of the caller go on afterwards where they were.
    """
    import ezdxf
    from ezdxf.fonts import fonts

    random_state = random.getstate()
    fixed_metadata = ezdxf.options.write_fixed_meta_data_for_testing
    font_manager = fonts.font_manager
    glyph_caches = fonts.TrueTypeFont._glyph_caches
    pinned_manager, pinned_caches = _load_font_manager_and_glyph_cache()
    ezdxf.options.write_fixed_meta_data_for_testing = True
    fonts.font_manager = pinned_manager
    fonts.TrueTypeFont._glyph_caches = pinned_caches
    try:
        yield
    finally:
        random.setstate(random_state)
        ezdxf.options.write_fixed_meta_data_for_testing = fixed_metadata
        fonts.font_manager = font_manager
        fonts.TrueTypeFont._glyph_caches = glyph_caches


@cache
def _load_font_manager_and_glyph_cache() -> tuple[object, dict[str, object]]:
    """Return ezdxf's manager of the fonts that matplotlib ships, and a cache of glyphs for it."""
    from ezdxf.fonts.font_manager import FontManager

    manager = FontManager()
    manager.scan_folder(_find_font_folder())
    return manager, {}


def _find_font_folder() -> Path:
    """Return the folder of the fonts that matplotlib ships."""
    return Path(mpl.get_data_path()) / "fonts" / "ttf"


def _render_as_figure(paper: Paper) -> "Figure":
    """Draw with matplotlib what the DXF holds."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    random.seed(_HATCH_SEED)
    figure = Figure(figsize=(WIDTH / _MILLIMETRES_PER_INCH, HEIGHT / _MILLIMETRES_PER_INCH))
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    _draw_on_axes(paper, axes)
    # the figure has the proportions of the sheet
    axes.set(xlim=(0.0, WIDTH), ylim=(0.0, HEIGHT), aspect="auto", position=(0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    return figure


def _save_svg_or_pdf(figure: "Figure", path: Path) -> None:
    """Save a figure as SVG or PDF by the suffix of a path, without the time."""
    dates: tuple[str, ...] = ("CreationDate", "ModDate")
    if path.suffix == ".svg":
        dates = ("Date",)
    figure.savefig(path, metadata=dict.fromkeys(dates), dpi=_RESOLUTION)


def _draw_on_axes(paper: Paper, axes: Any) -> None:
    """Draw all entities; letters stay letters, which can be searched."""
    from ezdxf.addons.drawing import Frontend, RenderContext
    from ezdxf.addons.drawing.config import (
        BackgroundPolicy,
        ColorPolicy,
        Configuration,
        LineweightPolicy,
    )
    from ezdxf.addons.drawing.matplotlib import MatplotlibBackend
    from matplotlib.font_manager import FontProperties

    font = FontProperties(fname=_find_font_folder() / FONT)

    def draw_letters(
        text: str, transform: Any, properties: object, cap_height: float, dxftype: str = "TEXT"
    ) -> None:
        origin = transform.transform((0.0, 0.0, 0.0))
        ahead = transform.transform((1.0, 0.0, 0.0))
        height = cap_height * (ahead - origin).magnitude
        axes.text(
            origin.x,
            origin.y,
            text.strip(),
            fontsize=height * _POINTS_PER_INCH / _MILLIMETRES_PER_INCH / _CAPITAL,
            fontproperties=font.copy(),
            va="baseline",
            rotation=math.degrees(math.atan2(ahead.y - origin.y, ahead.x - origin.x)),
            rotation_mode="anchor",
            parse_math=False,
        )

    frontend = Frontend(
        RenderContext(paper.document),
        MatplotlibBackend(axes, adjust_figure=False),
        config=Configuration(
            background_policy=BackgroundPolicy.WHITE,
            color_policy=ColorPolicy.BLACK,
            lineweight_policy=LineweightPolicy.ABSOLUTE,
            # the backend takes millimetres for points
            lineweight_scaling=_POINTS_PER_INCH / _MILLIMETRES_PER_INCH,
            min_lineweight=_LEAST_LINE_WIDTH,
        ),
    )
    frontend.pipeline.draw_text = draw_letters
    frontend.draw_layout(paper.space, finalize=True)
