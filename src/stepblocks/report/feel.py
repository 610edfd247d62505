"""The page on which a mouse drags the probe: one file, no network."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

__all__ = ["render_feel"]


def render_feel(blocks: Sequence[Mapping[str, Any]], constants: Mapping[str, float]) -> str:
    """Fill the page.

    Parameters
    ----------
    blocks : sequence of mapping
        Per block: ``name``, ``angle`` [rad], ``trigger`` [m], ``profile`` as points [m], and the path of the ball's centre as
        ``x``, ``z`` [m], ``first``, ``last`` slopes and ``notches``.
    constants : mapping of str to float
        ``stiffness_n_per_m``, ``ring``, ``frequency_hz``, ``decay_s``, ``ball_radius_m``.

    Returns
    -------
    str
        HTML.
    """
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("stepblocks.report", "templates"), autoescape=True, undefined=jinja2.StrictUndefined
    )
    # names are lower-case words by the rules of the stimulus file; "<" is escaped all the same
    data = json.dumps(blocks, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    return environment.get_template("feel.html").render(blocks=blocks, data=data, **constants)
