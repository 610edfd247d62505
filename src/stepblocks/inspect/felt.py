"""What an inspected block will feel like: how far its height, its edge radius and its scanned surface move the felt energy."""

from __future__ import annotations

from stepblocks.contact.critical_angle import step_angle
from stepblocks.contact.energy import Release, Status, release_at
from stepblocks.contact.felt import scanned_angle
from stepblocks.inspect.conformity import Outcome
from stepblocks.inspect.inspection import Inspected
from stepblocks.parts.conditions import PredictionGrid
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.predict.predictions import tool_of

_WORTH_SAYING = 0.01  # Relative change of the energy from which a cause is named [1]


def felt_sentence(block: StepBlock, verdict: Outcome, inspected: Inspected, grid: PredictionGrid) -> str:
    """Say how the energy that the edge releases differs from the nominal block's, and why."""
    ball, load, friction = grid.tip_radii[0], grid.normal_loads[0], grid.frictions[0]
    tool = tool_of(grid)
    height, radius = inspected.values["step_height"].value, max(inspected.values["edge_radius"].value, 0.0)

    def released(angle: float) -> Release:
        return release_at(angle, load, friction, tool)

    asked = released(step_angle(block.height.nominal, ball, block.edge_radius.nominal))
    by_radius = released(step_angle(block.height.nominal, ball, radius))
    by_height = released(step_angle(height, ball, block.edge_radius.nominal))
    made = released(step_angle(height, ball, radius))
    where = f"tip {ball * 1e6:g} um, {load:g} N, friction {friction:g}"
    if any(one.status is not Status.RELEASES for one in (asked, by_radius, by_height, made)):
        return f"{block.id} {verdict.value}; nominal {asked.status.value}, as built {made.status.value} ({where})"
    causes = [
        (f"its edge radius of {radius * 1e6:.3g} um", _change(by_radius, asked)),
        (f"its height of {height * 1e6:.2f} um", _change(by_height, asked)),
    ]
    total = _change(made, asked)
    named = " and ".join(f"{name} {_moves(change)}" for name, change in causes if abs(change) >= _WORTH_SAYING)
    if not named:
        sentence = f"{block.id} {verdict.value}, and E_v is within {100.0 * _WORTH_SAYING:g} % of the nominal block's"
    else:
        joint = ", but " if verdict is Outcome.CONFORMS else ": "
        sentence = f"{block.id} {verdict.value}{joint}{named}"
    sentence += f"; together {total * 100:+.1f} %, to {made.vibration_energy * 1e6:.3g} uJ"
    scanned = scanned_angle(inspected.shown.position, inspected.shown.height, ball)
    if scanned is not None:
        itself = released(scanned)
        if itself.status is Status.RELEASES:
            sentence += f"; by the scanned surface itself {_change(itself, asked) * 100:+.1f} %"
    return f"{sentence} ({where})"


def _change(after: Release, before: Release) -> float:
    return after.vibration_energy / before.vibration_energy - 1.0


def _moves(change: float) -> str:
    return f"{'raises' if change > 0.0 else 'lowers'} E_v by {abs(change) * 100:.1f} %"
