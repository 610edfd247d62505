"""The HTML page, from its template."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


def plotly_script() -> str:
    """Return plotly's script, so that the page works without a network."""
    from plotly.offline import get_plotlyjs

    return str(get_plotlyjs())


def render_page(sections: Sequence[dict[str, Any]]) -> str:
    """Fill the template."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("stepblocks.build", "templates"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
    )
    total = sum(len(section["rows"]) for section in sections)
    failed = sum(bool(row["failed"]) for section in sections for row in section["rows"])
    return environment.get_template("index.html").render(sections=sections, total=total, failed=failed)
