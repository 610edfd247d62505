from .artefacts.check import check_artefact as check_artefact
from .artefacts.heightfield import sample_height_field as sample_height_field
from .artefacts.step.check_step import check_step as check_step
from .bench.measure import measure_session as measure_session
from .build.check import check_output as check_output
from .build.run import (
    BuildReport as BuildReport,
    build_sets as build_sets,
)
from .contact.counterface import (
    Counterface as Counterface,
    Groove as Groove,
    Margin as Margin,
    Profile as Profile,
    Step as Step,
)
from .contact.critical_angle import (
    find_margin_angles as find_margin_angles,
    find_step_angle as find_step_angle,
)
from .contact.energy import Release as Release, Status as Status, find_release as find_release
from .contact.energy_change import find_energy_change as find_energy_change
from .contact.event import list_vibration_events as list_vibration_events
from .contact.laws import (
    ContactLaw as ContactLaw,
    FrictionLaw as FrictionLaw,
    Hertz as Hertz,
    LinearContact as LinearContact,
    Overtone as Overtone,
    Stribeck as Stribeck,
)
from .contact.operating_point import (
    PAPER as PAPER,
    Limits as Limits,
    OperatingPoint as OperatingPoint,
    Tool as Tool,
)
from .contact.uncertainty import estimate_interval as estimate_interval
from .declaration.read import load_set as load_set
from .declaration.set import StimulusSet as StimulusSet, register_kind as register_kind
from .drag.run import drag_over as drag_over
from .errors import ReadingWarning as ReadingWarning, StepblocksError as StepblocksError
from .files.layout import TableLayout as TableLayout
from .haptics.feel_page import write_feel_page as write_feel_page
from .haptics.renderer import Renderer as Renderer
from .inspect.budget import Instrument as Instrument
from .inspect.evaluation import EvaluationOptions as EvaluationOptions
from .inspect.many import inspect_many as inspect_many, write_many as write_many
from .inspect.report import write_inspection as write_inspection
from .inspect.run import inspect_scan as inspect_scan, inspect_standard as inspect_standard
from .lawsearch.explain import explain as explain
from .lawsearch.forward_model import Trials as Trials
from .lawsearch.law import Law as Law, Parameter as Parameter
from .loop.run import loop_session as loop_session
from .loop.session_check import check_session as check_session
from .loop.several import loop_sessions as loop_sessions
from .parts.kinds.crown_on_tooth import CrownOnTooth as CrownOnTooth
from .parts.kinds.margin import MarginBlock as MarginBlock
from .parts.kinds.scanned_margin import ScannedMargin as ScannedMargin
from .parts.kinds.sheath import Sheath as Sheath
from .parts.kinds.step_block import StepBlock as StepBlock
from .parts.kinds.tips import HookTip as HookTip, StraightTip as StraightTip
from .parts.shapes import (
    build_convex_pieces as build_convex_pieces,
    build_solids as build_solids,
    mesh_solid as mesh_solid,
)
from .parts.tolerance import Dimension as Dimension
from .parts.verdict import Verdict as Verdict
from .predict.dataset import (
    plot_predictions as plot_predictions,
    to_dataset as to_dataset,
)
from .predict.learned import predict_trials as predict_trials
from .predict.neighbours import compare_stimuli as compare_stimuli
from .predict.perception import (
    Discrimination as Discrimination,
    WeberFraction as WeberFraction,
    compute_jnd_distance as compute_jnd_distance,
    read_discrimination as read_discrimination,
)
from .predict.run import predict_set as predict_set
from .predict.set_design.result import SetDesign as SetDesign
from .predict.set_design.route import MakingRoute as MakingRoute
from .predict.set_design.run import design_set as design_set
from .predict.sweep.run import SweepResult as SweepResult, run_sweep as run_sweep
from .predict.table import predict_table as predict_table
from .quantities import format_quantity as format_quantity, parse_quantity as parse_quantity
from .records.as_built import read_as_built as read_as_built
from .records.laboratory import read_laboratory as read_laboratory
from .records.model import read_model as read_model
from .rehearse.many import Rehearsals as Rehearsals, simulate_sessions as simulate_sessions
from .rehearse.run import simulate_session as simulate_session
from .rig.effects.offered import offer_laws as offer_laws
from .scans.read import list_channels as list_channels, read_scan as read_scan
from .scans.scan import HeightMap as HeightMap, ScannedProfile as ScannedProfile
from .simulators.compare import compare_record as compare_record
from .simulators.export import export_scenes as export_scenes
from .study.analysis.exchange import share_study as share_study
from .study.conduct.run import open_run as open_run
from .study.conduct.training import (
    TrainingDay as TrainingDay,
    open_training as open_training,
    read_training as read_training,
)
from .study.design.optimal import place_heights as place_heights
from .study.design.placement import HeightDesign as HeightDesign
from .study.power import study_power as study_power
from .study.run import (
    analyse_study as analyse_study,
    design_study as design_study,
    simulate_study as simulate_study,
    write_sheets as write_sheets,
)
from .workshop.run import order_parts as order_parts

__version__: str
