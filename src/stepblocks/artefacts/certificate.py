"""A draft of a digital calibration certificate (DCC 3.3.0, D-SI 2.2.1): what only the laboratory knows says so in its place."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stepblocks.atomic import replace_text
from stepblocks.page_file import render_page
from stepblocks.parts.conditions import OrderSpec
from stepblocks.parts.kind import Part
from stepblocks.parts.tolerance import GUARD_FACTOR

_BLANK = "to be completed by the laboratory"
_PINNED = "2000-01-01"  # where the order has no date
RULE = (
    f"ISO 14253-1 with a guard band of {GUARD_FACTOR} u, or Student's 95 % point "
    "where u "
    "has "
    "few "
    "degrees of freedom: inside "
    "the limits by it the characteristic conforms, outside by it it does not, between "
    "neither "
    "is "
    "proven (conditional pass "
    "or fail, ILAC-G8)."
)


def write_certificate(
    path: Path, part: Part, record: Mapping[str, Any], order: OrderSpec, digest: str
) -> None:
    """Write the certificate of an inspection; the author of the order is the customer."""
    from stepblocks import __version__

    numbers = {one.key: number for number, one in enumerate(part.characteristics(), start=1)}
    results = [
        _line(numbers[one["key"]], one)
        for one in record["characteristics"]
        if one["key"] in numbers
    ]
    worst_first = ("fail", "conditionalFail", "conditionalPass", "pass")
    values = {
        **{
            "identity": part.id.upper(),
            "title": part.drawing_title,
            "material": part.material.designation,
            "rule": RULE,
        },
        **{
            "verdict": record["verdict"],
            "convention": record["convention"],
            "release": __version__,
        },
        **{
            "blank": _BLANK,
            "author": order.author,
            "date": order.date or _PINNED,
            "digest": digest[:16],
        },
        "conformity": min(
            (one["conformity"] for one in results), key=worst_first.index, default="conditionalPass"
        ),
    }
    replace_text(path, render_page("artefacts", "dcc.xml.j2", results=results, **values))


def _line(number: int, one: Mapping[str, Any]) -> dict[str, Any]:
    """One characteristic, every length as text in metres."""
    low, high = one["interval_95_m"]
    expanded, std, value = 0.5 * (high - low), one["std_m"], one["value_m"]
    lower, upper = one["lower_limit_m"], one["upper_limit_m"]
    inside = (lower is None or value >= lower) and (upper is None or value <= upper)
    status = {"conforms": "pass", "does not conform": "fail"}.get(one["verdict"])
    parts = [(part["name"], part["std_m"]) for part in one["budget"]]
    lengths = {
        "value": value,
        "expanded": expanded,
        "nominal": one["nominal_m"],
        "guard": one["guard_band_m"],
    }
    return {
        **{"number": number, "label": one["label"], "verdict": one["verdict"]},
        **{name: _metres(length) for name, length in lengths.items()},
        "factor": f"{expanded / std if std > 0.0 else 1.96:.3f}",  # of coverage
        "limits": [
            (side, _metres(end))
            for side, end in (("lower", lower), ("upper", upper))
            if end is not None
        ],
        "budget": [
            (name if std is not None else f"{name} (not stated)", _metres(std or 0.0))
            for name, std in parts
        ],
        "conformity": status or ("conditionalPass" if inside else "conditionalFail"),
    }


def _metres(length: float) -> str:
    """Write a length to a tenth of a picometre, in the notation that D-SI takes for decimals."""
    return f"{length:.13f}".rstrip("0").rstrip(".")
