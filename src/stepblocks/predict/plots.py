"""Pictures of a set's predictions: energy against height with interval and locking limit, and the map of its margins."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stepblocks.contact.counterface import Step
from stepblocks.contact.operating_point import OperatingPoint
from stepblocks.contact.uncertainty import rectangular
from stepblocks.parts.set import StimulusSet, with_energy_tolerances
from stepblocks.predict.figures import draw_energy_of_height, draw_margin_map
from stepblocks.predict.margin_map import margin_map
from stepblocks.predict.predictions import tool_of


def write_plots(stimuli: StimulusSet, folder: Path) -> list[Path]:
    """Draw what a set predicts, for each of its tips and frictions under its largest load."""
    stimuli = with_energy_tolerances(stimuli)
    grid, tool = stimuli.prediction, tool_of(stimuli.prediction)
    load = max(grid.normal_loads)
    margins = (*stimuli.margin_block, *stimuli.crown_on_tooth)
    written: list[Path] = []
    for radius in grid.tip_radii:
        for friction in grid.frictions:
            name = f"R{radius * 1e6:g}.mu{friction:g}".replace("mu0.", "mu0p")
            if stimuli.step_block:
                path = folder / f"{stimuli.name}.energy-of-height.{name}.png"
                block = stimuli.step_block[0]
                point = OperatingPoint(radius, load, friction, tool)
                top = 1.25 * max(one.height.nominal for one in stimuli.step_block)
                marks = {one.id: one.height.nominal for one in stimuli.step_block}
                faces = [Step(height, block.edge_radius.nominal) for height in np.linspace(0.02 * top, top, 80)]
                draw_energy_of_height(faces, point, _uncertainty(stimuli, load), path, marks=marks)
                written.append(path)
            if margins:
                path = folder / f"{stimuli.name}.margin-map.{name}.png"
                gap = 1.25 * max(one.opening.nominal for one in margins)
                rise = 1.25 * max(*(abs(one.horizontal_discrepancy.nominal) for one in margins), 20e-6)
                table = margin_map(
                    np.linspace(0.0, max(gap, 100e-6), 76),
                    np.linspace(-rise, rise, 81),
                    radius,
                    load,
                    friction,
                    tool=tool,
                )
                places = {
                    one.id: (max(one.opening.nominal, 0.0), -one.horizontal_discrepancy.nominal) for one in margins
                }
                draw_margin_map(table, path, marks=places)
                written.append(path)
    return written


def _uncertainty(stimuli: StimulusSet, load: float) -> dict[str, float]:
    """Collect the standard uncertainties of the first block and of the setting."""
    off, tool, block = stimuli.prediction.tolerances, stimuli.prediction.tool, stimuli.step_block[0]
    return rectangular(
        {
            "height": 0.5 * (block.height.upper - block.height.lower),
            "edge_radius": 0.5 * (block.edge_radius.upper - block.edge_radius.lower),
            "ball_radius": off.tip_radius,
            "friction": off.friction,
            "normal_load": off.normal_load * load,
            "stiffness": off.stiffness * tool.stiffness,
            "conversion": off.conversion * tool.conversion,
        }
    )
