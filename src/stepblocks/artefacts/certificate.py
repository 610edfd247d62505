"""A draft of a digital calibration certificate (DCC 3.3.0, quantities as D-SI 2.2.1) for a laboratory to complete and sign.

What the program cannot know (laboratory, equipment, signer, dates) says so in its place. A page of the same content lies beside.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stepblocks.atomic import replace_text
from stepblocks.page_file import render_page
from stepblocks.parts.conditions import OrderSpec
from stepblocks.parts.kind import Part

_BLANK = "to be completed by the laboratory"
_PINNED = "2000-01-01"  # where the order has no date
RULE = (
    "ISO 14253-1 with a guard band of 1.65 u, or Student's 95 % point where u has few degrees of freedom: inside the limits by it "
    "the characteristic conforms, outside by it it does not, between neither is proven (conditional pass or fail, ILAC-G8)."
)


@dataclass(frozen=True)
class _Line:
    """One characteristic, every length as text in metres."""

    number: int
    label: str
    value: str
    expanded: str
    factor: str  # of coverage
    nominal: str
    limits: tuple[tuple[str, str], ...]
    guard: str
    budget: tuple[tuple[str, str], ...]
    verdict: str
    conformity: str

    @staticmethod
    def um(length: str) -> str:
        """Show a length in micrometres."""
        return f"{float(length) * 1e6:.4f}"


def write_certificate(base: Path, part: Part, record: Mapping[str, Any], order: OrderSpec, digest: str) -> list[Path]:
    """Write ``<base>.dcc.xml`` and ``<base>.certificate.html`` of an inspection; the author of the order is the customer."""
    from stepblocks import __version__

    numbers = {one.key: number for number, one in enumerate(part.characteristics(), start=1)}
    results = [_line(numbers[one["key"]], one) for one in record["characteristics"] if one["key"] in numbers]
    paths = [base.with_name(f"{base.name}.{ending}") for ending in ("dcc.xml", "certificate.html")]
    values = {
        **{"identity": part.id.upper(), "title": part.titled, "material": part.material.designation, "rule": RULE},
        **{"verdict": record["verdict"], "convention": record["convention"], "notes": record["notes"]},
        **{"blank": _BLANK, "author": order.author, "date": order.date or _PINNED, "digest": digest[:16]},
        **{"results": results, "conformity": _whole(results), "release": __version__, "file": paths[0].name},
    }
    for path, template in zip(paths, ("dcc.xml.j2", "certificate.html.j2"), strict=True):
        replace_text(path, render_page("artefacts", template, **values))
    return paths


def _line(number: int, one: Mapping[str, Any]) -> _Line:
    low, high = one["interval_95_m"]
    expanded, std = 0.5 * (high - low), one["std_m"]
    sides = (("lower", one["lower_limit_m"]), ("upper", one["upper_limit_m"]))
    inside = all(
        limit is None or (one["value_m"] - limit) * sign >= 0.0 for (_, limit), sign in zip(sides, (1, -1), strict=True)
    )
    status = {"conforms": "pass", "does not conform": "fail"}.get(one["verdict"])
    budget = [(part["name"], part["std_m"]) for part in one["budget"]]
    return _Line(
        number=number,
        label=one["label"],
        value=_metres(one["value_m"]),
        expanded=_metres(expanded),
        factor=f"{expanded / std if std > 0.0 else 1.96:.3f}",
        nominal=_metres(one["nominal_m"]),
        limits=tuple((side, _metres(limit)) for side, limit in sides if limit is not None),
        guard=_metres(one["guard_band_m"]),
        budget=tuple(
            (name if std is not None else f"{name} (not stated)", _metres(std or 0.0)) for name, std in budget
        ),
        verdict=one["verdict"],
        conformity=status or ("conditionalPass" if inside else "conditionalFail"),
    )


def _metres(value: float) -> str:
    """Write a length to a tenth of a picometre, in the notation that D-SI takes for decimals."""
    return f"{value:.13f}".rstrip("0").rstrip(".")


def _whole(results: Sequence[_Line]) -> str:
    """Return the worst of the outcomes."""
    order = ("fail", "conditionalFail", "conditionalPass", "pass")
    return min((one.conformity for one in results), key=order.index, default="conditionalPass")
