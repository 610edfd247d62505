"""How far the energy that an edge releases moved from that of the nominal block, and why."""

from stepblocks.contact.counterface import Step, find_scanned_angle
from stepblocks.contact.energy import Status, find_release
from stepblocks.contact.energy_change import find_energy_change
from stepblocks.inspect.budget import Outcome
from stepblocks.inspect.report import InspectionResult
from stepblocks.parts.conditions import PredictionGrid

_WORTH_SAYING = 0.01  # relative change of the energy from which a cause is named [1]


def describe_energy(result: InspectionResult, grid: PredictionGrid) -> str:
    """Say how the energy that the edge releases differs from the nominal block's, and why.

    The nominal step and the step as built are compared under the first tip, load and friction of
    the grid; the scanned surface only where the edge is no arc and was seen. Empty where height and
    edge radius were not both measured.
    """
    values = result.evaluation.values
    nominal = {one.key: one.nominal for one, _ in result.judged}
    if not {"step_height", "edge_radius"} <= set(values) & set(nominal):
        return ""
    point = grid.first_point()
    surface = result.evaluation.surface
    failed = {one.key for one, found in result.judged if found.verdict is Outcome.DOES_NOT_CONFORM}
    asked = Step(nominal["step_height"], nominal["edge_radius"])
    radius = max(values["edge_radius"].value, 0.0)
    burr = values["burr"].value if "burr" in failed else 0.0
    height = values["step_height"].value
    as_built = Step(height + burr, radius)
    steps = {
        f"its edge radius of {radius * 1e6:.3g} um": Step(asked.height, radius),
        f"its height of {height * 1e6:.2f} um": Step(height, asked.edge_radius),
        f"its burr of {burr * 1e6:.3g} um": Step(asked.height + burr, asked.edge_radius),
    }
    releases = [face.release(point) for face in (asked, as_built, *steps.values())]
    verdict = f"{result.identity} " + (
        "is measured in part" if result.conclusion == result.statement else result.conclusion
    )
    where = (
        f"(tip {point.ball_radius * 1e6:g} um, {point.normal_load:g} N, friction "
        f"{point.friction:g})"
    )
    if any(release.status is not Status.RELEASES for release in releases):
        return (
            f"{verdict}; nominal {releases[0].status.value}, as built {releases[1].status.value} "
            f"{where}"
        )
    angle = (
        None
        if surface is None
        else find_scanned_angle(surface.position, surface.height, point.ball_radius)
    )
    if angle is not None:
        scanned = find_release(angle, point.normal_load, point.friction, point.tool)
        if scanned.status is Status.RELEASES:
            change = find_energy_change(asked, scanned, point) * 100.0
            return (
                f"{verdict}; the edge is no arc; by the scanned surface itself {change:+.1f} "
                f"%, to {float(scanned.vibration_energy) * 1e6:.3g} uJ {where}"
            )
    causes = {cause: find_energy_change(asked, step, point) for cause, step in steps.items()}
    named = " and ".join(
        f"{cause} {'raises' if change > 0.0 else 'lowers'} E_v by {abs(change) * 100:.1f} %"
        for cause, change in causes.items()
        if abs(change) >= _WORTH_SAYING
    )
    clause = (
        f"{', but ' if result.verdict is Outcome.CONFORMS else ': '}{named}"
        if named
        else f", and E_v is within {100.0 * _WORTH_SAYING:g} % of the nominal block's"
    )
    change = find_energy_change(asked, as_built, point)
    return (
        f"{verdict}{clause}; together {change * 100:+.1f} %, to "
        f"{float(releases[1].vibration_energy) * 1e6:.3g} uJ {where}"
    )
