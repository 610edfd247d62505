"""The axis of energies of a set: targets that a hand drags, above the blocks that were found.

Every target is reached by the keyboard, and moved by its arrows.
"""

import math
from collections import Counter
from collections.abc import Callable, Sequence

from nicegui import events, ui

from stepblocks.quantities import format_number, format_units
from stepblocks.window import texts
from stepblocks.window.set_request import AxisMark, SetMarks, format_target

_LEVEL = 10.0  # decibels of a tenfold energy
_STEPS = {  # of a key [dB]: a just noticeable difference of energy is 1.5 dB
    "ArrowLeft": -0.1,
    "ArrowDown": -0.1,
    "ArrowRight": 0.1,
    "ArrowUp": 0.1,
    "PageDown": -1.5,
    "PageUp": 1.5,
}
_TAKE_AWAY = ("Delete", "Backspace")
_NEXT = 1.5  # by which an added target lies above the highest [dB]
_BESIDE = 2.0  # factor by which the axis goes beyond the outermost marks
_MICROJOULE = 1e-6  # [J]
_ROUND = (1.0, 2.0, 5.0)  # times powers of ten, at which the axis is marked
_ROWS = 3  # of labels, so that those of near blocks stand side by side
_PERIOD = 0.08  # between two places of a hand that are told [s]
_GRAB = """(event) => {
  const mark = event.target.closest('[data-target]');
  if (!mark) return;
  event.preventDefault();
  mark.focus();
  event.currentTarget.setPointerCapture(event.pointerId);
  emit(Number(mark.dataset.target));
}"""
_MOVE = """(event) => {
  if (!(event.buttons & 1)) return;
  const box = event.currentTarget.getBoundingClientRect();
  emit((event.clientX - box.left) / box.width);
}"""
_KEYS = """(event) => {
  const keys = %s;
  if (!keys.includes(event.key)) return;
  event.preventDefault();
  emit(event.key);
}"""


