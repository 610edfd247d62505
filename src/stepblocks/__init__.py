"""Haptic step stimuli, asked for, shaped, made, checked, predicted, felt and explained.

The names below are the public face, in the order in which data walks through them:

- asked for: `load_set`, `StimulusSet`, `StepBlock`, `MarginBlock`, `CrownOnTooth`, `StraightTip`, `HookTip`,
  `Sheath`, `Dimension`;
- shaped: `build_solids`, `mesh_solid`, `convex_pieces`, `height_field`;
- made: `build`, `BuildReport`, `workshop`;
- checked: `check_artefact`, `check_output`, `check_step`, `Verdict`, `solid_volumes`;
- felt: what is met, `Counterface`, `Step`, `Margin`, `Profile`; under what, `OperatingPoint`, `Tool`, `PAPER`; and how,
  `step_angle`, `groove_angle`, `margin_angles`, `release_at`, `Release`, `Status`, `interval_of`, `energy_change`;
- predicted: `predict_set`, `predict_table`, `sweep`, and in time `drag_over`;
- for the simulator: `export`, `feel`, `Renderer`, `vibration_events`;
- and when something is wrong: `StepblocksError`; at the border of units: `parse_quantity`, `format_quantity`.

Importing this package imports nothing heavy; each name is loaded when it is first used (its home stands in ``__init__.pyi``).
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
