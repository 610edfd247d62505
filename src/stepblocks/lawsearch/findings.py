"""What a search comes to: verdict, findings with their rivals, and the rules for claims."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

from stepblocks.lawsearch.adequacy import ResidualCheck, Share
from stepblocks.lawsearch.choice import Rival
from stepblocks.lawsearch.law import Law
from stepblocks.lawsearch.problem import Fit, Problem
from stepblocks.lawsearch.structure import Hint

_NO_SHARE = Share(0, 0.0)


class Verdict(StrEnum):
    """How an analysis may end."""

    EFFECT = "effect"  # something is there, and its law has a name
    AMBIGUOUS = "ambiguous"  # something is there, and the data cannot tell which of several it is
    # something is there, at a slot and along a covariate, and no law is claimed
    UNEXPLAINED = "unexplained"
    NONE = "none"  # no effect beyond noise


class Doubt(StrEnum):
    """Why a law, or the whole, is not claimed; each as the end of a sentence."""

    WANDERS = "it may wander as well"
    FEW_TRIALS = "few trials carry it"
    NO_LAW_FITS = "no law of the list fits it"
    STANDS_IN = "it may stand in for what is left"
    FOLDS_MISS_IT = "parts of the trials miss it"
    RESIDUAL_LEFT = "the residual holds more than noise"
    REPLICATES_AGREE_BETTER = "trials of equal settings agree better than it"


@dataclass(frozen=True)
class Rules:
    """When to claim what.

    Attributes
    ----------
    alpha : float
        Chance of a false alarm of one gate, over all candidates.
    margin : float
        Of the criterion (cost + p ln n), within which two effects count as rivals.
    most : int
        Effects that are added, at most.
    draws : int
        Of the bootstrap of a gate.
    seed : int
        Of the bootstrap.
    fits : int
        Laws, and smooths, that are fitted in full at each step.
    wild : float
        Robust standard deviations from any smooth function of the conditions, from which a single
        reading is left out.
    """

    alpha: float = 0.01
    margin: float = 8.0
    most: int = 4
    draws: int = 500
    seed: int = 0
    fits: int = 10
    wild: float = 4.0


@dataclass(frozen=True)
class Finding:
    """One effect found.

    Attributes
    ----------
    effect : Law
    verdict : Verdict
        What may be claimed of it.
    gate_p : float
        Chance that noise opens the gate as wide, over the whole family of candidates.
    gain : float
        Fall of the cost (twice the log likelihood) when it is added to the others.
    rivals : tuple[Rival, ...]
        Effects that do as well within the margin, the likeliest of them.
    leading_trial : Share
        Row of the trial that gains most by the effect, and its share of the gain.
    leading_channel : Share
        Number of the channel that gains most, and its share.
    reason : str
        Why no law is claimed, a `Doubt` or a sentence; empty where one is claimed.
    """

    effect: Law
    verdict: Verdict
    gate_p: float
    gain: float
    rivals: tuple[Rival, ...] = ()
    leading_trial: Share = _NO_SHARE
    leading_channel: Share = _NO_SHARE
    reason: str = ""

    @property
    def laws(self) -> list[Law]:
        """The effect, then its rivals."""
        return [self.effect, *list_effects(self.rivals)]


def list_effects(findings: Sequence[Finding] | Sequence[Rival]) -> list[Law]:
    """List the effects of findings, or of rivals."""
    return [finding.effect for finding in findings]


class BadTrial(NamedTuple):
    """A trial that went wrong.

    Attributes
    ----------
    row : int
    chance : float
        That it went wrong.
    """

    row: int
    chance: float


@dataclass(frozen=True, kw_only=True)
class SearchResult:
    """The extended model that a search has found, and the gates that its effects passed.

    Attributes
    ----------
    problem : Problem
    extended : Fit
    gates : dict[str, float]
        Chance of a false alarm of the gate that let each effect in, by its name.
    last_gate_p : float
        P value of the last gate.
    needed : float
        Gain of one amplitude that opens the last gate.
    hints : tuple[Hint, ...]
        Of causes that no column describes.
    walks : frozenset[str]
        Names of the effects along the run that a random walk explains as well.
    """

    problem: Problem = field(repr=False)
    extended: Fit = field(repr=False)
    gates: dict[str, float] = field(repr=False)
    last_gate_p: float = field(repr=False)
    needed: float = field(repr=False)
    hints: tuple[Hint, ...] = field(default=(), repr=False)
    walks: frozenset[str] = field(default=frozenset(), repr=False)

    @property
    def hint_sentences(self) -> list[str]:
        """Sentences of the hints."""
        return [hint.sentence for hint in self.hints]


@dataclass(frozen=True, kw_only=True)
class Explanation(SearchResult):
    """The nominal model, the extended one, what was found and on what grounds.

    Attributes
    ----------
    nominal : Fit
    findings : tuple[Finding, ...]
    verdict : Verdict
    checks : tuple[ResidualCheck, ...]
        Tests of each channel's residual against each covariate.
    adequate : bool
        Whether the residual of the extended model follows no covariate.
    apart : tuple[BadTrial, ...]
        Trials that went wrong and took no part.
    reason : str
        Why the whole is not claimed although every finding may be, a `Doubt` or a sentence; empty
        otherwise.
    channel : str
        Channel in which that shows; empty otherwise.
    """

    nominal: Fit = field(repr=False)
    findings: tuple[Finding, ...] = field(repr=False)
    verdict: Verdict
    checks: tuple[ResidualCheck, ...] = field(repr=False)
    adequate: bool
    apart: tuple[BadTrial, ...] = field(default=(), repr=False)
    reason: str = ""
    channel: str = ""
