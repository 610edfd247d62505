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
    """Fill a template of a package.

    In a template, ``head(title)`` opens the page with the common style. The filter ``readable``
    writes units as people do, ``label`` a column's name, ``figure`` a number or a dash.

    Parameters
    ----------
    package : str
        Where the template is, such as ``stepblocks.loop``.
    template : str
        Name of the template in the package's folder ``templates``.
    **values : object
        What the template shows, by name.

    Returns
    -------
    str
        The page, HTML.
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
    environment.filters["readable"] = format_units
    environment.filters["label"] = format_column_label
    environment.filters["figure"] = _format_cell
    environment.globals["head"] = _render_page_head
    return environment.get_template(template).render(**values)


def _render_page_head(title: str) -> str:
    """Return the beginning of a page, up to the page's own style."""
    style = files("stepblocks").joinpath("page.css").read_text(encoding="utf-8")
    return _HEAD % (html.escape(title), style)


def _format_cell(value: object) -> str:
    """Write a number to three digits; a dash for what does not exist."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str | int):
        return str(value)
    return format_number(float(str(value)))
