"""How a page of a room is filled from its template: everything escaped, nothing left undefined."""

from __future__ import annotations


def render_page(room: str, template: str, **values: object) -> str:
    """Fill a template of a room."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader(f"stepblocks.{room}"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
    )
    return environment.get_template(template).render(**values)
