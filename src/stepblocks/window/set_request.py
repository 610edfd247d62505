"""What the answers of the page of a set ask of `design_set`, and what that finds for its axis."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import PurePosixPath
from typing import TYPE_CHECKING, Any

from stepblocks.errors import PipelineError
from stepblocks.mistakes import shorten_value
from stepblocks.quantities import format_number
from stepblocks.window import texts
from stepblocks.window.command_form import split_at_commas
from stepblocks.window.folder import Folder

if TYPE_CHECKING:
    from stepblocks.predict.set_design.result import SetDesign

FIRST_KIND = "step_block"
_AS_GIVEN = ("lowest", "highest", "apart", "base")  # answers that the function takes as texts
_QUICK = "formula"  # the model that takes milliseconds
_MICROJOULE = 1e-6  # [J]
_MICROMETRE = 1e-6  # [m]


@dataclass(frozen=True)
class SetRequest:
    """What the answers ask for, as `design_set` takes it.

    Attributes
    ----------
    name : str
        Of the set.
    targets : list of str
    options : dict
        Keywords of the function.
    route : dict
        Kind and step of `MakingRoute`, where either was said.
    """

    name: str
    targets: list[str]
    options: dict[str, Any] = field(default_factory=dict)
    route: dict[str, str] = field(default_factory=dict)


def keep_filled_answers(answers: Mapping[str, str]) -> dict[str, str]:
    """Return the answers that say something, without blanks around them."""
    filled = {}
    for name, text in answers.items():
        if text.strip():
            filled[name] = text.strip()
    return filled


def read_set_request(answers: Mapping[str, str]) -> SetRequest:
    """Read the answers of the form of a set.

    Raises
    ------
    PipelineError
        If an answer that must be a number is none.
    """
    filled = keep_filled_answers(answers)
    options: dict[str, Any] = {}
    for name in _AS_GIVEN:
        if name in filled:
            options[name] = filled[name]
    if "number" in filled:
        options["number"] = _read_number_answer(filled, "number", int)
    conditions: dict[str, object] = {}
    if "friction" in filled:
        conditions["frictions"] = [_read_number_answer(filled, "friction", float)]
    if "load" in filled:
        conditions["normal_loads"] = [filled["load"]]
    if conditions:
        options["prediction"] = conditions
    route = {}
    if "kind" in filled or "step" in filled:
        route["kind"] = filled.get("kind", FIRST_KIND)
    if "step" in filled:
        route["step"] = filled["step"]
    targets = []
    if "targets" in filled:
        targets = split_at_commas(filled["targets"])
    return SetRequest(PurePosixPath(filled.get("file", "")).stem, targets, options, route)


def _read_number_answer(
    filled: Mapping[str, str], name: str, parse: Callable[[str], int | float]
) -> int | float:
    """Read an answer that must be a number; `parse` is that of its type."""
    try:
        return parse(filled[name])
    except ValueError as error:
        what = texts.WHOLE_NUMBER if parse is int else texts.ANY_NUMBER
        raise PipelineError(
            texts.NO_NUMBER.format(name=name, what=what, value=shorten_value(filled[name]))
        ) from error


@dataclass(frozen=True)
class AxisMark:
    """A target or a block on the axis of energies.

    Attributes
    ----------
    energy : float
        [J].
    label : str
        What was asked for, or the size of the block.
    problem : str
        Why no block gives the target; empty where one does, and of a block.
    """

    energy: float
    label: str
    problem: str = ""


@dataclass(frozen=True)
class SetMarks:
    """The targets of a set and the blocks that were found for them, by rising energy."""

    targets: tuple[AxisMark, ...]
    blocks: tuple[AxisMark, ...]


def design_and_list_marks(
    answers: Mapping[str, str], folder: Folder, *, is_quick: bool
) -> SetMarks:
    """Design a set by the answers, as the command does, and return its targets and blocks.

    Parameters
    ----------
    answers : mapping
        By the names of the questions.
    folder : Folder
        Where the file is that stands for what is not said.
    is_quick : bool
        By the formula alone; else by the drag in time where it differs, as the command decides.

    Raises
    ------
    StepblocksError
        If something cannot be read, or no target can be reached.
    """
    from stepblocks.predict.set_design.route import MakingRoute
    from stepblocks.predict.set_design.run import design_set

    request = read_set_request(answers)
    options = dict(request.options)
    if "base" in options:
        options["base"] = folder.resolve(options["base"])
    if request.route:
        options["route"] = MakingRoute(**request.route)
    if is_quick:
        options["model"] = _QUICK
    return list_axis_marks(design_set(request.name or FIRST_KIND, request.targets, **options))


def list_axis_marks(design: "SetDesign") -> SetMarks:
    """List the targets and blocks of a designed set."""
    targets = [AxisMark(block.target_energy, block.wanted) for block in design.blocks]
    for miss in design.missed:
        targets.append(AxisMark(miss.target.energy, miss.target.wanted, miss.describe()))
    targets.sort(key=lambda mark: mark.energy)
    blocks = []
    for block in design.blocks:
        size = texts.BLOCK_SIZE.format(size=format_number(block.size / _MICROMETRE))
        blocks.append(AxisMark(block.energy, size))
    return SetMarks(tuple(targets), tuple(blocks))


def format_target(energy: float) -> str:
    """Write an energy [J] as the command takes a target."""
    return f"{format_number(energy / _MICROJOULE)} uJ"
