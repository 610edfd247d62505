"""How far the energy that an edge releases moved from that of the nominal block, and why."""

from dataclasses import dataclass

from stepblocks.contact.counterface import Counterface, Step, find_critical_angle_of_scan
from stepblocks.contact.energy import Release, Status, find_release
from stepblocks.contact.energy_change import find_energy_change
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.relieved_step import RelievedStep
from stepblocks.inspect.conformity import Outcome
from stepblocks.inspect.result import InspectionResult
from stepblocks.parts.conditions import PredictionGrid
from stepblocks.parts.second_step import SECOND

_WORTH_SAYING = 0.01  # relative change of the energy from which a cause is named [1]


@dataclass(frozen=True)
class _MeasuredEdge:
    """The step that was asked for, and what was measured of it [m]."""

    nominal_height: float
    nominal_radius: float
    height: float
    radius: float
    burr: float  # that does not conform, else 0
    relief: tuple[float, float] | None  # width and depth at the root, nominal
    is_second: bool = False  # whether it is the second edge of its block

    @property
    def nominal(self) -> Counterface:
        """The step at its nominal sizes."""
        return self._make_step(self.nominal_height, self.nominal_radius)

    @property
    def as_built(self) -> Counterface:
        """The step as it was measured; a burr is as high as a step of it and the height."""
        return self._make_step(self.height + self.burr, self.radius)

    def _make_step(self, height: float, radius: float) -> Counterface:
        """Make a step of a height and a radius [m], with its relief if it has one."""
        if self.relief is None:
            return Step(height, radius)
        return RelievedStep(height, radius, *self.relief)

    def make_steps_by_cause(self) -> dict[str, Counterface]:
        """Return the nominal step with one measured size each, by the name of the size."""
        height = self.nominal_height
        radius = self.nominal_radius
        of_radius = f"its edge radius of {self.radius * 1e6:.3g} um"
        of_height = f"its height of {self.height * 1e6:.2f} um"
        of_burr = f"its burr of {self.burr * 1e6:.3g} um"
        return {
            of_radius: self._make_step(height, self.radius),
            of_height: self._make_step(self.height, radius),
            of_burr: self._make_step(height + self.burr, radius),
        }


def describe_energy(result: InspectionResult, grid: PredictionGrid) -> str:
    """Say how the energy that the edge releases differs from the nominal block's, and why.

    The nominal step and the step as built are compared under the first tip, load and friction of
    the grid; the scanned surface only where the edge is no arc and was seen. Empty where height and
    edge radius were not both measured.
    """
    verdict = f"{result.identity} {_describe_verdict(result)}"
    sentences = []
    first = _collect_measured_edge(result)
    if first is not None:
        sentences.append(_describe_edge_energy(result, first, grid, verdict))
    second = _collect_measured_edge(result, SECOND)
    if second is not None:
        sentences.append(_describe_edge_energy(result, second, grid, f"second edge of {verdict}"))
    return "; ".join(sentences)


def _describe_edge_energy(
    result: InspectionResult, edge: _MeasuredEdge, grid: PredictionGrid, verdict: str
) -> str:
    """Say behind a verdict how the energy of one edge differs from the nominal one's, and why."""
    point = grid.make_first_operating_point()
    conditions = (
        f"(tip {point.ball_radius * 1e6:g} um, {point.normal_load:g} N, friction "
        f"{point.friction:g})"
    )
    if not result.evaluation.arc and _sinks_into_relief(edge.nominal, point):
        return (
            f"{verdict}; the edge is no arc, and a ball that sinks into the relief before a sloped "
            f"riser has no prediction {conditions}"
        )
    causes = edge.make_steps_by_cause()
    nominal = edge.nominal.release(point)
    as_built = edge.as_built.release(point)
    releases = [nominal, as_built]
    for step in causes.values():
        releases.append(step.release(point))
    if any(release.status is not Status.RELEASES for release in releases):
        return (
            f"{verdict}; nominal {nominal.status.value}, as built {as_built.status.value} "
            f"{conditions}"
        )
    scanned = None
    if not edge.is_second:
        scanned = _compute_release_of_scanned_surface(result, point)
    if scanned is not None:
        change = find_energy_change(edge.nominal, scanned, point) * 100.0
        return (
            f"{verdict}; the edge is no arc; by the scanned surface itself {change:+.1f} "
            f"%, to {_format_vibration_energy(scanned)} {conditions}"
        )
    clause = _describe_energy_causes(result, edge.nominal, causes, point)
    change = find_energy_change(edge.nominal, edge.as_built, point)
    return (
        f"{verdict}{clause}; together {change * 100:+.1f} %, "
        f"to {_format_vibration_energy(as_built)} {conditions}"
    )


