"""The one font of the drawings: the DejaVu Sans that matplotlib carries, so that no machine's own fonts change a drawing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

FONT = "DejaVuSans.ttf"  # File name of the font, as the DXF names it


@contextmanager
def shipped_fonts() -> Iterator[None]:
    """Let ezdxf see only the fonts of matplotlib's data folder, and give it back its own afterwards.

    ezdxf looks fonts up in one manager per process, filled from the folders of the system; text widths, and with them
    the outlines in SVG and PDF, would differ where another version of the font is installed.
    """
    from ezdxf.fonts import fonts

    before, glyphs = fonts.font_manager, fonts.TrueTypeFont._glyph_caches
    fonts.font_manager, fonts.TrueTypeFont._glyph_caches = _shipped()
    try:
        yield
    finally:
        fonts.font_manager, fonts.TrueTypeFont._glyph_caches = before, glyphs


@cache
def _shipped() -> tuple[Any, dict[str, Any]]:
    import matplotlib as mpl
    from ezdxf.fonts.font_manager import FontManager

    manager = FontManager()
    manager.scan_folder(Path(mpl.get_data_path()) / "fonts" / "ttf")
    return manager, {}
