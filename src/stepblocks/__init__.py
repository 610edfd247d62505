"""Haptic step stimuli: declared, built, checked, predicted, rendered, measured and explained.

Everything that a command does is also a function. The public names, in the order of the work:

- declare: `load_set`, `StimulusSet`, `StepBlock`, `MarginBlock`, `CrownOnTooth`, `ScannedMargin`,
  `StraightTip`, `HookTip`, `Sheath`, `Dimension`; `register_kind` for a kind of your own;
- shape: `build_solids`, `mesh_solid`, `build_convex_pieces`, `sample_height_field`;
- build and check: `build_sets`, `BuildReport`, `check_output`, `check_artefact`, `check_step`,
  `Verdict`, `order_parts`;
- contact: `Counterface`, `Step`, `Margin`, `Groove`, `Profile`, under an `OperatingPoint` with its
  `Tool` and its `Limits`; the paper's is `PAPER`;
- laws of friction, contact and tool: `FrictionLaw`, `Stribeck`, `ContactLaw`, `Hertz`,
  `LinearContact`, `Overtone`;
- predict: `find_step_angle`, `find_margin_angles`, `find_release`, `Release`, `Status`,
  `estimate_interval`, `find_energy_change`, `predict_set`, `predict_table`, `predict_trials`,
  `to_dataset`, `plot_predictions`, `run_sweep`, `SweepResult`, `drag_over`,
  `list_vibration_events`; the other way round, `design_set` with a `MakingRoute` gives a
  `SetDesign`;
- told apart by a person: `compare_stimuli`, `compute_jnd_distance`, `Discrimination`,
  `WeberFraction`, `read_discrimination`;
- render: `export_scenes`, `write_feel_page`, `compare_record`, `Renderer`;
- measure: `read_scan`, `ScannedProfile`, `HeightMap`, `list_channels`, `inspect_scan`,
  `inspect_standard`, `inspect_many`, `EvaluationOptions`, `Instrument`, `read_laboratory`,
  `write_inspection`, `write_many`, `read_as_built`, `check_session`, `measure_session`,
  `simulate_session`, `simulate_sessions`, `Rehearsals`;
- explain: `loop_session`, `loop_sessions`, `read_model`, `offer_laws`; a model of your own:
  `explain` with its `Trials` and each `Law` with its `Parameter`;
- experiments: `design_study`, `write_sheets`, `open_run`, `simulate_study`, `analyse_study`,
  `share_study`, `study_power`, `place_heights` (`HeightDesign`); training:
  `open_training`, `read_training`, `TrainingDay`;
- errors: `StepblocksError`; what a reader found out about a file: `ReadingWarning`, what it need
  not find out: `TableLayout`; units at the border: `parse_quantity`, `format_quantity`.

Importing this package imports nothing heavy; each name is loaded when it is first used
(``__init__.pyi`` says where it lives).
"""

import lazy_loader

__version__ = "1.0.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
