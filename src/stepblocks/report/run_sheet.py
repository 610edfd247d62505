"""Run sheets to print: one page or more per participant, and the key of the codes on a page of its own file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

__all__ = ["render_key", "render_sheets"]

_TITLES = {
    "estimates": "Height estimates",
    "virtual": "Virtual blocks: height and realism",
    "constant": "Which of the two is higher",
    "magnitude": "Magnitude estimation",
}


def render_sheets(experiment: str, sheets: Mapping[str, Sequence[Mapping[str, str]]]) -> str:
    """Draw the blinded run sheets.

    Parameters
    ----------
    experiment : str
        ``"estimates"``, ``"virtual"``, ``"constant"`` or ``"magnitude"``.
    sheets : mapping
        Blinded rows by participant.

    Returns
    -------
    str
        HTML without network or script; every participant starts a new page.
    """
    columns = [name for name in next(iter(sheets.values()))[0] if name != "participant"]
    return _render("run_sheet.html", title=_TITLES[experiment], columns=columns, sheets=sheets)


def render_key(rows: Sequence[Mapping[str, str]], balance: str) -> str:
    """Draw the key for who loads the blocks.

    Parameters
    ----------
    rows : sequence of mapping
        Code, engraved, stimulus and height_um.
    balance : str
        What is to be said about the order of conditions.

    Returns
    -------
    str
        HTML without network or script.
    """
    return _render("run_key.html", rows=rows, balance=balance)


def _render(template: str, **values: object) -> str:
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("stepblocks.report", "templates"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
    )
    return environment.get_template(template).render(**values)
