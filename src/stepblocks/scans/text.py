"""Profiles and maps from plain text: CSV, TSV and XYZ.

The columns or the user say the units (``x_um``, ``Raw (Å)``); a file without units is refused.
"""

import io
import re
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from stepblocks.errors import MetrologyError
from stepblocks.files.tables import Table
from stepblocks.scans.points import grid_points
from stepblocks.scans.scan import Array, HeightMap, ScannedProfile

# units per metre
LENGTH_UNITS = {
    "pm": 1e12,
    "å": 1e10,
    "nm": 1e9,
    "um": 1e6,
    "µm": 1e6,
    "μm": 1e6,
    "mm": 1e3,
    "cm": 1e2,
    "m": 1.0,
    "nanometer": 1e9,
    "micrometer": 1e6,
    "micron": 1e6,
    "microns": 1e6,
    "millimeter": 1e3,
    "meter": 1.0,
    "angstrom": 1e10,
    "Å": 1e10,
    "\u212b": 1e10,
}

_MOST_BYTES = 256 * 2**20
_MOST_HEADER_LINES = 400
_MOST_COLUMNS = 64
# how instruments write a point that was not measured
_MISSING = {
    "",
    "nan",
    "bad",
    "-",
    "***",
    "---",
}
_UNIT = "(" + "|".join(sorted(LENGTH_UNITS, key=len, reverse=True)) + ")"
_UNIT_IN_NAME = re.compile(rf"(?:^|[\s_\[\(/,]){_UNIT}[\]\)]?$")
_GIVEN = re.compile(rf"(?:([xyz])\s*=)?\s*(\d+\.?\d*|\.\d+)?\s*{_UNIT}")
_INDEX = {"index", "#", "no", "no.", "nr", "n", "point", "points", "sample"}
_STEP = re.compile(r"(?i)x[- _]?(resolution|spacing|step)")
_ROLES = {  # how instruments call the columns of an axis
    "x": ("x", "lateral", "pos", "length", "distance", "scan", "travel"),
    "y": ("y",),
    "z": ("z", "height", "raw", "profile", "total", "depth", "level", "deviation"),
}
_MATRIX = re.compile(
    r"pixel size|value units|x-pixels|^#?\s*(width|breite|kanal|channel|h=\d+)",
    re.IGNORECASE | re.MULTILINE,
)
_MOST_BACK = 0.1  # part of the points of a profile that may lie behind one before them [1]
# extent of a column as a part of the others [1], below which it says where a profile was taken
_CONSTANT = 1e-3


def parse_given_units(unit: str | None) -> dict[str, tuple[float, float]]:
    """Read ``um`` or ``x=mm,z=0.5 um``.

    The result gives, for each axis, the length of a stored 1 as a number and its units per metre.
    """
    found: dict[str, tuple[float, float]] = {}
    for one in unit.split(",") if unit else ():
        match = _GIVEN.fullmatch(one.strip().lower())
        if match is None or float(match[2] or 1.0) == 0.0:
            raise MetrologyError(
                f"unit must be one of nm, um, mm, m, or by axis as x=mm,z=um, got {unit!r}"
            )
        size = float(match[2] or 1.0), LENGTH_UNITS[match[3]]
        found |= {match[1]: size} if match[1] else dict.fromkeys("xyz", size)
    return found


def holds_matrix(path: Path) -> bool:
    """Tell whether the head of a text states the size of a matrix of heights.

    SPIP, Gwyddion and others write it so.
    """
    with path.open("rb") as file:
        return _MATRIX.search(_decode(file.read(4000))) is not None


