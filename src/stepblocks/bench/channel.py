"""One column of numbers in a file of a laboratory, and how it becomes SI."""

import math
import re
from collections.abc import Mapping
from typing import Annotated, NamedTuple

from pydantic import BeforeValidator, model_validator

from stepblocks.bench.calibration import Strict
from stepblocks.errors import BenchError, QuantityError
from stepblocks.mistakes import Mistake, collect_mistakes
from stepblocks.quantities import parse_quantity

# unit that a column has by the end of its name; the gram of a weight is a gram-force
_SUFFIX_UNITS = {
    "force": {
        "n": "N",
        "mn": "mN",
        "un": "uN",
        "kn": "kN",
        "gf": "gf",
        "g": "gf",
        "kg": "kgf",
        "v": "V",
        "mv": "mV",
    },
    "length": {"um": "um", "mm": "mm", "nm": "nm", "m": "m"},
    "time": {"s": "s", "ms": "ms", "us": "us"},
    "speed": {
        "mm_s": "mm/s",
        "m_s": "m/s",
        "um_s": "um/s",
        "mm_per_s": "mm/s",
        "m_per_s": "m/s",
        "um_per_s": "um/s",
    },
}
_WEIGHTS = {"g": "gf", "kg": "kgf", "mg": "mgf"}
_VOLTS = {"V": 1.0, "mV": 1e-3, "uV": 1e-6}
_PER_VOLT = re.compile(r"\s*(?P<quantity>\S.*?)\s*/\s*(?P<unit>V|mV|uV)\s*")
_VOLTAGE = re.compile(r"\s*(?P<number>[-+.\deE]+)\s*(?P<unit>V|mV|uV)\s*")
_BRACKETED = re.compile(r"[(\[](?P<unit>[^()\[\]]+)[)\]]\s*$")  # a unit as in ``Fx (mV)``
_TARE = re.compile(r"\s*first\s+(?P<duration>\S.*?)\s*")


def find_unit_in_name(name: str, dimension: str) -> str | None:
    """Return the unit at the end of a column name, or None."""
    units = _SUFFIX_UNITS[dimension]
    bracketed = _BRACKETED.search(name.lower())
    if bracketed:
        return units.get(bracketed["unit"].strip().replace("/", "_"))
    lowered = name.lower().rsplit("/", 1)[-1]
    fitting = [suffix for suffix in units if f"_{lowered}".endswith(f"_{suffix}")]
    if not fitting:
        return None
    return units[max(fitting, key=len)]


def _parse_setting_quantity(text: str, dimension: str, setting_path: str) -> float:
    """Parse a quantity into SI; an error names its `setting_path` in session.toml."""
    try:
        return parse_quantity(text, dimension)
    except QuantityError as error:
        raise BenchError(f"`{setting_path}` {error}") from error


def _refuse_non_finite_number(value: object) -> object:
    """Return a value; refuse a number that is not finite."""
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError("input should be a finite number")
    return value


_Gain = Annotated[float | str, BeforeValidator(_refuse_non_finite_number)]


