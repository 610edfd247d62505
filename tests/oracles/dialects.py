"""Tables as programs of laboratories write them: every dialect that a number draws."""

import csv
import io
import math
import random
from dataclasses import dataclass


@dataclass(frozen=True)
class Dialect:
    """How a table is written."""

    encoding: str
    separator: str
    decimal: str
    quoting: int
    trailing: bool
    line_end: str
    thousands: str
    missing: str
    comment: bool
    units_row: bool
    order: int

    def format(self, value: float | str) -> str:
        """Write a cell."""
        if isinstance(value, str):
            return value
        if math.isnan(value):
            return self.missing
        text = f"{value:,.4f}".replace(",", "T").replace(".", self.decimal)
        return text.replace("T", self.thousands)

    def write(self, columns: dict[str, list[float | str]]) -> bytes:
        """Write a table, its columns in an order of their own."""
        names = list(columns)
        random.Random(self.order).shuffle(names)
        text = io.StringIO()
        writer = csv.writer(
            text, delimiter=self.separator, quoting=self.quoting, lineterminator="\n"
        )
        if self.comment:
            text.write("# measured by hand\n")
        writer.writerow(names)
        if self.units_row:
            units = {"um": "µm", "n": "N", "s": "s", "uj": "µJ", "deg": "mm"}
            writer.writerow([units.get(name.rsplit("_", 1)[-1], "-") for name in names])
        for row in range(len(columns[names[0]])):
            writer.writerow([self.format(columns[name][row]) for name in names])
        lines = text.getvalue().splitlines()
        first = 1 + self.comment
        if self.trailing:
            lines[first:] = [line + self.separator for line in lines[first:]]
        return (self.line_end.join(lines) + self.line_end).encode(self.encoding)


def draw_dialect(number: int) -> Dialect:
    """Draw the dialect of a number, always the same."""
    draw = random.Random(number)
    decimal = draw.choice(".,")
    return Dialect(
        encoding=draw.choice(["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "cp1252"]),
        separator=draw.choice(",;\t|"),
        decimal=decimal,
        quoting=draw.choice([csv.QUOTE_MINIMAL, csv.QUOTE_ALL]),
        trailing=draw.random() < 0.3,
        line_end=draw.choice(["\n", "\r\n"]),
        thousands=draw.choice(["", "", ",", ".", " ", "\u00a0", "'"]).replace(decimal, ""),
        missing=draw.choice(["", "NA", "nan", "-9999" + decimal + "0000"]),
        comment=draw.random() < 0.3,
        units_row=draw.random() < 0.3,
        order=draw.randrange(100),
    )