def read_text_scan(
    path: Path, unit: str | None = None, channel: str | None = None
) -> ScannedProfile | HeightMap:
    """Read a profile or a map of heights from text.

    A profile has two columns, a grid of points three or columns by their names; a matrix holds
    heights.
    """
    MetrologyError.require(
        (length := path.stat().st_size) <= _MOST_BYTES,
        f"text must not exceed {_MOST_BYTES >> 20} MiB, got {length} bytes [{path.name}]",
    )
    text = _decode(path.read_bytes())
    MetrologyError.require(
        "\0" not in text[:4096],
        f"file must be text, got binary data [{path.name}]",
    )
    head, values = _parse_table(text, path)
    names, common = _parse_names(head, values)
    given = parse_given_units(unit)
    if values.shape[1] > 3 and not names and channel is None:
        return _read_matrix(values, given, path)
    columns = _choose_columns(names, values, path, channel)
    named = {axis: names[column] if names else None for axis, column in columns.items()}
    factors = {axis: _find_factor(name, axis, common, given, path) for axis, name in named.items()}
    units = ", ".join(filter(None, named.values())) or f"unit {unit or 'of the head'} as given"
    axes = {
        axis: values[:, column] * factors[axis][0] / factors[axis][1]
        for axis, column in columns.items()
    }
    if "y" in axes:
        return replace(
            grid_points(axes["x"], axes["y"], axes["z"], path.name, f"columns {units}"),
            count=_find_last_digit(values[:, columns["z"]], factors["z"]),
        )
    x, z, notes = _keep_forward(axes["x"], axes["z"], path)
    x, snapped = _snap_to_equal_steps(
        x, _find_last_digit(values[:, columns["x"]], factors["x"], least=1)
    )
    notes += ["positions set to equal steps within their last digit"] if snapped else []
    return ScannedProfile(
        x,
        z,
        source=path.name,
        scale="; ".join([f"columns {units}", *notes]),
        count=_find_last_digit(values[:, columns["z"]], factors["z"]),
    )


