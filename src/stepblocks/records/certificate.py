"""A certificate as a digital one (DCC 3.3.0, D-SI 2.2.1) and as a PDF of the same content.

What only the laboratory knows comes from its own file (`artefacts.laboratory`); without it the
certificate is a draft that says so in each place. It is not signed: the signer's own tool adds the
XML signature (XMLDSig) to the file.
"""

from html import unescape
from io import BytesIO
from pathlib import Path
from textwrap import wrap

from stepblocks.files.atomic import replace_bytes, replace_text
from stepblocks.files.pages import render_page
from stepblocks.files.text import Document
from stepblocks.parts.conditions import OrderSpec
from stepblocks.parts.kind import Part
from stepblocks.parts.tolerance import GUARD_FACTOR
from stepblocks.records.laboratory import Laboratory

_BLANK = "to be completed by the laboratory"
_PINNED = "2000-01-01"  # where neither laboratory nor order states a date
# largest coverage factor that is certified: three degrees of freedom (EA-4/02 M, appendix E) [1]
_LARGEST_FACTOR = 3.31
_LINES = 26  # of the table on a page of the PDF
RULE = (
    f"ISO 14253-1 with a guard band of {GUARD_FACTOR} u, or Student's 95 % point where u has few "
    "degrees of freedom: inside the limits by it the characteristic conforms, outside by it it "
    "does not, between neither is proven (conditional pass or fail, ILAC-G8)."
)
_HEADINGS = ("no.", "characteristic", "value", "U (95 %)", "k", "limits", "unit", "verdict")
_WIDTHS = (0.04, 0.34, 0.11, 0.11, 0.05, 0.17, 0.05, 0.13)


def write_certificate(
    path: Path,
    part: Part,
    record: Document,
    order: OrderSpec,
    digest: str,
    laboratory: Laboratory | None = None,
) -> list[Path]:
    """Write both forms of the certificate of an inspection.

    The owner of the order, or else its author, is the customer.
    """
    content = _collect_content(part, record, order, digest, laboratory)
    replace_text(path, render_page("stepblocks.records", "dcc.xml.j2", **content))
    page = path.with_name(f"{path.name.removesuffix('.dcc.xml')}.certificate.pdf")
    _write_pdf(page, content)
    return [path, page]


def _collect_content(
    part: Part,
    record: Document,
    order: OrderSpec,
    digest: str,
    laboratory: Laboratory | None,
) -> Document:
    # Return what both forms of a certificate say.
    from stepblocks import __version__

    numbers = {one.key: number for number, one in enumerate(part.characteristics(), start=1)}
    listed = [one for one in record["characteristics"] if one["key"] in numbers]
    reasons = [
        *((one, _find_obstacle(one)) for one in listed),
        *((one, f"not measured: {one['needs']}") for one in record["not_measured"]),
    ]
    results = [_format_line(numbers[one["key"]], one) for one, reason in reasons if not reason]
    worst_first = ("fail", "conditionalFail", "conditionalPass", "pass")
    worst = min((one["conformity"] for one in results), key=worst_first.index, default="")
    complete = not any(one["asked"] for one in record["not_measured"])
    date = order.date or _PINNED
    return {
        "identity": part.id.upper(),
        "title": part.kind_name.capitalize(),
        "material": part.material.designation,
        "rule": RULE,
        "verdict": record["verdict"],
        "statement": record["statement"],
        "convention": record["convention"],
        "scan": record["scan"],
        "release": __version__,
        "blank": _BLANK,
        "customer": order.owner or order.author,
        "begin": date if laboratory is None else laboratory.measured_from,
        "end": date if laboratory is None else laboratory.measured_to,
        "digest": digest[:16],
        "laboratory": laboratory,
        # of a part that was not wholly measured nothing is stated as a whole, unless it fails
        "conformity": worst if complete or worst == "fail" else "",
        "results": results,
        "open_ends": sorted(
            (numbers[one["key"]], one["label"], reason) for one, reason in reasons if reason
        ),
    }


def _find_obstacle(entry: Document) -> str:
    # Say why a value is not certified; empty where nothing stands against it.
    if not entry["uncertainty_stated"]:
        return "measured, without a stated uncertainty"
    if entry["bound"]:
        return f"known as a bound only: {entry['bound']} the measured value"
    if entry["coverage_factor"] > _LARGEST_FACTOR:
        return (
            f"too few profiles or scans: coverage factor {entry['coverage_factor']:.2f}, "
            f"at most {_LARGEST_FACTOR}; four scans of the part or more suffice"
        )
    return ""


