"""The page on which a mouse drags the probe: one file, no network."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any


def render_feel(blocks: Sequence[Mapping[str, Any]], constants: Mapping[str, float]) -> str:
    """Fill the page."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("stepblocks.simulators", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
    )
    # names are lower-case words by the rules of the stimulus file; "<" is escaped all the same
    data = json.dumps(blocks, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    return environment.get_template("feel.html").render(blocks=blocks, data=data, **constants)