def read_table_scan(
    table: Table, unit: str | None = None, channel: str | None = None
) -> ScannedProfile | HeightMap:
    """Read a table in memory as the CSV of the same columns."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "table.csv"
        table.to_csv(path, index=False, na_rep="nan")
        return read_text_scan(path, unit, channel)


def _find_last_digit(values: Array, unit: tuple[float, float], least: int = 0) -> float:
    # Length of the last digit that numbers are printed with, from the shortest decimal that gives
    # each back [m].
    decimals = least
    for one in map(repr, values[:: max(len(values) // 2000, 1)].tolist()):
        mantissa, _, power = one.partition("e")
        decimals = max(decimals, len(mantissa.partition(".")[2].rstrip("0")) - int(power or 0))
    return float(10.0**-decimals) * unit[0] / unit[1]


def _decode(raw: bytes) -> str:
    wide = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}.get(raw[:2])
    try:
        return raw[: len(raw) - len(raw) % 2].decode(wide) if wide else raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return raw.decode("latin-1")  # profilometers write the micro sign so


def _parse_table(text: str, path: Path) -> tuple[list[list[str]], Array]:
    # Fields of the lines above the first table of numbers, and the table; text after it is a
    # footer.
    lines = text.splitlines()
    begin, mark, comma, width = _find_beginning(lines, path)
    head = [
        [field.lstrip("# ").strip('"') for field in _split_fields(line, mark)]
        for line in lines[:begin]
    ]
    MetrologyError.require(
        width <= _MOST_COLUMNS or all(len(fields) != width for fields in head),
        f"table must have at most {_MOST_COLUMNS} columns [{path.name}, {begin + 1}]",
    )
    body = "\n".join(lines[begin:])
    try:
        fast = np.loadtxt(
            io.StringIO(body.replace(",", ".") if comma else body),
            delimiter=mark,
            comments=None,
            ndmin=2,
        )
        if fast.shape[1] == width:
            return head, np.asarray(fast, dtype=np.float64)
    except ValueError:
        pass  # missing points, a footer or a fault: line by line
    rows: list[list[float]] = []
    failed = 0
    for number, line in enumerate(lines[begin:], start=begin + 1):
        fields = _split_fields(line, mark)
        values = (
            _parse_numbers(fields + [""] * (width - len(fields)), comma)
            if len(fields) <= width
            else None
        )
        missing = bool(fields) and values is not None and len(line.split(mark)) < width
        if fields and (failed or missing or values is None):
            failed = failed or number
            # a footer holds words: a line that begins with numbers belongs to the table
            if _parse_numbers(fields[:1], comma) or missing:
                shown = ",".join(_split_fields(lines[failed - 1], mark))[:60]
                raise MetrologyError(
                    f"line must hold {width} numbers, got {shown!r} [{path.name}, line {failed}]"
                )
        elif fields and values:
            rows.append(values)
    return head, np.array(rows, dtype=np.float64)


def _split_fields(line: str, mark: str | None) -> list[str]:
    # Return fields without the empty ones that some instruments append.
    fields = [field.strip() for field in line.split(mark)]
    while fields and not fields[-1]:
        fields.pop()
    return fields


def _find_beginning(lines: list[str], path: Path) -> tuple[int, str | None, bool, int]:
    # Where the table begins, what divides its fields, whether commas are decimal, and how many
    # columns it has.
    sample = [line for line in lines[: _MOST_HEADER_LINES + 50] if line.strip()][-50:]

    def count_columns(line: str, mark: str | None, comma: bool) -> int:
        fields = _split_fields(line, mark)
        return len(fields) if len(fields) > 1 and _parse_numbers(fields, comma) else 0

    best, mark, comma = max(
        (
            (sum(count_columns(line, mark, comma) > 0 for line in sample), mark, comma)
            for mark in (";", "\t", ",", None)
            for comma in ((False,) if mark == "," else (False, True))
        ),
        key=lambda one: one[0],
    )
    for number, line in enumerate(lines[: _MOST_HEADER_LINES + 1]):
        if best and (count := count_columns(line, mark, comma)):
            return number, mark, comma, count
    MetrologyError.require(
        len(lines) <= _MOST_HEADER_LINES,
        f"table must begin within {_MOST_HEADER_LINES} lines [{path.name}]",
    )
    raise MetrologyError(
        f"text must hold a table of numbers in two columns or more, got none [{path.name}]"
    )


def _parse_numbers(fields: list[str], comma: bool) -> list[float] | None:
    try:
        texts = [field.replace(",", ".") if comma else field for field in fields]
        values = [np.nan if text.lower() in _MISSING else float(text) for text in texts]
    except ValueError:
        return None
    return None if all(np.isnan(value) for value in values) else values


def _parse_names(
    head: list[list[str]], values: Array
) -> tuple[list[str], tuple[float, float] | None]:
    # Names of the columns, with a line of units under them, and a unit that stands alone; numbered
    # points get the step of the head.
    width = values.shape[1]
    kept = [[field for field in fields if field] for fields in head if any(fields)]
    single = [fields[0].lower() for fields in kept if len(fields) == 1]
    unit_words = [LENGTH_UNITS[word] for word in single if word in LENGTH_UNITS]
    common = (1.0, unit_words[-1]) if unit_words else None
    words = kept and not any(_parse_numbers([one], comma=False) for one in kept[-1])
    if words and len(kept[-1]) == width - 1 > 1 and (np.diff(values[:, 0]) == 1.0).all():
        step = next(
            (
                one
                for one in kept
                if len(one) == 2 and _STEP.match(one[0]) and _parse_numbers(one[1:], comma=False)
            ),
            None,
        )
        values[:, 0] *= float(step[1]) if step else 1.0
        return ["x" + _STEP.sub("", step[0]) if step else "#", *kept[-1]], common
    if not kept or len(kept[-1]) != width:
        return [], common
    units = all(re.fullmatch(rf"[\[(]?{_UNIT}[\])]?", one.lower()) for one in kept[-1])
    if units and len(kept) > 1 and len(kept[-2]) == width:
        return [f"{name} {unit}" for name, unit in zip(kept[-2], kept[-1], strict=True)], common
    return kept[-1], common


def _choose_columns(
    names: list[str], values: Array, path: Path, channel: str | None
) -> dict[str, int]:
    # Return which column holds which axis: by name, else in the order x, z or x, y, z; what counts
    # the points is none.
    left = [
        index for index in range(values.shape[1]) if not names or names[index].lower() not in _INDEX
    ]
    if len(left) > 3 or channel is not None:
        lower = {i: names[i].lower() for i in left if names}
        named = {
            axis: [i for i in lower if lower[i].startswith(starts)]
            for axis, starts in _ROLES.items()
        }
        if channel is not None:
            alike = [i for i in lower if channel.lower() in lower[i]]
            named["z"] = [i for i in alike if lower[i] == channel.lower()] or alike
        MetrologyError.require(
            len(named["z"]) == 1,
            "channel must be a part of the name of one column, that of the heights, got "
            f"{channel or 'none'} for {', '.join(names) or 'no names'} [{path.name}]",
        )
        MetrologyError.require(
            len(named["x"]) == 1 and len(named["y"]) <= 1,
            "table of more than 3 columns must name one x, and one y if it is a map, got "
            f"{', '.join(names)} [{path.name}]",
        )
        return {axis: found[0] for axis, found in named.items() if found}
    if len(left) == 2:
        return {"x": left[0], "z": left[1]}
    if len(left) == 3:
        # not a number where all is missing
        extent = np.fmax.reduce(values[:, left]) - np.fmin.reduce(values[:, left])
        flat = extent < _CONSTANT * np.sort(extent)[1]
        single = [len(np.unique(values[:, one])) > 0.5 * len(values) for one in left[:2]]
        if (flat[2] and all(single)) or (flat[1] and single[0]) or (flat[0] and single[1]):
            x, z = (one for one, still in zip(left, flat, strict=True) if not still)
            return {"x": x, "z": z}
        return dict(zip("xyz", left, strict=True))
    raise MetrologyError(
        f"table must have 2 columns (x, z) or 3 (x, y, z), got {len(left)} [{path.name}]"
    )


def _find_factor(
    name: str | None,
    axis: str,
    common: tuple[float, float] | None,
    stated: dict[str, tuple[float, float]],
    path: Path,
) -> tuple[float, float]:
    # Length of a stored 1 in a column: as its name says, as the head or the user does.
    found = _UNIT_IN_NAME.search(name.lower()) if name else None
    asked = stated.get(axis)
    if found is not None:
        own = (1.0, LENGTH_UNITS[found.group(1)])
        MetrologyError.require(
            asked in (None, own),
            f"unit given for {axis} is not that of column {name!r}, which says another "
            f"[{path.name}]",
        )
        return own
    if asked is None and common is None:
        rule = f"column {name!r} must name its unit" if name else "columns must name their unit"
        raise MetrologyError(f"{rule} (x_um, z [nm], ...) or a unit must be given [{path.name}]")
    return asked or common  # type: ignore[return-value]


def _keep_forward(x: Array, z: Array, path: Path) -> tuple[Array, Array, list[str]]:
    # Turn a profile that runs backwards, and leave out the few points at which it goes back.
    if x[-1] < x[0]:
        x, z = x[::-1], z[::-1]
    ahead = np.concatenate([[True], x[1:] > np.maximum.accumulate(x)[:-1]])
    lost = int((~ahead).sum())
    if not np.isfinite(x).all() or lost == 0:
        return x, z, []
    MetrologyError.require(
        lost <= _MOST_BACK * len(x),
        f"positions must increase along the profile at all but {_MOST_BACK:.0%} of its "
        f"points, got {lost / len(x):.0%} that lie behind one before them [{path.name}]",
    )
    return x[ahead], z[ahead], [f"{lost} points left out where the profile goes back"]


def _read_matrix(values: Array, stated: dict[str, tuple[float, float]], path: Path) -> HeightMap:
    # Heights without a head: their unit and the step along x (and y) must be given, as
    # ``x=0.5um,z=nm``.
    MetrologyError.require(
        {"x", "z"} <= set(stated),
        "table must have 2 columns (x, z) or 3 (x, y, z); a matrix of heights needs a "
        f"step and a unit, as x=0.5um,z=nm, got {values.shape[1]} columns [{path.name}]",
    )
    dx, dy, one = (
        size / per for size, per in (stated["x"], stated.get("y", stated["x"]), stated["z"])
    )
    return HeightMap(
        values * one,
        dx,
        dy,
        source=path.name,
        scale="matrix with the step and unit given",
        count=_find_last_digit(values.ravel(), stated["z"]),
    )


def _snap_to_equal_steps(x: Array, digit: float) -> tuple[Array, bool]:
    if len(x) < 3 or not np.isfinite(x).all():
        return x, False
    even = np.polynomial.Polynomial.fit(np.arange(len(x)), x, 1)(np.arange(len(x)))
    off = float(np.abs(even - x).max())
    if off == 0.0 or off > 0.75 * digit:
        return x, False
    return even, off > 1e-9 * abs(float(x[-1] - x[0]))
