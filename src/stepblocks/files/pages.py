"""Fill the pages of all rooms from their templates: one look, all text escaped."""

import html
from importlib.resources import files

from stepblocks.quantities import format_column_label, format_number, format_units

_HEAD = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>%s</title>
<style>
%s"""


def render_page(package: str, template: str, **values: object) -> str:
    """Fill a template of a package, such as ``stepblocks.loop``.

    ``head`` opens the page with the common style, ``readable`` writes units as people do.
    """
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader(package),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
    )
    environment.filters |= {
        "readable": format_units,
        "label": format_column_label,
        "figure": _format_cell,
    }
    style = files("stepblocks").joinpath("page.css").read_text(encoding="utf-8")
    environment.globals |= {"head": lambda title: _HEAD % (html.escape(title), style)}
    return environment.get_template(template).render(**values)


def _format_cell(value: object) -> str:
    # Three digits; a dash for what does not exist
    if isinstance(value, bool) or value is None:
        return "-" if value is None else str(value).lower()
    return str(value) if isinstance(value, str | int) else format_number(float(str(value)))