class Channel(Strict):
    """One column of a trace or of the table of trials.

    Attributes
    ----------
    column : str | int
        Name, or index from 0 where the columns have no names.
    unit : str | None
        Of its numbers; by default what the end of the name says (``fx_mn``), else SI.
    factor : _Gain
        Gain or sign that the numbers are multiplied with; ``"2.35 N/V"`` of a gauge in volts.
    offset : _Gain
        Reading at zero, which is subtracted: in the unit of the numbers, or a quantity such as
        ``"5 mN"``.
    tare : str | None
        ``"first 0.1 s"``: the mean of the record over this time is its zero.
    """

    column: str | int
    unit: str | None = None
    factor: _Gain = 1.0
    offset: _Gain = 0.0
    tare: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _expand_short_form(cls, declared: object) -> object:
        """Accept the column alone in place of a table."""
        is_column = isinstance(declared, str | int) and not isinstance(declared, bool)
        if is_column:
            return {"column": declared}
        return declared

    def _find_unit_in_column_name(self, dimension: str) -> str | None:
        return self.unit or find_unit_in_name(str(self.column), dimension)

    def find_factor_to_si(self, dimension: str, setting_path: str) -> float:
        """Return the factor from the numbers in the file to SI.

        Parameters
        ----------
        dimension : str
            Such as ``force``.
        setting_path : str
            Of the channel in session.toml, for messages.

        Raises
        ------
        BenchError
            If factor and unit do not go together.
        """
        unit = self._find_unit_in_column_name(dimension)
        if isinstance(self.factor, str):
            return self._find_factor_from_volts(self.factor, unit or "V", dimension, setting_path)
        if unit in _VOLTS:
            raise BenchError(
                f"`{setting_path}.factor` must say what a volt is, such as '2.35 N/V', for a "
                f"column in {unit}"
            )
        if unit is None:
            return self.factor
        if dimension == "force":
            unit = _WEIGHTS.get(unit, unit)
        try:
            return self.factor * parse_quantity(f"1 {unit}", dimension)
        except QuantityError as error:
            raise BenchError(
                f"`{setting_path}` must have a unit of {dimension}, got {unit!r}"
            ) from error

    def _find_factor_from_volts(
        self, factor: str, unit: str, dimension: str, setting_path: str
    ) -> float:
        """Return the factor to SI for a file in volts, from a declared quantity per volt."""
        per_volt = _PER_VOLT.fullmatch(factor)
        if per_volt is None or unit not in _VOLTS:
            raise BenchError(
                f"`{setting_path}.factor` must be a number, or a {dimension} per volt such as "
                f"'2.35 N/V' of a column in V or mV, got {factor!r}"
            )
        quantity = _parse_setting_quantity(
            per_volt["quantity"], dimension, f"{setting_path}.factor"
        )
        return quantity / _VOLTS[per_volt["unit"]] * _VOLTS[unit]

    def find_offset_in_si(self, dimension: str, setting_path: str) -> float:
        """Return the reading at zero in SI, as `find_factor_to_si` does."""
        if not isinstance(self.offset, str):
            return self.offset * self.find_factor_to_si(dimension, setting_path)
        voltage = _VOLTAGE.fullmatch(self.offset)
        if voltage is None or not isinstance(self.factor, str):
            return _parse_setting_quantity(self.offset, dimension, f"{setting_path}.offset")
        unit = self._find_unit_in_column_name(dimension) or "V"
        number = float(voltage["number"])
        return (
            number
            * _VOLTS[voltage["unit"]]
            / _VOLTS[unit]
            * self.find_factor_to_si(dimension, setting_path)
        )

    def parse_tare_duration(self, setting_path: str) -> float:
        """Return for how long the record shows zero at its start [s]; 0 without a tare."""
        if self.tare is None:
            return 0.0
        tare = _TARE.fullmatch(self.tare)
        if tare is None:
            raise BenchError(
                f"`{setting_path}.tare` must say how long, such as 'first 0.1 s', got {self.tare!r}"
            )
        return _parse_setting_quantity(tare["duration"], "time", f"{setting_path}.tare")


class DimensionedChannel(NamedTuple):
    """A channel with the dimension of its quantity, such as ``force``."""

    channel: Channel
    dimension: str


def check_channel_settings(channels: Mapping[str, DimensionedChannel], *, have_time: bool) -> None:
    """Refuse units, factors, offsets and tares that cannot be read, all at once.

    Parameters
    ----------
    channels : mapping of str to DimensionedChannel
        Channels by their places in session.toml.
    have_time : bool
        Whether they are records in time, of which a tare can be taken.

    Raises
    ------
    ValueError
        With one line for each mistake; pydantic reports it with its place.
    """
    mistakes: list[Mistake] = []
    for place, (channel, dimension) in channels.items():
        with collect_mistakes(mistakes):
            channel.find_factor_to_si(dimension, place)
            channel.find_offset_in_si(dimension, place)
            if channel.parse_tare_duration(place) and not have_time:
                raise BenchError(f"`{place}` has no time to take a tare from")
    if mistakes:
        texts = [text for _, text in mistakes]
        raise ValueError("\n".join(texts))
