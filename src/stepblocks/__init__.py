"""Haptic step stimuli, asked for, shaped, made, checked, predicted, felt and explained.

Everything a command does, a notebook can. The names below are the public face, in the order in
which data walks through them:

- asked for: `load_set`, `StimulusSet`, `StepBlock`, `MarginBlock`, `CrownOnTooth`, `ScannedMargin`, `StraightTip`, `HookTip`,
  `Sheath`, `Dimension`; `register_kind` for a kind of one's own;
- shaped: `build_solids`, `mesh_solid`, `build_convex_pieces`, `height_field`;
- made and checked: `build_sets`, `BuildReport`, `check_output`, `check_artefact`, `check_step`, `Verdict`, `order_parts`;
- met by a slider: `Counterface`, `Step`, `Margin`, `Groove`, `Profile`, under an `OperatingPoint` with its `Tool`; the paper's
  is `PAPER`;
- predicted: `compute_step_angle`, `compute_margin_angles`, `release_at`, `Release`, `Status`, `interval_of`, `energy_change`,
  `predict_set`, `predict_table`, `predict_trials`, `sweep`, `drag_over`, `vibration_events`;
- felt: `export`, `simulate_sensation`, `compare`, `Renderer`;
- measured: `read_scan`, `list_channels`, `inspect_scan`, `inspect_standard`, `inspect_many`, `EvaluationOptions`, `write_inspection`, `write_many`,
  `read_as_built`, `measure`, `simulate_session`;
- explained: `loop_session`, `loop_sessions`, `read_model`; held against what others published: `hold_against_evidence`;
- judged by people: `design_study`, `write_sheets`, `open_run`, `simulate_study`, `analyse_study`, `share_study`, `study_power`,
  `start_adaptive`;
- and when something is wrong: `StepblocksError`; at the border of units: `parse_quantity`, `format_quantity`.

Importing this package imports nothing heavy; each name is loaded when it is first used (its home
stands in ``__init__.pyi``).
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
