"""What an analysis of judgements found, and its planned tests."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from stepblocks.files.tables import Table
from stepblocks.lawsearch.law import correct_p_values_by_holm
from stepblocks.study.analysis.accuracy import ANSWER, Measure
from stepblocks.study.analysis.anova import Interval
from stepblocks.study.analysis.comparisons import Comparisons, CurveQuantity
from stepblocks.study.analysis.log_error import LogError
from stepblocks.study.analysis.magnitudes import PowerLaw
from stepblocks.study.analysis.ordinal import OrdinalFit

EXPONENT = "exponent"  # of magnitudes; all other quantities of contrasts are logarithms


@dataclass(frozen=True)
class MeasureTest:
    """Planned test of a measure of accuracy between conditions."""

    measure: Measure
    p: float  # probability under no effect, with corrected degrees of freedom

    @property
    def name(self) -> str:
        """Name of the outcome."""
        return self.measure.name


@dataclass(frozen=True)
class RatingTest:
    """Planned test of ratings between conditions."""

    name: str  # of the outcome
    fit: OrdinalFit

    @property
    def p(self) -> float:
        """Probability under no effect."""
        return self.fit.participants.p


@dataclass(frozen=True)
class ContrastTest:
    """Planned test of a quantity between two settings."""

    quantity: str  # one of `CurveQuantity`, or `EXPONENT`
    interval: Interval

    @property
    def name(self) -> str:
        """Name of the outcome."""
        return format_contrast_name(self.quantity, self.interval.first, self.interval.second)

    @property
    def p(self) -> float:
        """Probability under no effect."""
        return self.interval.p

    @property
    def is_logarithmic(self) -> bool:
        """Whether the difference is the logarithm of a ratio."""
        return self.quantity != EXPONENT


PlannedTest = MeasureTest | RatingTest | ContrastTest


@dataclass(frozen=True)
class Finding:
    """What a planned test found.

    Attributes
    ----------
    name : str
        The outcome that is tested.
    p, corrected : float
        Probability under no effect, and after Holm's correction over all but the primary outcome.
    primary : bool
        Whether it is the outcome that the design names.
    test : PlannedTest
        With its estimates.
    """

    name: str
    p: float
    corrected: float
    primary: bool
    test: PlannedTest = field(repr=False, compare=False)


@dataclass(frozen=True, kw_only=True)
class Analysis:
    """What an analysis of judgements found; what an experiment does not have is empty.

    Attributes
    ----------
    frame : DataFrame
        Judgements, one a row.
    measures : tuple of Measure
        Bias, absolute error and spread of estimates.
    remarks : tuple of str
        On what could not be analysed.
    ordinal : mapping of OrdinalFit
        By outcome: ratings of realism over all conditions, or by each of several factors.
    comparisons : tuple of Comparisons
        Psychometric functions by setting.
    contrasts : mapping of tuple of Interval
        By quantity, differences of its logarithm between settings.
    power_laws : tuple of PowerLaw
        Of the magnitudes, by condition.
    exponents : tuple of Interval
        Differences of exponents between conditions.
    log_errors : tuple of LogError
        Error of the logarithm of estimates: over all conditions, then in each.
    """

    frame: Table
    measures: tuple[Measure, ...] = ()
    remarks: tuple[str, ...] = ()
    ordinal: Mapping[str, OrdinalFit] = field(default_factory=dict)
    comparisons: tuple[Comparisons, ...] = ()
    contrasts: Mapping[CurveQuantity, tuple[Interval, ...]] = field(default_factory=dict)
    power_laws: tuple[PowerLaw, ...] = ()
    exponents: tuple[Interval, ...] = ()
    log_errors: tuple[LogError, ...] = ()

    def measure(self, name: str = ANSWER) -> Measure | None:
        """Return one measure of accuracy, if it was analysed."""
        for measure in self.measures:
            if measure.name == name:
                return measure
        return None

    def differences(self) -> dict[str, Interval]:
        """Return the planned tests of two settings by their names."""
        return {test.name: test.interval for test in self.iterate_contrast_tests()}

    def iterate_contrast_tests(self) -> Iterator[ContrastTest]:
        """Yield the planned tests of two settings."""
        for quantity, family in self.contrasts.items():
            for interval in family:
                yield ContrastTest(quantity.value, interval)
        for interval in self.exponents:
            yield ContrastTest(EXPONENT, interval)

    def collect_planned_tests(self) -> dict[str, PlannedTest]:
        """Return all planned tests by their names."""
        tests = dict[str, PlannedTest]()
        for measure in self.measures:
            if measure.corrected is not None:
                tests[measure.name] = MeasureTest(measure, measure.corrected.p)
        for name, fit in self.ordinal.items():
            tests[name] = RatingTest(name, fit)
        for contrast in self.iterate_contrast_tests():
            tests[contrast.name] = contrast
        return tests

    def summarise_findings(self, primary: str = "") -> tuple[Finding, ...]:
        """Return what the planned tests found, the primary outcome first.

        Without the outcome that is named as `primary`, the absolute error is the primary outcome,
        or else the first of all. Tests without a probability are no secondary outcomes.
        """
        tests = self.collect_planned_tests()
        first = _choose_primary_test(tests, primary)
        if first is None:
            return ()
        findings = [Finding(first.name, first.p, first.p, primary=True, test=first)]
        secondary = []
        for test in tests.values():
            if test.name != first.name and math.isfinite(test.p):
                secondary.append(test)
        corrected = correct_p_values_by_holm([test.p for test in secondary]).tolist()
        for test, p in zip(secondary, corrected, strict=True):
            findings.append(Finding(test.name, test.p, p, primary=False, test=test))
        return tuple(findings)


def _choose_primary_test(tests: Mapping[str, PlannedTest], primary: str) -> PlannedTest | None:
    """Return the test of the primary outcome; None without tests."""
    for name in (primary, ANSWER, *tests):
        if name in tests:
            return tests[name]
    return None


def format_contrast_name(quantity: str, first: str, second: str) -> str:
    """Name the planned test of a quantity between two settings."""
    if quantity == EXPONENT:
        return f"{quantity}, {first} minus {second}"
    return f"{quantity}, {first} over {second}"
