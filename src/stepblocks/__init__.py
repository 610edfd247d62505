"""Haptic step stimuli, asked for, shaped, made, checked, predicted, felt and explained.

The names below are the public face, in the order in which data walks through them:

- asked for: `load_set`, `StimulusSet`, `StepBlock`, `MarginBlock`, `CrownOnTooth`, `StraightTip`, `HookTip`,
  `Sheath`, `Dimension`;
- shaped: `build_solids`, `mesh_solid`, `convex_pieces`, `height_field`, `surface_height`;
- made: `build`, `BuildReport`;
- checked: `check_artefact`, `check_output`, `Verdict`, `solid_volumes`;
- predicted: `step_angle`, `groove_angle`, `margin_angles`, `release_at`, `Release`, `Status`, `Tool`, `PAPER_TOOL`, `predict_set`;
- and when something is wrong: `StepblocksError`; at the border of units: `parse_quantity`, `format_quantity`.

Importing this package imports nothing else; each name is loaded when it is first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from stepblocks.contact.critical_angle import groove_angle, margin_angles, step_angle
    from stepblocks.contact.energy import PAPER_TOOL, Release, Status, Tool, release_at
    from stepblocks.errors import StepblocksError
    from stepblocks.haptics.heightfield import height_field
    from stepblocks.haptics.mesh import mesh_solid
    from stepblocks.haptics.pieces import convex_pieces
    from stepblocks.metrology.artefacts import check_artefact
    from stepblocks.metrology.closed_forms import solid_volumes
    from stepblocks.metrology.verdict import Verdict
    from stepblocks.pipeline.build import BuildReport, build
    from stepblocks.pipeline.check import check_output
    from stepblocks.pipeline.predict import predict_set
    from stepblocks.quantities import format_quantity, parse_quantity
    from stepblocks.solids.build import build_solids
    from stepblocks.stimulus.block import StepBlock
    from stepblocks.stimulus.loader import load_set
    from stepblocks.stimulus.margin import CrownOnTooth, MarginBlock
    from stepblocks.stimulus.profile import surface_height
    from stepblocks.stimulus.set import StimulusSet
    from stepblocks.stimulus.sheath import Sheath
    from stepblocks.stimulus.tip import HookTip, StraightTip
    from stepblocks.stimulus.tolerance import Dimension

__version__ = "0.1.0"

__all__ = [
    "PAPER_TOOL",
    "BuildReport",
    "CrownOnTooth",
    "Dimension",
    "HookTip",
    "MarginBlock",
    "Release",
    "Sheath",
    "Status",
    "StepBlock",
    "StepblocksError",
    "StimulusSet",
    "StraightTip",
    "Tool",
    "Verdict",
    "build",
    "build_solids",
    "check_artefact",
    "check_output",
    "convex_pieces",
    "format_quantity",
    "groove_angle",
    "height_field",
    "load_set",
    "margin_angles",
    "mesh_solid",
    "parse_quantity",
    "predict_set",
    "release_at",
    "solid_volumes",
    "step_angle",
    "surface_height",
]

_HOMES = {
    "contact.critical_angle": ("groove_angle", "margin_angles", "step_angle"),
    "contact.energy": ("PAPER_TOOL", "Release", "Status", "Tool", "release_at"),
    "errors": ("StepblocksError",),
    "haptics.heightfield": ("height_field",),
    "haptics.mesh": ("mesh_solid",),
    "haptics.pieces": ("convex_pieces",),
    "metrology.artefacts": ("check_artefact",),
    "metrology.closed_forms": ("solid_volumes",),
    "metrology.verdict": ("Verdict",),
    "pipeline.build": ("BuildReport", "build"),
    "pipeline.check": ("check_output",),
    "pipeline.predict": ("predict_set",),
    "quantities": ("format_quantity", "parse_quantity"),
    "solids.build": ("build_solids",),
    "stimulus.block": ("StepBlock",),
    "stimulus.loader": ("load_set",),
    "stimulus.margin": ("CrownOnTooth", "MarginBlock"),
    "stimulus.profile": ("surface_height",),
    "stimulus.set": ("StimulusSet",),
    "stimulus.sheath": ("Sheath",),
    "stimulus.tip": ("HookTip", "StraightTip"),
    "stimulus.tolerance": ("Dimension",),
}


def __getattr__(name: str) -> Any:
    for home, names in _HOMES.items():
        if name in names:
            return getattr(import_module(f"stepblocks.{home}"), name)
    raise AttributeError(f"module 'stepblocks' has no attribute {name!r}")
