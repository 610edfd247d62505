"""Questions to the model: to equations (1) and (2), to the drag in time, and to that of a rod."""

# Each question takes the condition of a published figure in SI and returns up to three answers;
# not-a-number where the model says nothing, and words where it says that something cannot be.

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

from stepblocks.contact.counterface import Counterface, Margin, Step
from stepblocks.contact.energy import Status
from stepblocks.contact.operating_point import PAPER, Limits, OperatingPoint, Tool
from stepblocks.drag.probe import SETTINGS, DragSettings, build_probe_of_tool
from stepblocks.drag.ring import Ring, measure_ring
from stepblocks.drag.simulate import simulate_drag
from stepblocks.drag.track import build_track
from stepblocks.errors import ContactError

# Conditions that a published figure may name, and their dimension; words have none
AT = dict.fromkeys(("height", "gap", "tip_radius"), "length")
AT |= {"load": "force", "friction": "ratio", "energy": "energy", "phase": "", "figure": ""}
At = Mapping[str, Any]
_LEAST_GAP = 10e-9  # smaller ones are roughness [m]
# the paper's point, whose equations are asked without the limits of a hand or a tool
_EQUATIONS = replace(PAPER, tool=Tool(limits=Limits()))


@dataclass(frozen=True)
class Answers:
    """What the model says, in the SI unit of the question."""

    formula: float = math.nan  # equations (1) and (2)
    drag: float = math.nan  # the drag in time, the load on the tip
    rod: float = math.nan  # the drag in time of a round rod, the load on a carrier behind it
    said: str = ""  # where there is no figure: locked, beyond reach, an input

    def known(self) -> dict[str, float]:
        """Return the answers that are figures, by whom."""
        return {
            name: value
            for name in ("formula", "drag", "rod")
            if math.isfinite(value := getattr(self, name))
        }


def _make_point(at: At) -> OperatingPoint:
    asked = {"ball_radius": "tip_radius", "normal_load": "load", "friction": "friction"}
    return replace(_EQUATIONS, **{field: at[name] for field, name in asked.items() if name in at})


def _make_counterface(at: At) -> Counterface:
    return Margin(at["gap"], at["gap"], 0.0) if "gap" in at else Step(at["height"])


@lru_cache(maxsize=256)
def drag_in_time(
    face: Counterface, point: OperatingPoint, rod: bool = False, pull: float = 0.0
) -> tuple[Status, Ring]:
    """Drag in time over a counterface; without a ring all figures are NaN.

    A rod is set as docs/explanation/drag.md does for figures 3 to 5.
    """
    # A rod is as stiff along the normal as along the drag and carries 10 g of holder beside its
    # weight; `pull` [N] pulls the handle with a constant force instead of moving it.
    light = {"damping_ratio": 0.01}
    changes = (
        SETTINGS["figures-3-to-5"].list_probe_changes(point.tool, point.normal_load)
        if rod
        else light
    )
    probe = build_probe_of_tool(point.tool, point.ball_radius, **changes)
    how = {"speed": 0.0, "pulling_force": pull, "handle_mass": 0.1} if pull else {}
    track, settings = build_track(face, point.ball_radius), DragSettings.from_point(point, **how)
    none = Ring(*[math.nan] * 7)
    try:
        trace = simulate_drag(track, probe, settings)
        return trace.status, measure_ring(trace) if trace.status is Status.RELEASES else none
    except ContactError:  # its energy ledger does not close, so that it answers nothing
        return Status.NO_CATCH, none


def _answer_energy(at: At) -> Answers:
    face, point = _make_counterface(at), _make_point(at)
    release = face.release(point)
    if release.status is not Status.RELEASES:
        return Answers(said=str(release.status))
    (_, light), (_, rod) = drag_in_time(face, point), drag_in_time(face, point, rod=True)
    return Answers(release.vibration_energy, light.energy, rod.energy)