def _format_line(number: int, entry: Document) -> Document:
    # Return one characteristic, every size as text in metres or radians.
    unit = entry["unit"]
    low, high = entry[f"interval_95_{unit}"]
    value, lower, upper = (
        entry[f"{name}_{unit}"] for name in ("value", "lower_limit", "upper_limit")
    )
    inside = (lower is None or value >= lower) and (upper is None or value <= upper)
    status = {"conforms": "pass", "does not conform": "fail"}.get(entry["verdict"])
    budget = [(part["name"], part[f"std_{unit}"], part["how"]) for part in entry["budget"]]
    return {
        "number": number,
        "label": entry["label"],
        "verdict": entry["verdict"],
        "unit": {"m": "\\metre", "rad": "\\radian"}[unit],
        "value": _format_decimal(value),
        "expanded": _format_decimal(0.5 * (high - low)),
        "nominal": _format_decimal(entry[f"nominal_{unit}"]),
        "guard": _format_decimal(entry[f"guard_band_{unit}"]),
        "factor": f"{entry['coverage_factor']:.3f}",
        "limits": [
            (side, _format_decimal(end))
            for side, end in (("lower", lower), ("upper", upper))
            if end is not None
        ],
        # what is unknown is no zero: it is named in the text and has no number
        "budget": [(name, _format_decimal(std)) for name, std, _ in budget if std is not None],
        "not_observed": [f"{name}: {origin}" for name, std, origin in budget if std is None],
        "assumed": [
            f"{name} {origin}" for name, _, origin in budget if origin.startswith("not stated")
        ],
        "conformity": status or ("conditionalPass" if inside else "conditionalFail"),
    }


def _format_decimal(size: float) -> str:
    # Write a size to a tenth of a pico unit, in the notation that D-SI takes for decimals.
    text = f"{size:.13f}".rstrip("0").rstrip(".")
    return "0" if text in ("", "-0") else text


def _write_pdf(path: Path, content: Document) -> None:
    # Write the certificate as A4 pages.
    from matplotlib.backends.backend_pdf import PdfPages
    from matplotlib.figure import Figure
    from matplotlib.transforms import Bbox

    rows = [_format_row(one) for one in content["results"]]
    text = unescape(render_page("stepblocks.records", "certificate.txt.j2", **content))
    lines = [line for long in text.splitlines() for line in wrap(long, 125) or [""]]
    pages = [rows[at : at + _LINES] for at in range(0, len(rows), _LINES)] or [[]]
    with BytesIO() as whole:  # on a full disk the library ends in an error of its compressor
        with PdfPages(whole, metadata={"CreationDate": None, "ModDate": None}) as document:
            for number, own in enumerate(pages, start=1):
                figure = Figure(figsize=(8.27, 11.69))
                figure.text(
                    0.06,
                    0.96,
                    f"Certificate   {content['identity']}   page {number} of {len(pages)}",
                    fontsize=14,
                    weight="bold",
                )
                figure.text(0.06, 0.94, "\n".join(lines), fontsize=7, va="top")
                if own:
                    height = 0.021 * (len(own) + 1)  # a label may take two lines
                    axes = figure.add_axes(
                        (0.06, max(0.93 - 0.0118 * len(lines) - height, 0.02), 0.88, height)
                    )
                    axes.set_axis_off()
                    table = axes.table(
                        cellText=own,
                        cellLoc="left",
                        colLabels=_HEADINGS,
                        colWidths=_WIDTHS,
                        bbox=Bbox.unit(),
                    )
                    table.auto_set_font_size(False)
                    table.set_fontsize(6.5)
                document.savefig(figure)
        replace_bytes(path, whole.getvalue())


def _format_row(entry: Document) -> list[str]:
    factor, unit = (1e6, "um") if entry["unit"] == "\\metre" else (57.29577951308232, "deg")
    ends = {side: f"{float(size) * factor:.7g}" for side, size in entry["limits"]}
    limits = f"{ends.get('lower', '')} to {ends.get('upper', '')}".strip()
    value, half = (float(entry[name]) * factor for name in ("value", "expanded"))
    # the uncertainty has two digits, and the value as many decimals (JCGM 100, 7.2.6)
    decimals = max(1 - int(f"{half:e}".partition("e")[2]), 0)
    return [
        str(entry["number"]),
        "\n".join(wrap(str(entry["label"]), 44)),
        f"{value:.{decimals}f}",
        f"{half:.{decimals}f}",
        entry["factor"],
        limits,
        unit,
        entry["verdict"],
    ]
