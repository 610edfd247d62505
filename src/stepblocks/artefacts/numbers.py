"""How a length stands on a drawing: millimetres, as many decimals as value and tolerance need, all of them printed."""

from __future__ import annotations

_MOST_DECIMALS = 6


def decimals_for(*lengths: float) -> int:
    """Return the decimals that print all lengths [m] exactly in millimetres, at least one, at most six.

    Examples
    --------
    >>> decimals_for(10e-6, 1e-6), decimals_for(20e-3, 0.2e-3)
    (3, 1)
    """
    for decimals in range(1, _MOST_DECIMALS):
        if all(abs(round(length * 1e3, decimals) - length * 1e3) < 1e-9 for length in lengths):
            return decimals
    return _MOST_DECIMALS


def millimetres(length: float, decimals: int) -> str:
    """Return a length [m] in millimetres with trailing zeros.

    Examples
    --------
    >>> millimetres(10e-6, 3)
    '0.010'
    """
    text = f"{length * 1e3:.{decimals}f}"
    return text.lstrip("-") if float(text) == 0.0 else text


def limits_text(nominal: float, lower: float, upper: float) -> str:
    """Return nominal and deviations as on a drawing.

    Examples
    --------
    >>> limits_text(10e-6, -1e-6, 1e-6), limits_text(0.0, 0.0, 2e-6)
    ('0.010 ±0.001', '0.000 +0.002/0')
    """
    decimals = decimals_for(nominal, lower, upper)
    value = millimetres(nominal, decimals)
    if abs(upper + lower) < 1e-12:
        return f"{value} ±{millimetres(upper, decimals)}"
    high, low = ("0" if abs(one) < 1e-12 else f"{one * 1e3:+.{decimals}f}" for one in (upper, lower))
    return f"{value} {high}/{low}"
