"""Why a trial is left out of a session, or marked in it: a kind, and a text for the reader."""

from dataclasses import dataclass
from enum import Enum

from stepblocks.errors import RuleError

_LONGEST_HEADING = 60  # letters of a text without a heading that stand for its kind


class FaultKind(Enum):
    """Kind of a fault. The value is the heading of the reason in the table of features."""

    # the samples of the record
    TRUNCATED = "truncated"
    NOT_A_NUMBER = "not-a-number"
    WRONG_CLOCK = "wrong clock"
    GAP = "gap"
    WRONG_RATE = "wrong rate"
    DEAD_CHANNEL = "dead channel"
    SATURATED = "saturated"
    # the file of the record
    MISSING = "missing"
    UNKNOWN_CHANNEL = "unknown channel"
    UNREADABLE = "unreadable"
    # the course of the trial
    NO_SLIP = "no slip"
    NO_SLIDING = "no sliding before the edge"
    NO_LOADING = "no loading"
    NO_RAMP = "no ramp"
    NO_RELEASE = "no release"
    # the row of the table of trials
    DUPLICATE = "duplicate"
    MISLABELLED = "mislabelled"
    UNITS_CHANGED = "units changed or mislabelled"
    WRONG_UNITS = "units"
    # the text says everything
    WITHOUT_HEADING = ""


class Bound(Enum):
    """Part of a record that a fault cuts off, so that the record only bounds it."""

    PEAK_FORCE = "the tangential force does not show its peak"
    RING = "the tangential force is cut off after the slip"
    NORMAL_FORCE = "the normal force is cut off"


@dataclass(frozen=True)
class TrialFault:
    """Why one trial is left out or marked.

    Attributes
    ----------
    kind : FaultKind
    details : str
        What was found, with its value and place.
    bound : Bound or None
        What the record bounds in spite of the fault; None where nothing of it can be measured.
    """

    kind: FaultKind
    details: str = ""
    bound: Bound | None = None

    def __str__(self) -> str:
        """Return the reason as the table of features shows it."""
        if not self.kind.value:
            return self.details
        if not self.details:
            return self.kind.value
        return f"{self.kind.value}: {self.details}"

    @property
    def heading(self) -> str:
        """Heading under which a summary counts the fault."""
        if self.kind.value:
            return self.kind.value
        return self.details.split(":")[0][:_LONGEST_HEADING]


class Evidence(Enum):
    """What of a record contradicts the row of its trial."""

    LOAD = "normal force"
    RAMP = "loading ramp"
    BLOCK = "critical angle"
    SAMPLES = "samples of another trial"


@dataclass(frozen=True, kw_only=True)
class LabelFault(TrialFault):
    """Contradiction between a record and the row of its trial.

    Attributes
    ----------
    evidence : Evidence
    """

    evidence: Evidence


class FaultError(RuleError):
    """A trial that cannot be measured.

    Attributes
    ----------
    fault : TrialFault
    """

    def __init__(self, kind: FaultKind, details: str = "", bound: Bound | None = None) -> None:
        super().__init__(kind, details, bound)
        self.fault = TrialFault(kind, details, bound)

    def __str__(self) -> str:
        """Return the reason as the table of features shows it."""
        return str(self.fault)


class TraceError(FaultError):
    """A trace that cannot be read or used."""


class LandmarkError(FaultError):
    """A trace that lacks a part of the course of a trial: sliding, loading or slip."""
