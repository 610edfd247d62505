"""Sizes of a drawing in inches, written as ASME Y14.5 does.

A size in inches must not admit a part that its millimetres refuse: limits are rounded inwards
(IEEE/ASTM SI 10), to as many decimals as leave nine tenths of the tolerance.
"""

import math
from dataclasses import dataclass

INCH = 25.4e-3  # m
_LEAST_DECIMALS = 3
_MOST_DECIMALS = 8
_LEAST_LEFT = 0.9  # of a tolerance between its rounded limits [1]
_ALIKE = 1e-12  # difference of two deviations that is none [m]
_SAME = 1e-6  # of the last decimal: rounding of the computer
_DIGITS = 3  # of a bound that stands alone


@dataclass(frozen=True)
class InchSize:
    """A size with its signed deviations in inches, exact to its decimals."""

    nominal: float
    lower: float
    upper: float
    decimals: int

    def format_with_deviations(self) -> str:
        """Write nominal and deviations: ``.0020 ±.0001`` or ``.0000 +.0001/-.0000``."""
        value = format_inches(self.nominal, self.decimals)
        high = format_inches(self.upper, self.decimals)
        low = format_inches(-self.lower, self.decimals)
        if high == low:
            return f"{value} ±{high}"
        return f"{value} +{high}/-{low}"


def convert_to_inches_inward(
    nominal: float, lower_deviation: float, upper_deviation: float
) -> InchSize:
    """Convert a nominal size with its signed deviations [m] so that no limit widens.

    Deviations that are alike stay alike.
    """
    least = (nominal + lower_deviation) / INCH
    largest = (nominal + upper_deviation) / INCH
    is_symmetric = abs(upper_deviation + lower_deviation) < _ALIKE
    for decimals in range(_LEAST_DECIMALS, _MOST_DECIMALS + 1):
        step = 10.0**-decimals
        low = math.ceil(least / step - _SAME)
        high = math.floor(largest / step + _SAME)
        value = min(max(round(nominal / INCH / step), low), high)
        if is_symmetric:
            deviation = min(high - value, value - low)
            low = value - deviation
            high = value + deviation
        if (high - low) * step >= _LEAST_LEFT * (largest - least) - _SAME * step:
            break
    return InchSize(value * step, (low - value) * step, (high - value) * step, decimals)


def format_inches(inches: float, decimals: int) -> str:
    """Write a length [inch] without a zero before the decimal point."""
    text = f"{abs(inches):.{decimals}f}".removeprefix("0")
    if inches < 0.0 and float(text) != 0.0:
        return f"-{text}"
    return text


def format_largest_in_inches(length: float) -> str:
    """Write the largest length [m] that is permitted, rounded down to three digits."""
    decimals = _count_decimals_of_three_digits(length / INCH)
    step = 10.0**-decimals
    return format_inches(math.floor(length / INCH / step + _SAME) * step, decimals)


def format_least_in_inches(length: float) -> str:
    """Write the least length [m] that is permitted, rounded up to three digits."""
    decimals = _count_decimals_of_three_digits(length / INCH)
    step = 10.0**-decimals
    return format_inches(math.ceil(length / INCH / step - _SAME) * step, decimals)


def format_largest_roughness_in_microinches(largest_roughness: float) -> str:
    """Write the largest roughness [m] in microinches, rounded down to three digits."""
    microinches = largest_roughness / INCH * 1e6
    decimals = _count_decimals_of_three_digits(microinches)
    step = 10.0**-decimals
    return f"{math.floor(microinches / step + _SAME) * step:.{decimals}f}"


def _count_decimals_of_three_digits(value: float) -> int:
    """Return the decimals that write a positive value with three digits."""
    if value <= 0.0:
        return _LEAST_DECIMALS
    return max(_DIGITS - 1 - math.floor(math.log10(value)), 0)
