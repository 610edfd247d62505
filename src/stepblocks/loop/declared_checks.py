"""What records show of what a session declares, as results that need nothing of the search."""

from dataclasses import dataclass
from enum import Enum

_SLIPS = (2.0, 10.0, 100.0, 1000.0)  # factors by which people slip
_NEAR_SLIP = 0.08  # of such a factor


def find_common_mistake_factor(ratio: float) -> float | None:
    """Find the factor of a common slip near a ratio, such as 1000 for a unit; None for no slip."""
    for factor in _SLIPS:
        for slip in (factor, 1.0 / factor):
            if abs(ratio / slip - 1.0) < _NEAR_SLIP:
                return slip
    return None


class Declared(Enum):
    """A declared quantity that the records show, too: the name of the channel that shows it."""

    SPRING = "spring_constant"
    LOAD = "normal_load_ratio"

    @property
    def evidence_phrase(self) -> str:
        """What shows it, in words."""
        if self is Declared.SPRING:
            return "the ramps show"
        return "the normal gauge shows"

    @property
    def name_in_words(self) -> str:
        """What is declared, in words."""
        if self is Declared.SPRING:
            return "declared spring"
        return "set load"

    @property
    def suspects(self) -> tuple[str, ...]:
        """What may be wrong instead."""
        if self is Declared.SPRING:
            return ("spring", "speed", "tangential gain")
        return ("weights", "normal gain", "normal zero")

    @property
    def suspects_of_mistake(self) -> tuple[str, ...]:
        """What may be wrong by a factor at which people slip."""
        if self is Declared.SPRING:
            return ("probe.spring_constant", "trials.columns.speed", "acquisition.sample_rate")
        return ("acquisition.channels.normal.factor", "trials.columns.load")

    @property
    def advice(self) -> str:
        """What decides among the suspects."""
        if self is Declared.SPRING:
            return (
                "weigh the spring: hang a known weight on the tip, read its deflection and the "
                "tangential gauge, and time the handle over a known distance"
            )
        return "put a known weight on the normal gauge, and weigh the weights"


def _compute_deviation_percent(ratio: float) -> float:
    """Compute the deviation of a ratio from one in percent, negative below one."""
    return 100.0 * (ratio - 1.0)


@dataclass(frozen=True)
class CalibrationCheck:
    """What the records say of one declared quantity.

    Attributes
    ----------
    quantity : Declared
    shown : float
        Ratio of what is shown to what is declared [1].
    low, high : float
        Its 95 % interval, with what the evaluation may share among trials [1].
    contradicts : bool
        Whether shown and declared differ by more than 99 % allow.
    slip : float | None
        Factor of a typical mistake near which `shown` lies [1]; None without one.
    explained : bool
        Whether an effect that was found accounts for the difference.
    """

    quantity: Declared
    shown: float
    low: float
    high: float
    contradicts: bool
    slip: float | None = None
    explained: bool = False

    @property
    def is_open(self) -> bool:
        """Whether a contradiction is left that no effect accounts for."""
        return self.contradicts and not self.explained

    @property
    def sentence(self) -> str:
        """The contradiction in plain words."""
        percent = _compute_deviation_percent(self.shown)
        direction = "more" if percent > 0.0 else "less"
        ends = abs(_compute_deviation_percent(self.low)), abs(_compute_deviation_percent(self.high))
        low, high = sorted(ends)
        suspects = self.quantity.suspects
        if self.slip is not None:
            suspects = self.quantity.suspects_of_mistake
        named = f"{', '.join(suspects[:-1])} or {suspects[-1]}"
        return (
            f"{self.quantity.evidence_phrase} {abs(percent):.1f} % ({low:.1f} to "
            f"{high:.1f} %) {direction} than the {self.quantity.name_in_words}: {named}"
        )


@dataclass(frozen=True)
class RateCheck:
    """What the clock of the traces says of the declared sample rate.

    Attributes
    ----------
    declared : float
        [Hz].
    shown, low, high : float
        Median, least and largest rate of the traces over the declared one [1].
    contradicts : bool
        Whether the traces have another rate than is declared.
    """

    declared: float
    shown: float
    low: float
    high: float
    contradicts: bool

    @property
    def slip(self) -> float | None:
        """Factor of a typical mistake near which `shown` lies [1]; None without one."""
        return find_common_mistake_factor(self.shown)

    @property
    def sentence(self) -> str:
        """The contradiction in plain words."""
        return (
            f"the time of the traces shows {self.shown * self.declared:.6g} Hz, "
            f"{self.shown:.3g} times what is declared: acquisition.sample_rate or the unit of "
            "acquisition.channels.time"
        )


@dataclass(frozen=True)
class SessionCheck:
    """What some traces of a session say of its declaration.

    Attributes
    ----------
    looked_at, measured : int
        Trials, spread over the session, and those of them that could be measured.
    reason : str
        What is wrong with the first that could not; empty where all could.
    spring_constant : float
        As declared [N/m].
    spring, load : CalibrationCheck or None
        None where too few trials show it.
    rate : RateCheck or None
        None where the traces have no column of the time.
    ring_frequency : float or None
        Median of the trials [Hz]; None where too few rang.
    rings_as_usual : bool
        Whether it lies where tools ring, which speaks for the sample rate.
    slip : str
        Why the session cannot be measured as it is declared, with the likely slip; empty where it
        can.
    digest : str
        SHA-256 of the session.toml that was read.
    """

    looked_at: int
    measured: int
    reason: str
    spring_constant: float
    spring: CalibrationCheck | None
    load: CalibrationCheck | None
    rate: RateCheck | None
    ring_frequency: float | None
    rings_as_usual: bool
    slip: str
    digest: str

    @property
    def contradictions(self) -> list[str]:
        """Sentences that say what contradicts the declaration, the likely slip first."""
        sentences = []
        if self.slip:
            sentences.append(self.slip)
        for check in (self.spring, self.load, self.rate):
            if check is not None and check.contradicts:
                sentences.append(check.sentence)
        return sentences

    @property
    def rows(self) -> list[dict[str, float | str]]:
        """What is shown over what is declared, as rows of a table."""
        rows: list[dict[str, float | str]] = []
        names = ("spring constant", "normal load", "sample rate")
        for name, check in zip(names, (self.spring, self.load, self.rate), strict=True):
            if check is not None:
                rows.append({"": name, "shown": check.shown, "low": check.low, "high": check.high})
        return rows