def _answer_ring(at: At) -> Answers:
    # the formula says nothing of its own: its decay was chosen from the share of the band
    if at.get("figure") == "frequency":
        return Answers(said="an input of the model")
    name = (
        {"loading": "loading_share", "vibration": "ring_band_share"}[at["phase"]]
        if "phase" in at
        else at["figure"]
    )
    (_, light), (_, rod) = (
        drag_in_time(_make_counterface(at), _make_point(at), rod) for rod in (False, True)
    )
    return Answers(drag=getattr(light, name), rod=getattr(rod, name))


def _answer_pull_force(at: At) -> Answers:
    face, point = _make_counterface(at), _make_point(at)
    release = face.release(point)
    return Answers(
        release.pull_force, said="" if release.status is Status.RELEASES else str(release.status)
    )


def _answer_detectable_groove(at: At) -> Answers:
    """Find the least gap whose ring is felt, by bisection: energy grows with the gap."""
    point = _make_point(at)
    threshold = PAPER.tool.detection_threshold * PAPER.tool.ring_duration

    def by_formula(gap: float) -> bool:
        release = Margin(gap, gap, 0.0).release(point)
        return (
            release.status in (Status.LOCKED, Status.TOO_HIGH)
            or release.vibration_energy >= threshold
        )

    def by_drag(gap: float, rod: bool) -> bool:
        status, ring = drag_in_time(Margin(gap, gap, 0.0), point, rod)
        return status in (Status.LOCKED, Status.TOO_HIGH) or ring.energy >= threshold

    ways = by_formula, lambda gap: by_drag(gap, False), lambda gap: by_drag(gap, True)
    least = [_find_detectable_gap(felt, point.ball_radius) for felt in ways]
    kept = "equation (1) keeps the energy of the friction that it pulls against, at any gap"
    return Answers(least[0], least[1], least[2], kept if least[0] <= _LEAST_GAP else "")


def _find_detectable_gap(felt: Callable[[float], bool], ball_radius: float) -> float:
    if felt(_LEAST_GAP):
        return _LEAST_GAP
    low, high = _LEAST_GAP, 1.99 * ball_radius
    while high > 1.01 * low:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if felt(middle) else (middle, high)
    return high


def _answer_energy_ratio(at: At) -> Answers:
    face, point = _make_counterface(at), replace(_make_point(at), normal_load=0.1)
    sharp, blunt = (face.release(replace(point, ball_radius=radius)) for radius in (29e-6, 125e-6))
    for release in (sharp, blunt):
        if release.status is not Status.RELEASES:
            return Answers(said=str(release.status))
    return Answers(sharp.vibration_energy / blunt.vibration_energy)


def _answer_gap_found(at: At) -> Answers:
    loads = (0.1, 0.2, 0.5, 1.0, 2.0, 3.4)
    releases = [
        _make_counterface(at).release(replace(_make_point(at), normal_load=load)) for load in loads
    ]
    found = [r.status is Status.LOCKED or r.threshold_ratio >= 1.0 for r in releases]
    return Answers(sum(found) / len(found))


# What each asks, and the dimension of its answer
QUESTIONS: dict[str, tuple[Callable[[At], Answers], str]] = {
    "energy": (_answer_energy, "energy"),
    "power_of_energy": (lambda at: Answers(at["energy"] / PAPER.tool.ring_duration), "power"),
    "band_share": (_answer_ring, "ratio"),
    "ring": (_answer_ring, "ratio"),
    "radius_of_paper": (lambda at: Answers(PAPER.ball_radius), "length"),
    "pull_force": (_answer_pull_force, "force"),
    "detectable_groove": (_answer_detectable_groove, "length"),
    "energy_ratio_of_tips": (_answer_energy_ratio, "ratio"),
    "gap_found": (_answer_gap_found, "ratio"),
}
_FIGURES = {"decay_time": "time", "share": "ratio", "frequency": "frequency"}  # of a ring


def find_dimension(question: str, at: At) -> str:
    """Return the dimension of the answers."""
    return _FIGURES.get(str(at.get("figure")), QUESTIONS[question][1])
