"""How far two rings are apart for a person, in just noticeable differences with an interval.

One just noticeable difference is told by three of four judgements of pairs. In the logarithm of the
energy it is ln(1 + w) with the Weber fraction w (Weber's law; Fechner's integral where w depends on
the energy).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import NormalDist
from typing import Final

import numpy as np
import pandas as pd

from stepblocks.contact import Array
from stepblocks.contact.domain import require_positive
from stepblocks.contact.operating_point import LEVEL_DIFFERENCE, WEBER_FRACTION
from stepblocks.contact.uncertainty import draw_standard_normal_inputs
from stepblocks.errors import PipelineError
from stepblocks.files.layout import UNDECLARED, TableLayout, refuse_declared_layout
from stepblocks.files.tables import load_table, read_si_columns, warn_of_notes
from stepblocks.mistakes import Mistake, collect_mistakes, format_mistakes
from stepblocks.predict.predictions import Model, Prediction

_DOUBT = 2.0  # factor to either side within which the fraction of the literature lies, 95 %

_Z75 = NormalDist().inv_cdf(0.75)  # of a difference that three of four judgements tell
_Z975 = NormalDist().inv_cdf(0.975)
_TAILS = (0.025, 0.975)  # of an interval of 95 %
_FEWEST_DRAWS = 100  # that give an interval of 95 %
DRAWS = 2000  # of an interval; its ends scatter by 2 % of its width
_NODES = 9  # energies between two rings at which the Weber fraction is asked
_LARGEST_FRACTION = 100.0  # beyond which a table means something else
# of each figure: the names of its column, its dimension, and the value where there is no column
_COLUMNS = {
    "fraction": (("weber_fraction",), "ratio", None),
    "low": (("weber_fraction_95_low", "weber_fraction_low"), "ratio", math.nan),
    "high": (("weber_fraction_95_high", "weber_fraction_high"), "ratio", math.nan),
    "energy": (("energy", "vibration_energy"), "energy", math.nan),
}


@dataclass(frozen=True)
class WeberFraction:
    """Least share by which an energy must grow to be told apart, at one energy.

    Attributes
    ----------
    fraction : float
        Weber fraction of the energy, told by 75 % of the judgements of pairs [1].
    low, high : float
        Its 95 % interval [1]; equal to `fraction` where it is taken as known.
    energy : float
        At which it holds [J]; NaN where it is the same at all energies.
    """

    fraction: float
    low: float
    high: float
    energy: float = math.nan

    def __post_init__(self) -> None:
        for name in ("fraction", "low", "high"):
            value = getattr(self, name)
            require_positive(f"Weber {name}", value)
            if value > _LARGEST_FRACTION:
                raise PipelineError(
                    f"Weber {name} must be at most {_LARGEST_FRACTION:g}, got {value:g}"
                )
        if not self.low <= self.fraction <= self.high:
            raise PipelineError(
                f"Weber fraction must lie within its interval, got {self.fraction:g} in "
                f"{self.low:g} to {self.high:g}"
            )
        if not math.isnan(self.energy):
            require_positive("energy", self.energy, "J")

    @property
    def log_spread(self) -> float:
        """Standard uncertainty of the logarithm of the fraction [1]."""
        return math.log(self.high / self.low) / (2.0 * _Z975)


@dataclass(frozen=True)
class Discrimination:
    """How finely a person tells energies of rings apart.

    Attributes
    ----------
    fractions : tuple of WeberFraction
        One for all energies, or several at rising energies; between them the logarithm of the
        fraction is interpolated over that of the energy, beyond them the last one holds.
    source : str
        Where they stand.
    """

    fractions: tuple[WeberFraction, ...]
    source: str

    def __post_init__(self) -> None:
        if not self.fractions:
            raise PipelineError(f"discrimination needs a Weber fraction, got none [{self.source}]")
        if len(self.fractions) == 1:
            return
        is_rising = all(np.diff(self.energies) > 0.0)
        if not is_rising:
            raise PipelineError(
                f"several Weber fractions must stand at rising energies, each with its own "
                f"[{self.source}]"
            )

    @property
    def energies(self) -> list[float]:
        """Energies at which the fractions are known [J]."""
        return [known.energy for known in self.fractions]

    @property
    def has_interval(self) -> bool:
        """Whether any fraction is uncertain."""
        return any(known.log_spread > 0.0 for known in self.fractions)

    def interpolate(self, log_energies: Array) -> tuple[Array, Array]:
        """Return logarithms of the fraction and their standard uncertainties at ln(E / J)."""
        logs = np.log([known.fraction for known in self.fractions])
        spreads = np.array([known.log_spread for known in self.fractions])
        if len(self.fractions) == 1:
            return np.full_like(log_energies, logs[0]), np.full_like(log_energies, spreads[0])
        nodes = np.log(self.energies)
        return np.interp(log_energies, nodes, logs), np.interp(log_energies, nodes, spreads)


LITERATURE: Final = Discrimination(
    (WeberFraction(WEBER_FRACTION, WEBER_FRACTION / _DOUBT, WEBER_FRACTION * _DOUBT),),
    f"{LEVEL_DIFFERENCE:g} dB of power at the fingertip, within a factor of {_DOUBT:g}",
)


@dataclass(frozen=True)
class JndDistance:
    """How far apart two rings are for a person.

    Attributes
    ----------
    jnd, low, high : float
        Just noticeable differences from the first to the second ring, with the 95 % interval [1];
        negative where the second is the weaker.
    """

    jnd: float
    low: float
    high: float

    @property
    def correct_share(self) -> float:
        """Share of judgements that tell the two apart [1]: Phi(0.674 |d|), 0.75 at one difference.

        Of a choice between two, without lapses.
        """
        return NormalDist().cdf(_Z75 * abs(self.jnd))


def compute_jnd_distance(
    first: float,
    second: float,
    discrimination: Discrimination = LITERATURE,
    *,
    log_ratios: Array | None = None,
) -> JndDistance:
    """Compute how many just noticeable differences lie between two energies of rings.

    Parameters
    ----------
    first, second : float
        Energies [J].
    discrimination : Discrimination
        Weber fraction of the energy, by default that of the literature.
    log_ratios : ndarray, shape (n,), optional
        Draws of ln(second / first), where the energies are uncertain; by default they are known.

    Returns
    -------
    JndDistance
        With the 95 % interval from the uncertainty of the Weber fraction and of the energies.

    Raises
    ------
    StepblocksError
        If an energy is not positive and finite, or `log_ratios` are no 100 or more finite numbers.

    Examples
    --------
    >>> distance = compute_jnd_distance(10e-6, 20e-6)  # 3.01 dB, with 1.5 dB to a difference
    >>> round(distance.jnd, 2), distance.low < distance.jnd < distance.high
    (2.01, True)
    """
    for name, energy in (("first", first), ("second", second)):
        require_positive(f"{name} energy", energy, "J")
    if log_ratios is not None:
        log_ratios = _read_log_ratios(log_ratios)
    log_ratio = math.log(second / first)
    nodes = math.log(first) + log_ratio * (np.arange(_NODES) + 0.5) / _NODES
    log_fractions, spreads = discrimination.interpolate(nodes)
    jnd = log_ratio * float(np.mean(1.0 / np.log1p(np.exp(log_fractions))))
    if log_ratios is None:
        log_ratios = np.full(DRAWS, log_ratio)
    person = draw_standard_normal_inputs(1, len(log_ratios), seed=1)[0]
    drawn_fractions = np.exp(log_fractions[:, None] + spreads[:, None] * person)
    densities = np.mean(1.0 / np.log1p(drawn_fractions), axis=0)
    low, high = np.quantile(log_ratios * densities, _TAILS)
    return JndDistance(jnd, float(low), float(high))


def _read_log_ratios(log_ratios: Array) -> Array:
    """Return draws of a logarithm as an array, shape (n,); refuse those that give no interval."""
    if np.ma.is_masked(log_ratios):
        raise PipelineError("log_ratios must be finite numbers, got masked ones")
    draws = np.asarray(log_ratios, dtype=np.float64)
    if draws.ndim != 1:
        raise PipelineError(
            f"log_ratios must be a row of numbers, got an array of {draws.ndim} dimensions"
        )
    if draws.size < _FEWEST_DRAWS:
        raise PipelineError(f"log_ratios must be {_FEWEST_DRAWS} or more numbers, got {draws.size}")
    unknown = np.flatnonzero(~np.isfinite(draws))
    if unknown.size:
        place = int(unknown[0])
        raise PipelineError(
            f"log_ratios must be finite numbers, got {draws[place]:g} [place {place}]"
        )
    return draws


def read_discrimination(
    table: pd.DataFrame | str | Path, *, layout: TableLayout = UNDECLARED
) -> Discrimination:
    """Read measured Weber fractions of the energy of a ring.

    Parameters
    ----------
    table : DataFrame, str or Path
        One row with ``weber_fraction`` (or ``weber_fraction_pct``) and, where they are known,
        ``weber_fraction_95_low`` and ``weber_fraction_95_high``; or several rows with
        ``energy_uj`` as well.
    layout : TableLayout
        What is declared of a file.

    Returns
    -------
    Discrimination
        By rising energy.

    Raises
    ------
    PipelineError
        If a column is missing or a row says something impossible; all mistakes at once.
    """
    if isinstance(table, pd.DataFrame):
        refuse_declared_layout(layout, "a table in memory", PipelineError)
        places = [f"row {row + 1}" for row in range(len(table))]
        source = "table"
        columns = read_si_columns(table, _COLUMNS, source, allow_missing=True)
    else:
        loaded = load_table(Path(table), layout=layout)
        warn_of_notes(loaded.notes, table)
        places = list(map(loaded.source.name_place_of_row, range(len(loaded.frame))))
        source = str(table)
        columns = read_si_columns(loaded.frame, _COLUMNS, loaded.source, allow_missing=True)
    fractions: list[WeberFraction] = []
    mistakes: list[Mistake] = []
    for row, place in enumerate(places):
        figures = {}
        for name, column in columns.items():
            figures[name] = float(column[row])
        with collect_mistakes(mistakes, place):
            fractions.append(_make_weber_fraction(figures))
    if mistakes:
        raise PipelineError(format_mistakes(mistakes, source))
    fractions.sort(key=lambda known: known.energy)
    return Discrimination(tuple(fractions), source)


def _make_weber_fraction(figures: dict[str, float]) -> WeberFraction:
    """Make a Weber fraction of a row's figures; one without an interval is taken as known."""
    fraction, low, high = figures["fraction"], figures["low"], figures["high"]
    if math.isnan(low) != math.isnan(high):
        raise PipelineError("both ends of the interval must be given, or none")
    if math.isnan(low):
        low = high = fraction
    return WeberFraction(fraction, low, high, figures["energy"])


def choose_compared_energies(compared: Sequence[Prediction]) -> tuple[list[float], str]:
    """Choose the energies [J] that a person compares, by the formula or by the drag.

    Where one of them is felt by the drag, all are: a change of model between two blocks would be
    felt as a difference. An energy is NaN where nothing slips; the second value says which model
    counts.
    """
    if not any(prediction.drag_differs for prediction in compared):
        energies = [prediction.release.vibration_energy for prediction in compared]
        return energies, Model.FORMULA.value
    energies = []
    for prediction in compared:
        if prediction.in_time is None:
            energies.append(math.nan)
        else:
            energies.append(prediction.in_time.energy)
    return energies, Model.DRAG.value
