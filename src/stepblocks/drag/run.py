"""One drag from the command line: a step or a profile in, traces, figures and a summary out."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

from stepblocks.atomic import replace_text
from stepblocks.contact.energy import Status, release_at
from stepblocks.contact.operating_point import PAPER, Tool
from stepblocks.drag.kernels import COLUMNS
from stepblocks.drag.model import DragSettings, Probe, probe_of_frequency
from stepblocks.drag.ring import ring_of
from stepblocks.drag.simulate import DragTrace, drag
from stepblocks.drag.subject import subject_of
from stepblocks.drag.track import Track
from stepblocks.errors import PipelineError, QuantityError
from stepblocks.quantities import parse_quantity
from stepblocks.tables import write_table

_OF_THE_SUBJECT = (
    "tip_radius",
    "edge_radius",
    "step_height",
    "load",
    "friction",
    "stiffness",
    "frequency",
    "damping_ratio",
)


def drag_from_options(
    stimulus: str, options: dict[str, tuple[str | None, str]], backward: bool, folder: Path, where: Path | None = None
) -> dict[str, Any]:
    """Run a drag whose parameters are texts."""
    given = {name: _quantity(name, text, dimension) for name, (text, dimension) in options.items() if text is not None}
    for name in ("pull", "speed"):
        if given.get(name, 1.0) <= 0.0:
            raise PipelineError(f"--{name} must be positive, got {options[name][0]}")
    chosen = {name: given[name] for name in _OF_THE_SUBJECT if name in given}
    subject = subject_of(stimulus, chosen, backward, where)
    values, pull = subject.values, given.get("pull", 0.0)
    probe = probe_of_frequency(
        values["frequency"], values["tip_radius"], values["stiffness"], damping_ratio=values["damping_ratio"]
    )
    settings = DragSettings(
        values["load"],
        values["friction"],
        speed=0.0 if pull else given.get("speed", 5e-3),
        pulling_force=pull,
        handle_mass=given["handle_mass"] if pull else 0.0,
        handle_damping=20.0 if pull else 0.0,
        static_friction=given["static_friction"],
        ring_time=given["ring_time"],
        sample_rate=given["sample_rate"],
    )
    return drag_to_folder(subject.track, subject.angle, probe, settings, folder, f"Drag over {subject.name}")


def _quantity(name: str, text: str, dimension: str) -> float:
    try:
        return parse_quantity(text, dimension)
    except QuantityError as error:
        raise PipelineError(f"--{name.replace('_', '-')} {error}") from error


def drag_to_folder(
    track: Track, angle: float | None, probe: Probe, settings: DragSettings, folder: Path, title: str = ""
) -> dict[str, Any]:
    """Simulate a drag and leave ``trace.csv``, ``drag.json``, ``force.png`` and, after a release, ``spectra.png``."""
    import pandas as pd

    from stepblocks.drag.figures import draw_force, draw_spectra

    trace = drag(track, probe, settings)
    summary = _summary(trace, angle, title)
    folder.mkdir(parents=True, exist_ok=True)
    write_table(pd.DataFrame(trace.rows, columns=list(COLUMNS)), folder / "trace.csv")
    draw_force(trace, folder / "force.png", title)
    if trace.status is Status.RELEASES:
        draw_spectra(trace, folder / "spectra.png", title)
    replace_text(folder / "drag.json", json.dumps(summary, indent=1, sort_keys=True) + "\n")
    return summary


def _summary(trace: DragTrace, angle: float | None, name: str) -> dict[str, Any]:
    summary: dict[str, Any] = {
        "subject": name,
        "status": str(trace.status),
        "ledger_j": trace.ledger,
        "ledger_error": trace.ledger_error,
        "time_step_s": trace.time_step,
        "probe": asdict(trace.probe),
        "settings": asdict(trace.settings),
    }
    if trace.status is Status.RELEASES:
        ring = ring_of(trace)
        summary |= {
            "peak_force_n": trace.peak_force,
            "release_time_s": trace.release_time,
            "stored_energy_j": trace.stored_energy,
            "vibration_energy_j": ring.energy,
            "ring_share": ring.share,
            "ring_duration_s": ring.duration,
            "ring_decay_time_s": None if math.isnan(ring.decay_time) else ring.decay_time,
            "ring_frequency_hz": ring.frequency,
            "loading_share_0_100_hz": ring.loading_share,
            "vibration_share_250_350_hz": ring.ring_band_share,
        }
    if angle:
        tool = Tool(
            trace.probe.stiffness, PAPER.tool.conversion, PAPER.tool.ring_duration, PAPER.tool.detection_threshold
        )
        formula = release_at(angle, trace.settings.normal_load, trace.settings.friction, tool)
        summary["equation_1"] = {"status": str(formula.status)}
        if formula.status is Status.RELEASES:
            summary["equation_1"] |= {
                "peak_force_n": formula.pull_force,
                "vibration_energy_j": formula.vibration_energy,
            }
    return summary