def _sinks_into_relief(step: Counterface, point: OperatingPoint) -> bool:
    """Tell whether a ball sinks into the relief of a step, if it has one."""
    return isinstance(step, RelievedStep) and point.ball_radius < step.least_riding_ball


def _collect_measured_edge(result: InspectionResult, key_prefix: str = "") -> _MeasuredEdge | None:
    """Return the sizes of an edge; None where height and radius were not measured and judged.

    The keys of its characteristics begin with a prefix.
    """
    height_key = f"{key_prefix}step_height"
    radius_key = f"{key_prefix}edge_radius"
    burr_key = f"{key_prefix}burr"
    values = result.evaluation.values
    nominal = {}
    failed = set()
    for judgement in result.judged:
        key = judgement.characteristic.key
        nominal[key] = judgement.characteristic.nominal
        if judgement.decision.verdict is Outcome.DOES_NOT_CONFORM:
            failed.add(key)
    for key in (height_key, radius_key):
        if key not in values or key not in nominal:
            return None
    burr = 0.0
    if burr_key in failed:
        burr = values[burr_key].value
    return _MeasuredEdge(
        nominal_height=nominal[height_key],
        nominal_radius=nominal[radius_key],
        height=values[height_key].value,
        radius=max(values[radius_key].value, 0.0),
        burr=burr,
        relief=_find_nominal_relief_size(result),
        is_second=bool(key_prefix),
    )


def _find_nominal_relief_size(result: InspectionResult) -> tuple[float, float] | None:
    """Return nominal width and depth of the relief of a part [m]; None of one without."""
    nominal = {}
    for judgement in result.judged:
        nominal[judgement.characteristic.key] = judgement.characteristic.nominal
    for line in result.missing:
        nominal[line.characteristic.key] = line.characteristic.nominal
    if "relief_width" not in nominal:
        return None
    return nominal["relief_width"], nominal["relief_depth"]


def _describe_verdict(result: InspectionResult) -> str:
    """Return the verdict of a part, or that it is measured in part."""
    if result.is_open:
        return "is measured in part"
    return result.conclusion


def _compute_release_of_scanned_surface(
    result: InspectionResult, point: OperatingPoint
) -> Release[Status, float] | None:
    """Return the release over the scanned surface; None where it was not seen or holds the tip."""
    surface = result.evaluation.surface
    if surface is None:
        return None
    angle = find_critical_angle_of_scan(surface.position, surface.height, point.ball_radius)
    if angle is None:
        return None
    release = find_release(angle, point.normal_load, point.friction, point.tool)
    if release.status is not Status.RELEASES:
        return None
    return release


def _describe_energy_causes(
    result: InspectionResult,
    nominal_step: Counterface,
    steps_by_cause: dict[str, Counterface],
    point: OperatingPoint,
) -> str:
    """Name the sizes that change the energy, each alone; or say that it is as nominal."""
    named = []
    for cause, step in steps_by_cause.items():
        change = find_energy_change(nominal_step, step, point)
        if not abs(change) >= _WORTH_SAYING:
            continue
        verb = "raises" if change > 0.0 else "lowers"
        named.append(f"{cause} {verb} E_v by {abs(change) * 100:.1f} %")
    if not named:
        return f", and E_v is within {100.0 * _WORTH_SAYING:g} % of the nominal block's"
    joined = " and ".join(named)
    if result.verdict is Outcome.CONFORMS:
        return f", but {joined}"
    return f": {joined}"


def _format_vibration_energy(release: Release[Status, float]) -> str:
    """Return the vibration energy of a release with its unit."""
    return f"{float(release.vibration_energy) * 1e6:.3g} uJ"
