"""Effects that a plan plants into a simulated session."""

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

from pydantic import Field

from stepblocks.bench.calibration import Strict
from stepblocks.rig.effects.named import list_named_laws

# covariates that are numbers, and those that are labels
NUMBERS = (
    "height_um",
    "load_n",
    "speed_mm_s",
    "run_order",
    "temperature_c",
    "humidity_pct",
    "peak_force_n",
)
_LABELS = ("block", "operator", "tip", "day")

Source = Literal["equations", "drag"]  # of the truth of a session
Finite = Annotated[float, Field(ge=-1e9, le=1e9)]


class PlantedEffect(Strict):
    """A change of one slot of the model: a law of the catalogue, or a named form of one covariate.

    Attributes
    ----------
    law : str
        Of the catalogue, such as ``running_in``; slot and form are its own then.
    parameters : dict[str, float]
        Of the law, in SI; else where a search begins.
    slot : str, optional
        Part of the model: ``contact_geometry`` (radius of the ball plus that of the edge [m]),
        ``friction`` [1], ``normal_load`` [N], ``stiffness`` [N/m], ``conversion`` [1], ``drag`` (a
        force on the pull [N]), ``sensor`` (gain of the tangential channel [1]).
    change : Literal['add', 'multiply']
        As it is, or as 1 + change; a power that multiplies is the factor itself.
    form : Literal['constant', 'linear', 'power', 'exponential', 'levels']
    covariate : str
        A column of the table, ``peak_force_n`` of the nominal model, or ``none``.
    size : Finite
        This and the next in the units of slot and covariate.
    reference : Finite
    span : Finite
    exponent : Finite
    levels : dict[str, Finite]
        Change at each label of a covariate, 0 at one not named.
    """

    law: str = ""
    parameters: dict[str, float] = Field(default_factory=dict)
    slot: Literal[
        "contact_geometry",
        "friction",
        "normal_load",
        "stiffness",
        "conversion",
        "drag",
        "sensor",
        None,
    ] = None
    change: Literal["add", "multiply"] = "add"
    form: Literal["constant", "linear", "power", "exponential", "levels"] = "constant"
    covariate: str = "none"
    size: Finite = 1.0
    reference: Finite = 0.0
    span: Finite = 1.0
    exponent: Finite = 1.0
    levels: dict[str, Finite] = Field(default_factory=dict)

    def compute_changed_value(
        self, slot_value: float, conditions: Mapping[str, float | str]
    ) -> float:
        """Return the slot's value after the effect.

        Parameters
        ----------
        slot_value : float
            Of the slot, before.
        conditions : mapping
            Of the trial, by the names of covariates.
        """
        change = self._compute_slot_change(conditions.get(self.covariate, 0.0))
        if self.change == "add":
            return slot_value + change
        if self.form == "power":
            return slot_value * change
        return slot_value * (1.0 + change)

    def _compute_slot_change(self, covariate_value: float | str) -> float:
        """Return the change at a value of the covariate."""
        if self.form == "constant":
            return self.size
        if self.form == "levels":
            return self.levels.get(str(covariate_value), 0.0)
        number = float(covariate_value)
        if self.form == "linear":
            return self.size * (number - self.reference) / self.span
        if self.form == "power":
            return float(self.size * (number / self.reference) ** self.exponent)
        return self.size * math.exp(-(number - self.reference) / self.span)

    def find_plan_fault(
        self, effect_number: int, source: Source, blocks: Sequence[str]
    ) -> str | None:
        """Say which field breaks which rule.

        Parameters
        ----------
        effect_number : int
            Of the effect in its plan, from 1.
        source : str
            Of the truth of the plan.
        blocks : sequence of str
            Names of the blocks of the plan.

        Returns
        -------
        str or None
            None where all is well.
        """
        if self.law:
            return self._find_law_fault(effect_number, source, blocks)
        if self.slot is None:
            return f"slot of effect {effect_number} or law must be given"
        if source == "drag" and self.slot == "conversion":
            return (
                f"slot of effect {effect_number} must not be conversion where the drag in time "
                f"decides "
                "what rings"
            )
        return self._find_form_fault(effect_number)

    def _find_law_fault(
        self, effect_number: int, source: Source, blocks: Sequence[str]
    ) -> str | None:
        """Say what is wrong with an effect that is a law of the catalogue; see `find_fault`."""
        laws = {law.id: law for law in list_named_laws(blocks)}
        if self.law not in laws:
            known = ", ".join(laws)
            return f"law of effect {effect_number} must be one of {known}, got {self.law!r}"
        if self.law == "hardening_spring" and source != "drag":
            return (
                f"law of effect {effect_number} bends ramp and ring: source must be 'drag', "
                f"got {source!r}"
            )
        names = [parameter.name for parameter in laws[self.law].parameters]
        unknown = sorted(set(self.parameters) - set(names))
        if unknown or not self.parameters:
            got = ", ".join(unknown) or "none"
            return (
                f"parameters of effect {effect_number} must be among {', '.join(names)}, got {got}"
            )
        if self.slot:
            return f"slot of effect {effect_number} must be left out where a law is named"
        return None

    def _find_form_fault(self, effect_number: int) -> str | None:
        """Say what is wrong with the form of an effect or its covariate; see `find_fault`."""
        known: Sequence[str] = NUMBERS
        if self.form == "constant":
            known = ("none",)
        elif self.form == "levels":
            known = _LABELS
        if self.covariate == "none" and self.form != "constant":
            return (
                f"covariate of effect {effect_number} must have a covariate "
                f"unless its form is constant"
            )
        if self.covariate not in known:
            return (
                f"covariate of effect {effect_number} must be one of {', '.join(known)} "
                f"where its form is "
                f"{self.form}, got {self.covariate!r}"
            )
        if self.span == 0.0 or (self.form == "power" and self.reference == 0.0):
            return f"span and, of a power, reference of effect {effect_number} must not be 0"
        return None
