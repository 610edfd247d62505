"""A certificate as a digital one (DCC 3.3.0, D-SI 2.2.1) and as a PDF of the same content.

What only the laboratory knows comes from its own file (`records.laboratory`); without it the
certificate is a draft that says so in each place. It is not signed: the signer's own tool adds the
XML signature (XMLDSig) to the file.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from html import unescape
from io import BytesIO
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING

from stepblocks.files.atomic import replace_bytes, replace_text
from stepblocks.files.pages import render_page
from stepblocks.parts.conditions import OrderSpec
from stepblocks.parts.kind import Part
from stepblocks.parts.tolerance import GUARD_FACTOR
from stepblocks.records.inspection import InspectionRecord, JudgedRecord
from stepblocks.records.laboratory import Laboratory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_BLANK = "to be completed by the laboratory"
_PINNED = "2000-01-01"  # where neither laboratory nor order states a date
# largest coverage factor that is certified: three degrees of freedom (EA-4/02 M, appendix E) [1]
_LARGEST_FACTOR = 3.31
_DIGEST_DIGITS = 16  # of the hash of the scan, in the identifier of a draft
RULE = (
    f"ISO 14253-1 with a guard band of {GUARD_FACTOR} u, or Student's 95 % point where u has few "
    "degrees of freedom: inside the limits by it the characteristic conforms, outside by it it "
    "does not, between neither is proven (conditional pass or fail, ILAC-G8)."
)

# pages of the PDF
_A4 = (8.27, 11.69)  # inch
_ROWS = 26  # of the table on a page
_LINES = 75  # of text alone on a page
_LINE_WIDTH = 125  # characters of a line of text
_LABEL_WIDTH = 44  # characters of a label, which may take two lines
_LINE_HEIGHT = 0.0118  # of a line of text, as a part of the page
_ROW_HEIGHT = 0.021  # of a row of the table, with room for two lines
_LOWEST = 0.02  # end of the table
_LEFT = 0.06
_TABLE_WIDTH = 0.88
_HEADINGS = ("no.", "characteristic", "value", "U (95 %)", "k", "limits", "unit", "verdict")
_COLUMN_WIDTHS = (0.04, 0.34, 0.11, 0.11, 0.05, 0.17, 0.05, 0.13)
_DEGREES = 57.29577951308232  # in a radian


class Conformity(StrEnum):
    """Conformity in the words of the DCC and of ILAC-G8, the worst first."""

    FAIL = "fail"
    CONDITIONAL_FAIL = "conditionalFail"
    CONDITIONAL_PASS = "conditionalPass"
    PASS = "pass"


@dataclass(frozen=True)
class CertifiedLimit:
    """A limit of a characteristic, as decimal text in metres or radians."""

    side: str  # ``lower`` or ``upper``
    size: str


@dataclass(frozen=True)
class CertifiedComponent:
    """A component of a budget, its standard uncertainty as decimal text in metres or radians."""

    source: str
    std: str


@dataclass(frozen=True)
class CertifiedCharacteristic:
    """A characteristic as both forms of a certificate state it.

    Sizes are decimal texts in metres or radians.
    """

    number: int  # on the drawing
    label: str
    verdict: str
    unit: str  # of D-SI
    value: str
    expanded: str  # uncertainty at 95 %
    nominal: str
    guard: str
    factor: str  # coverage factor [1]
    limits: tuple[CertifiedLimit, ...]
    budget: tuple[CertifiedComponent, ...]
    not_observed: tuple[str, ...]  # components without a number, and why
    assumed: tuple[str, ...]  # components that nobody stated, and what stands for them
    conformity: Conformity


@dataclass(frozen=True)
class OpenEnd:
    """A characteristic that is not certified, and why."""

    number: int  # on the drawing
    label: str
    reason: str


@dataclass(frozen=True)
class CertificateContent:
    """What both forms of a certificate say; names are those of the templates."""

    identity: str
    title: str
    material: str
    rule: str
    verdict: str
    statement: str
    convention: str
    scan: str
    release: str
    blank: str  # where the laboratory has to complete the draft
    customer: str
    begin: str  # first and last day of the measurement
    end: str
    digest: str
    laboratory: Laboratory | None
    conformity: str  # of the whole; empty where nothing can be stated of it
    results: tuple[CertifiedCharacteristic, ...]
    open_ends: tuple[OpenEnd, ...]

    def render_template(self, template_name: str) -> str:
        """Fill a template of this room."""
        return render_page("stepblocks.records", template_name, **vars(self))


def write_certificate(
    path: Path,
    part: Part,
    record: InspectionRecord,
    order: OrderSpec,
    scan_sha256: str,
    laboratory: Laboratory | None = None,
) -> list[Path]:
    """Write both forms of the certificate of an inspection.

    Parameters
    ----------
    path : Path
        Of the digital certificate, ``<id>.dcc.xml``; the PDF, ``<id>.certificate.pdf``, is written
        beside it.
    part : Part
        What was inspected; its characteristics give the numbers.
    record : InspectionRecord
        What was measured and judged.
    order : OrderSpec
        Its owner, or else its author, is the customer.
    scan_sha256 : str
        SHA-256 of the scan.
    laboratory : Laboratory, optional
        Without it the certificate is a draft.

    Returns
    -------
    list of Path
        The digital certificate and the PDF.
    """
    content = build_certificate_content(part, record, order, scan_sha256, laboratory)
    replace_text(path, content.render_template("dcc.xml.j2"))
    page = path.with_name(f"{path.name.removesuffix('.dcc.xml')}.certificate.pdf")
    write_certificate_pdf(page, content)
    return [path, page]


def build_certificate_content(
    part: Part,
    record: InspectionRecord,
    order: OrderSpec,
    scan_sha256: str,
    laboratory: Laboratory | None,
) -> CertificateContent:
    """Return what both forms of a certificate say, from what `write_certificate` takes."""
    from stepblocks import __version__

    numbers = {}
    for number, characteristic in enumerate(part.characteristics(), start=1):
        numbers[characteristic.key] = number
    results = []
    open_ends = []
    for entry in record.characteristics:
        if entry.key not in numbers:
            continue
        obstacle = _describe_certification_obstacle(entry)
        if obstacle:
            open_ends.append(OpenEnd(numbers[entry.key], entry.label, obstacle))
        else:
            results.append(_build_certified_characteristic(numbers[entry.key], entry))
    for absent in record.not_measured:
        reason = f"not measured: {absent.needs}"
        open_ends.append(OpenEnd(numbers[absent.key], absent.label, reason))
    if laboratory is None:
        begin = end = order.date or _PINNED
    else:
        begin, end = laboratory.measured_from, laboratory.measured_to
    return CertificateContent(
        identity=part.id.upper(),
        title=part.kind_name.capitalize(),
        material=part.material.designation,
        rule=RULE,
        verdict=record.verdict,
        statement=record.statement,
        convention=record.convention,
        scan=record.scan,
        release=__version__,
        blank=_BLANK,
        customer=_get_customer_name(order, laboratory),
        begin=begin,
        end=end,
        digest=scan_sha256[:_DIGEST_DIGITS],
        laboratory=laboratory,
        conformity=_determine_overall_conformity(results, record.is_complete),
        results=tuple(results),
        open_ends=tuple(sorted(open_ends, key=lambda open_end: open_end.number)),
    )


def _get_customer_name(order: OrderSpec, laboratory: Laboratory | None) -> str:
    """Return the customer that the laboratory names, or else the owner or author of the order."""
    if laboratory is not None and laboratory.customer:
        return laboratory.customer
    return order.owner or order.author


def _describe_certification_obstacle(judged: JudgedRecord) -> str:
    """Return why a value is not certified; empty where nothing stands against it."""
    if not judged.uncertainty_stated:
        return "measured, without a stated uncertainty"
    if judged.bound:
        return f"known as a bound only: {judged.bound} {_describe_one_sided_value(judged)}"
    if judged.coverage_factor > _LARGEST_FACTOR:
        return (
            f"too few profiles or scans: coverage factor {judged.coverage_factor:.2f}, "
            f"at most {_LARGEST_FACTOR}; four scans of the part or more suffice"
        )
    return ""


def _describe_one_sided_value(judged: JudgedRecord) -> str:
    """Write the value of a bound with its expanded uncertainty, limits and verdict."""
    factor, unit = 1e6, "um"
    if judged.unit == "rad":
        factor, unit = _DEGREES, "deg"
    low, high = judged.interval_95
    half = 0.5 * (high - low) * factor
    limits = []
    if judged.lower_limit is not None:
        limits.append(f"at least {judged.lower_limit * factor:.7g}")
    if judged.upper_limit is not None:
        limits.append(f"at most {judged.upper_limit * factor:.7g}")
    text = f"{judged.value * factor:.3g} {unit}, U (95 %) {half:.2g} {unit}"
    return f"{text}; required {' and '.join(limits) or 'nothing'} {unit}: {judged.verdict}"


def _determine_overall_conformity(results: list[CertifiedCharacteristic], is_complete: bool) -> str:
    """Return the worst conformity of all results.

    Of a part that was not wholly measured nothing is stated as a whole, unless it fails: then, and
    of no results, the text is empty.
    """
    if not results:
        return ""
    worst_first = list(Conformity)
    worst = min((result.conformity for result in results), key=worst_first.index)
    if is_complete or worst is Conformity.FAIL:
        return worst
    return ""


def _build_certified_characteristic(
    drawing_number: int, judged: JudgedRecord
) -> CertifiedCharacteristic:
    """Return a characteristic as the certificate states it, by its number on the drawing."""
    low, high = judged.interval_95
    limits = []
    if judged.lower_limit is not None:
        limits.append(CertifiedLimit("lower", _format_dsi_decimal(judged.lower_limit)))
    if judged.upper_limit is not None:
        limits.append(CertifiedLimit("upper", _format_dsi_decimal(judged.upper_limit)))
    # what is unknown is no zero: it is named in the text and has no number
    budget = []
    not_observed = []
    assumed = []
    for part in judged.budget:
        if part.std is None:
            not_observed.append(f"{part.name}: {part.how}")
        else:
            budget.append(CertifiedComponent(part.name, _format_dsi_decimal(part.std)))
        if part.assumed:
            assumed.append(f"{part.name} {part.how}")
    unit = "\\metre"
    if judged.unit == "rad":
        unit = "\\radian"
    return CertifiedCharacteristic(
        number=drawing_number,
        label=judged.label,
        verdict=judged.verdict,
        unit=unit,
        value=_format_dsi_decimal(judged.value),
        expanded=_format_dsi_decimal(0.5 * (high - low)),
        nominal=_format_dsi_decimal(judged.nominal),
        guard=_format_dsi_decimal(judged.guard_band),
        factor=f"{judged.coverage_factor:.3f}",
        limits=tuple(limits),
        budget=tuple(budget),
        not_observed=tuple(not_observed),
        assumed=tuple(assumed),
        conformity=_determine_conformity(judged),
    )


def _determine_conformity(judged: JudgedRecord) -> Conformity:
    """Return the conformity of a characteristic, conditional where neither is proven."""
    if judged.verdict == "conforms":
        return Conformity.PASS
    if judged.verdict == "does not conform":
        return Conformity.FAIL
    is_below = judged.lower_limit is not None and judged.value < judged.lower_limit
    is_above = judged.upper_limit is not None and judged.value > judged.upper_limit
    if is_below or is_above:
        return Conformity.CONDITIONAL_FAIL
    return Conformity.CONDITIONAL_PASS


def _format_dsi_decimal(size: float) -> str:
    """Write a size to a tenth of a pico unit, in the notation that D-SI takes for decimals."""
    text = f"{size:.13f}".rstrip("0").rstrip(".")
    if text in ("", "-0"):
        return "0"
    return text


def write_certificate_pdf(path: Path, content: CertificateContent) -> None:
    """Write the certificate as A4 pages."""
    from matplotlib.backends.backend_pdf import PdfPages

    lines = _wrap_paragraphs_to_page(
        unescape(content.render_template("certificate.txt.j2")).splitlines()
    )
    rows = list(map(format_table_cells, content.results))
    pages = []
    for first in range(0, max(len(rows), 1), _ROWS):
        pages.append((lines, rows[first : first + _ROWS]))
    annex = _wrap_paragraphs_to_page(_format_annex_lines(content))
    for first in range(0, len(annex), _LINES):
        pages.append((annex[first : first + _LINES], []))
    # in memory, since on a full disk the library ends in an error of its compressor
    with BytesIO() as file:
        with PdfPages(file, metadata={"CreationDate": None, "ModDate": None}) as document:
            for number, (text, table) in enumerate(pages, start=1):
                heading = f"Certificate   {content.identity}   page {number} of {len(pages)}"
                document.savefig(_draw_certificate_page(heading, text, table))
        replace_bytes(path, file.getvalue())


def _wrap_paragraphs_to_page(paragraphs: Iterable[str]) -> list[str]:
    """Break paragraphs into lines that fit the page."""
    lines = []
    for paragraph in paragraphs:
        lines += wrap(paragraph, _LINE_WIDTH) or [""]
    return lines


def _format_annex_lines(content: CertificateContent) -> list[str]:
    """Write what stands behind the results: their budgets, and what is not certified."""
    lines = []
    if content.results:
        lines.append("uncertainty budgets, standard uncertainties")
    for result in content.results:
        factor, unit = _choose_factor_and_unit(result)
        parts = []
        for component in result.budget:
            parts.append(f"{component.source} {float(component.std) * factor:.3g} {unit}")
        parts += result.not_observed
        lines.append(f"{result.number} {result.label}: {'; '.join(parts)}")
    if content.open_ends:
        lines += ["", "not certified"]
    for open_end in content.open_ends:
        lines.append(f"{open_end.number} {open_end.label}: {open_end.reason}")
    return lines


def _choose_factor_and_unit(result: CertifiedCharacteristic) -> tuple[float, str]:
    """Return the unit in which a characteristic is shown, with how many make one of the SI."""
    if result.unit == "\\metre":
        return 1e6, "um"
    return _DEGREES, "deg"


def _draw_certificate_page(
    heading: str, text_lines: list[str], table_rows: list[list[str]]
) -> "Figure":
    """Draw one page: heading, lines of text, and rows of the table below them, if any."""
    from matplotlib.figure import Figure
    from matplotlib.transforms import Bbox

    figure = Figure(figsize=_A4)
    figure.text(_LEFT, 0.96, heading, fontsize=14, weight="bold")
    figure.text(_LEFT, 0.94, "\n".join(text_lines), fontsize=7, va="top")
    if not table_rows:
        return figure
    height = _ROW_HEIGHT * (len(table_rows) + 1)
    bottom = max(0.93 - _LINE_HEIGHT * len(text_lines) - height, _LOWEST)
    axes = figure.add_axes((_LEFT, bottom, _TABLE_WIDTH, height))
    axes.set_axis_off()
    table = axes.table(
        cellText=table_rows,
        cellLoc="left",
        colLabels=_HEADINGS,
        colWidths=_COLUMN_WIDTHS,
        bbox=Bbox.unit(),
    )
    table.auto_set_font_size(False)
    table.set_fontsize(6.5)
    return figure


def format_table_cells(result: CertifiedCharacteristic) -> list[str]:
    """Return the cells of a characteristic, lengths in micrometres and angles in degrees.

    The uncertainty has two digits, and the value as many decimals (JCGM 100, 7.2.6).
    """
    factor, unit = _choose_factor_and_unit(result)
    ends = {}
    for limit in result.limits:
        ends[limit.side] = f"{float(limit.size) * factor:.7g}"
    limits = f"{ends.get('lower', '')} to {ends.get('upper', '')}".strip()
    half = float(result.expanded) * factor
    exponent = int(f"{half:e}".partition("e")[2])
    decimals = max(1 - exponent, 0)
    return [
        str(result.number),
        "\n".join(wrap(result.label, _LABEL_WIDTH)),
        f"{float(result.value) * factor:.{decimals}f}",
        f"{half:.{decimals}f}",
        result.factor,
        limits,
        unit,
        result.verdict,
    ]