class TargetAxis:
    """The axis, with a mark for each target and each block.

    Parameters
    ----------
    on_change : callable
        Receives the energies of all targets [J] when a hand or a key has moved one.
    on_release : callable
        Called when a hand has let go.
    """

    def __init__(
        self, on_change: Callable[[list[float]], object], on_release: Callable[[], object]
    ) -> None:
        self._on_change = on_change
        self._on_release = on_release
        self._energies: list[float] = []
        self._marks: list[ui.element] = []
        self._held: int | None = None
        self._low, self._high = _MICROJOULE, 100.0 * _MICROJOULE
        with ui.element("div").classes("axis").mark("axis") as self._axis:
            self._scale = ui.element("div")
            self._targets = ui.element("div")
            self._blocks = ui.element("div").props("role=list").mark("blocks")
        self._axis.props(f'role=group aria-label="{texts.TARGET_AXIS}"')
        self._axis.on("pointerdown", self._hold_target, js_handler=_GRAB)
        self._axis.on("pointermove", self._move_held_target, throttle=_PERIOD, js_handler=_MOVE)
        self._axis.on("pointerup", self._release_held_target)
        self._axis.on("pointercancel", self._release_held_target)
        ui.label(texts.AXIS_ENERGY).classes("w-full text-center")

    @property
    def is_dragged_by_hand(self) -> bool:
        """Whether a hand holds a target."""
        return self._held is not None

    @property
    def energies(self) -> list[float]:
        """Energies of the targets [J], in the order in which they were first shown."""
        return list(self._energies)

    def show_marks(self, marks: SetMarks) -> None:
        """Show targets and blocks; targets that a hand has moved stay where they are."""
        if not self.is_dragged_by_hand:
            self._choose_axis_ends([*marks.targets, *marks.blocks])
            self._draw_ticks()
        self._show_targets([mark.energy for mark in marks.targets])
        self._mark_missed_targets(marks.targets)
        self._show_blocks(marks.blocks)

    def _choose_axis_ends(self, marks: Sequence[AxisMark]) -> None:
        """Let the axis go beyond all marks."""
        energies = [mark.energy for mark in marks if mark.energy > 0.0]
        if energies:
            self._low = min(energies) / _BESIDE
            self._high = max(energies) * _BESIDE

    def _compute_axis_share(self, energy: float) -> float:
        """Return where an energy [J] lies, as a share of the axis, 0 to 1."""
        share = math.log(max(energy, self._low) / self._low) / math.log(self._high / self._low)
        return min(share, 1.0)

    def _draw_ticks(self) -> None:
        """Draw a tick with its figure at each round energy."""
        self._scale.clear()
        with self._scale:
            for energy in list_round_energies(self._low, self._high):
                tick = ui.label(format_number(energy / _MICROJOULE)).classes("axis-tick")
                tick.style(f"left: {100.0 * self._compute_axis_share(energy):.2f}%")

    def _show_targets(self, energies: list[float]) -> None:
        """Put the marks of the targets where they are; they are made anew where one came or went.

        Marks stay otherwise: the one that is moved keeps the focus.
        """
        if len(energies) != len(self._energies):
            self._energies = energies
            self._remake_target_marks()
        elif not self.is_dragged_by_hand and _differ_in_written_digits(energies, self._energies):
            self._energies = energies
        self._place_target_marks()

    def _remake_target_marks(self) -> None:
        """Make a mark for each target."""
        self._targets.clear()
        self._marks = []
        keys = _KEYS % [*_STEPS, *_TAKE_AWAY]
        with self._targets:
            for number in range(len(self._energies)):
                mark = ui.element("div").classes("axis-target").mark(f"target-{number}")
                label = texts.TARGET.format(number=number + 1)
                mark.props(f'role=slider tabindex=0 data-target={number} aria-label="{label}"')
                mark.on("keydown", self._make_target_key_handler(number), js_handler=keys)
                self._marks.append(mark)

    def _place_target_marks(self) -> None:
        """Put each mark at its energy."""
        low, high = (format_number(end / _MICROJOULE) for end in (self._low, self._high))
        for energy, mark in zip(self._energies, self._marks, strict=True):
            now = format_number(energy / _MICROJOULE)
            text = format_units(format_target(energy))
            mark.style(f"left: {100.0 * self._compute_axis_share(energy):.2f}%")
            mark.props(f"aria-valuemin={low} aria-valuemax={high} aria-valuenow={now}")
            mark.props(f'aria-valuetext="{text}" title="{text}"')

    def _mark_missed_targets(self, targets: Sequence[AxisMark]) -> None:
        """Mark the targets that no block gives; the marks of the others lose that style."""
        missed = {format_target(target.energy) for target in targets if target.problem}
        for energy, mark in zip(self._energies, self._marks, strict=True):
            if format_target(energy) in missed:
                mark.classes(add="axis-missed")
            else:
                mark.classes(remove="axis-missed")

    def _show_blocks(self, blocks: Sequence[AxisMark]) -> None:
        """Show the blocks that were found, each with its size."""
        self._blocks.clear()
        with self._blocks:
            for number, block in enumerate(blocks):
                place = 100.0 * self._compute_axis_share(block.energy)
                shown = ui.element("div").classes("axis-block").props("role=listitem")
                shown.style(f"left: {place:.2f}%; --row: {number % _ROWS}")
                with shown:
                    ui.label(block.label)

    def _hold_target(self, event: events.GenericEventArguments) -> None:
        """Hold the target that a hand has come down on."""
        number = event.args
        if isinstance(number, int) and 0 <= number < len(self._energies):
            self._held = number

    def _move_held_target(self, event: events.GenericEventArguments) -> None:
        """Move the target that is held to a share of the axis."""
        share = event.args
        if self._held is None or not isinstance(share, int | float) or not math.isfinite(share):
            return
        share = min(max(float(share), 0.0), 1.0)
        self._set_target_energy(self._held, self._low * (self._high / self._low) ** share)

    def _release_held_target(self) -> None:
        """Let go of the target that is held."""
        if self._held is not None:
            self._held = None
            self._on_release()

    def _make_target_key_handler(
        self, target_index: int
    ) -> Callable[[events.GenericEventArguments], None]:
        """Return a handler of keys at a target, which move it or take it away."""

        def handle_key(event: events.GenericEventArguments) -> None:
            """Take the target away, or move it by a step."""
            key = str(event.args)
            if key in _TAKE_AWAY:
                self.remove_target(target_index)
            elif key in _STEPS and target_index < len(self._energies):
                factor = 10.0 ** (_STEPS[key] / _LEVEL)
                self._set_target_energy(target_index, self._energies[target_index] * factor)

        return handle_key

    def add_above_highest(self) -> None:
        """Add a target above the highest one."""
        highest = max(self._energies, default=_MICROJOULE)
        self._energies = [*self._energies, highest * 10.0 ** (_NEXT / _LEVEL)]
        self._remake_target_marks()
        self._place_target_marks()
        self._on_change(self.energies)

    def remove_target(self, target_index: int) -> None:
        """Remove the target of a number, counted from 0; the only one stays."""
        if len(self._energies) < 2 or target_index >= len(self._energies):
            return
        self._energies = [*self._energies[:target_index], *self._energies[target_index + 1 :]]
        self._remake_target_marks()
        self._place_target_marks()
        self._on_change(self.energies)

    def _set_target_energy(self, target_index: int, energy: float) -> None:
        """Move a target to an energy [J], and report all energies to `on_change`."""
        self._energies[target_index] = energy
        self._place_target_marks()
        self._on_change(self.energies)


def list_round_energies(low: float, high: float) -> list[float]:
    """List the energies between two [J] that are 1, 2 or 5 times a power of ten."""
    found = []
    for power in range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1):
        for factor in _ROUND:
            energy = factor * 10.0**power
            if low <= energy <= high:
                found.append(energy)
    return found


def _differ_in_written_digits(energies: Sequence[float], shown: Sequence[float]) -> bool:
    """Tell whether energies [J] differ from those shown, to the digits that are written."""
    return Counter(map(format_target, energies)) != Counter(map(format_target, shown))
