"""What to measure next: settings that tell rival models apart, and the block that this takes."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stepblocks.lawsearch.discrimination import CRITERION, RankedSetting, Ranking, rank_settings
from stepblocks.lawsearch.findings import Explanation, Verdict
from stepblocks.lawsearch.fit import fit_without
from stepblocks.lawsearch.forward_model import Trials
from stepblocks.lawsearch.law import Law
from stepblocks.lawsearch.problem import Fit
from stepblocks.loop.bench_model import SessionModel
from stepblocks.loop.channels import PEAK_FORCE
from stepblocks.loop.declared_checks import CalibrationCheck
from stepblocks.loop.next_block import NextBlock
from stepblocks.loop.settings import CHOSEN, COUNTED, GONE, MOST_SETTINGS, SHOWN, build_setting_grid
from stepblocks.rig.state import DragState

NOTHING = "nothing"  # what an effect is distinguished from that has no rival
_SLIPS = 1.1  # ratio of the release force to that of sliding, from which a tip slips
_FRICTION_RANGE = (0.01, 0.9)  # that a stimulus file takes
_WRITE_DOWN = "write down what differs between these trials: who, when, which tip and which batch"
_WEIGH_FIRST = "no drag tells a wrong spring, speed, gain or load apart: weigh them"
_CHECK_INSTRUMENT = (
    "check the instrument first: tare both gauges, hang a known weight on each, and repeat ten "
    "trials of the first setting"
)
_OUT_OF_REACH = "no setting within reach tells these apart"


@dataclass(frozen=True)
class NextExperiment:
    """What to measure next.

    Attributes
    ----------
    separates : tuple[str, ...]
        Names of the effects that it distinguishes, or sentences of what differs between trials.
    calibration : tuple[str, ...] | None
        What to do on the bench; None where only a note is given.
    note : str
        Why no trials are asked for tomorrow; empty where they are.
    trials : tuple[RankedSetting, ...]
        Settings, best first.
    repeats : int
        Trials at the best setting that are decisive; 0 where no number of trials is.
    width_after : Mapping[str, float]
        Expected width of the interval of each parameter, as a share of the width now.
    channel : str
        Channel that tells most.
    block : NextBlock | None
        Where the best setting has a height that no block has.
    """

    separates: tuple[str, ...]
    calibration: tuple[str, ...] | None = None
    note: str = ""
    trials: tuple[RankedSetting, ...] = ()
    repeats: int = 0
    width_after: Mapping[str, float] = field(default_factory=dict)
    channel: str = ""
    block: NextBlock | None = None

    @property
    def rows(self) -> list[dict[str, float | str]]:
        """Settings with their expected gains, as rows of a table."""
        rows = []
        for trial in self.trials:
            rows.append({**trial.settings, "expected_gain": trial.expected_gain})
        return rows

    def as_json(self) -> dict[str, object]:
        """Return the form in JSON, with the keys of what is asked for alone."""
        form: dict[str, object] = {"separates": self.separates}
        if not self.trials:
            form["trials"] = []
            if self.calibration is not None:
                form["calibration"] = self.calibration
            form["note"] = self.note
            return form
        form["calibration"] = self.calibration
        form["criterion"] = CRITERION
        form["trials"] = self.rows
        form["repeats"] = self.repeats
        form["width_after"] = self.width_after
        form["channel"] = self.channel
        if self.note:
            form["note"] = self.note
        if self.block is not None:
            form["block"] = self.block
        return form


class _RivalModels(NamedTuple):
    """Two models that are to be distinguished, the effect that differs in each, and its name."""

    effect: Law
    rival: str
    first: Fit
    second: Fit


def propose_experiment(
    explanation: Explanation, checks: Sequence[CalibrationCheck] = ()
) -> NextExperiment | None:
    """Propose settings that separate the rivals best.

    Parameters
    ----------
    explanation : Explanation
    checks : sequence of CalibrationCheck
        Declarations that the records contradict come first: nothing is known better than they.

    Returns
    -------
    NextExperiment or None
        None where nothing is open.
    """
    weighings: tuple[str, ...] = ()
    suspects: tuple[str, ...] = ()
    for check in checks:
        if check.is_open:
            weighings += (check.quantity.advice,)
            suspects += (check.sentence,)
    models = _choose_rival_models(explanation)
    if models is None:
        if weighings and not explanation.hints:
            return NextExperiment(suspects, weighings, _WEIGH_FIRST)
        if not explanation.hints:
            return None
        sentences = tuple(explanation.hint_sentences)
        return NextExperiment(sentences, weighings or None, _WRITE_DOWN)
    separates = models.effect.id, models.rival
    checks_of_doubt = _list_instrument_checks(explanation)
    moves = tuple(dict.fromkeys((*weighings, *checks_of_doubt, *_list_bench_advice(explanation))))
    trials = explanation.problem.trials
    extra = _list_varied_covariates(trials, models)
    grid = build_setting_grid(trials, extra)
    state = _compute_state(explanation, grid, models.first)
    feasible = _find_feasible_settings(explanation, models, grid, state)
    ranking: Ranking | None = None
    if feasible.any():
        ranking = rank_settings(
            explanation.problem, models.first, models.second, grid.take(feasible), (*SHOWN, *extra)
        )
    if ranking is None:
        return NextExperiment(separates, moves, _OUT_OF_REACH)
    block = _design_next_block(trials, state, ranking.settings[0])
    note = ""
    if not 0 < ranking.repeats <= len(trials):
        # what it would take is said, and not asked for
        note = _describe_unaffordable_trials(ranking, trials)
        moves = moves or _list_calibration_advice(explanation)
        block = None
    return NextExperiment(
        separates=separates,
        calibration=moves,
        note=note,
        trials=ranking.settings,
        repeats=ranking.repeats,
        width_after=ranking.width_after,
        channel=ranking.channel,
        block=block,
    )


def _list_instrument_checks(explanation: Explanation) -> tuple[str, ...]:
    """List what to check of the instrument before anything else where a finding is doubtful."""
    doubtful = {Verdict.UNEXPLAINED, Verdict.AMBIGUOUS}
    if any(finding.verdict in doubtful for finding in explanation.findings):
        return (_CHECK_INSTRUMENT,)
    return ()


def _list_calibration_advice(explanation: Explanation) -> tuple[str, ...]:
    """List checks of the bench that tell more than drags: scans, weights, the spring."""
    model = explanation.problem.model
    assert isinstance(model, SessionModel)
    ways = []
    if not model.scanned:
        ways.append("scan the edges of the blocks")
    if "load_bias_n" not in model.known:
        ways.append("weigh the weights and put them on the normal gauge")
    if "spring_constant" not in model.known:
        ways.append("have the spring certified, or hang a known weight on it")
    return tuple(ways)


def _describe_unaffordable_trials(ranking: Ranking, trials: Trials) -> str:
    """Say why no trials are proposed: a session has fewer than would be needed."""
    needed = "no number of trials is enough"
    if ranking.repeats:
        needed = f"{ranking.repeats} trials would be needed, this session has {len(trials)}"
    return f"no affordable experiment separates these: {needed}"


def _choose_rival_models(explanation: Explanation) -> _RivalModels | None:
    """Choose the two models to distinguish: an effect and its first rival, or with and without it.

    The result is None where there is no finding.
    """
    if not explanation.findings:
        return None
    for finding in explanation.findings:
        if finding.rivals:
            rival = finding.rivals[0]
            return _RivalModels(finding.effect, rival.effect.id, explanation.extended, rival.fitted)
    # without rivals the effect that is known least is to be confirmed
    finding = min(explanation.findings, key=lambda f: (f.effect.named, f.gain))
    without = fit_without(explanation.problem, explanation.extended, finding.effect)
    return _RivalModels(finding.effect, NOTHING, explanation.extended, without)


def _list_bench_advice(explanation: Explanation) -> tuple[str, ...]:
    """List, each once, what to do on the bench to decide among the effects and their rivals."""
    moves: dict[str, None] = {}
    for finding in explanation.findings:
        for law in finding.laws:
            if law.how_to_decide:
                moves[law.how_to_decide] = None
    return tuple(moves)


def _list_varied_covariates(trials: Trials, models: _RivalModels) -> list[str]:
    """List the covariates of the effects that can be set, beside height, load and speed."""
    followed = {law.covariate for law in (*models.first.effects, *models.second.effects)}
    varied = []
    for name, column in trials.covariates.items():
        if name not in followed or name in (*SHOWN, *GONE):
            continue
        if name in (*COUNTED, *CHOSEN) or len(np.unique(column)) <= MOST_SETTINGS:
            varied.append(name)
    return sorted(varied)


def _compute_state(explanation: Explanation, grid: Trials, fitted: Fit) -> DragState:
    """Compute the state of a fitted model at all settings of a grid."""
    model = explanation.problem.model
    assert isinstance(model, SessionModel)
    return model.compute_state(grid, explanation.extended.values, fitted.active_effects)


def _find_feasible_settings(
    explanation: Explanation, models: _RivalModels, grid: Trials, state: DragState
) -> NDArray[np.bool_]:
    """Find the settings at which the tip slips, at a force that the bench has shown."""
    highest_force = np.exp(explanation.extended.predicted[:, PEAK_FORCE]).max()
    force = state.compute_peak_force()
    slips = ~state.mark_locked_trials() & (force > _SLIPS * state.compute_sliding_force())
    feasible = np.asarray(slips & (force <= highest_force))
    if models.effect.covariate == "block":
        # no other block tells of it
        feasible &= np.isin(grid.block, models.effect.specimens)
    return feasible


def _design_next_block(
    trials: Trials, state: DragState, setting: RankedSetting
) -> NextBlock | None:
    """Design the block of the best setting, or None where there is one of its height."""
    height = float(setting.settings["height_um"])
    if height in trials.covariates["height_um"]:
        return None
    tip_radius = np.median(np.asarray(trials.covariates["tip_radius_um"], float))
    friction = np.clip(np.median(state.friction), *_FRICTION_RANGE)
    return NextBlock(
        name=f"step-{height:03.0f}",
        height=f"{height:g} um",
        tip=f"{tip_radius:g} um",
        friction=f"{friction:.3f}",
    )


def format_block_stimulus(experiment: NextExperiment | None) -> str | None:
    """Write the stimulus file of the block that an experiment requires.

    Returns
    -------
    str or None
        A file as `stepblocks build` reads it; None where no block is asked for.
    """
    if experiment is None or experiment.block is None:
        return None
    block = experiment.block
    return (
        'schema = 1\nset = "next-block"\n'
        f'title = "The block that would separate {" from ".join(experiment.separates)} best"\n'
        'source = "next experiment of stepblocks loop"\n\n'
        f'[prediction]\ntip_radii = ["{block.tip}"]\n'
        f"normal_loads = [{_format_loads(experiment.trials)}]\n"
        f"frictions = [{block.friction}]\n\n"
        f'[[step_block]]\nid = "{block.name}"\nheight = {{ nominal = "{block.height}", '
        f'tolerance = "1 um" }}\n'
    )


def _format_loads(trials: Sequence[RankedSetting]) -> str:
    """Write the loads of some settings as quantities, the least first."""
    loads = sorted({float(trial.settings["load_n"]) for trial in trials})
    return ", ".join(f'"{load:g} N"' for load in loads)
