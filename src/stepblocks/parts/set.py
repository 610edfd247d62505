"""A stimulus set: everything one file declares; and the list of the kinds that a file may hold."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, Field, create_model

from stepblocks.contact.operating_point import PAPER
from stepblocks.contact.rod import RodRing
from stepblocks.errors import StimulusError
from stepblocks.parts.conditions import (
    PAPER_STEPS,
    DampingRig,
    OrderSpec,
    PredictionGrid,
    ProbeSpec,
)
from stepblocks.parts.declared import Identity, Table, rules_validator
from stepblocks.parts.kind import Part
from stepblocks.parts.kinds.crown_on_tooth import CrownOnTooth
from stepblocks.parts.kinds.margin import MarginBlock
from stepblocks.parts.kinds.scanned_margin import ScannedMargin
from stepblocks.parts.kinds.sheath import Sheath
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.kinds.tips import HookTip, StraightTip

# The kinds, in the order in which a set holds them; a new one stands here
SHIPPED: tuple[type[Part], ...] = (
    StepBlock,
    MarginBlock,
    CrownOnTooth,
    ScannedMargin,
    StraightTip,
    HookTip,
    Sheath,
)
_more: list[type[Part]] = []


def list_kinds() -> dict[str, type[Part]]:
    """Return the kinds that stimulus files may declare, by the names of their stanzas."""
    return {kind.stanza: kind for kind in (*SHIPPED, *_more)}


@contextmanager
def register_kind(kind: type[Part]) -> Iterator[None]:
    """Let stimulus files declare a kind that is not shipped, for as long as the context lasts.

    Parameters
    ----------
    kind : type of Part
        See `Part` for what it answers.

    Yields
    ------
    None
        While it is known.

    Raises
    ------
    StimulusError
        If another kind has stanzas of that name, or it cannot be the name of one.
    """
    taken = {*list_kinds(), *StimulusSet.model_fields, "schema", "set", "defaults"}
    if not kind.stanza.isidentifier() or kind.stanza in taken:
        raise StimulusError(f"stanza must be a new name, got {kind.stanza!r} [{kind.__name__}]")
    _more.append(kind)
    try:
        yield
    finally:
        _more.remove(kind)


class StimulusSet(Table):
    """Everything one stimulus file declares.

    Attributes
    ----------
    name : str
        Name of the set and of its file.
    title : str
        What it is, for the page.
    source : str
        Where it comes from.
    prediction : PredictionGrid
        Conditions under which it is predicted.
    stimuli : tuple of Part
        All parts, in the order of the kinds; the parts of one kind are also an attribute with the
        name of its stanza, such as ``step_block``.
    order : OrderSpec
        Author, date, revision and quantity, for the drawings.
    probe : ProbeSpec or None
        Probe that the sheaths are made for.
    damping_rig : DampingRig or None
        Rig on which the ring of the probe is measured.
    """

    name: Identity
    title: Annotated[str, Field(min_length=1, max_length=200)]
    source: Annotated[str, Field(max_length=500)] = ""
    prediction: PredictionGrid = PredictionGrid()
    stimuli: tuple[Part, ...]
    order: OrderSpec = OrderSpec()
    probe: ProbeSpec | None = None
    damping_rig: DampingRig | None = None

    def __getattr__(self, name: str) -> tuple[Any, ...]:
        """Parts of one kind, by the name of its stanza."""
        if name not in list_kinds():
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")
        return tuple(part for part in self.stimuli if part.stanza == name)

    def with_parts(self, parts: Iterable[Part]) -> Self:
        """Return the set with other parts under the same conditions."""
        return self.model_copy(update={"stimuli": tuple(parts)})

    def ring_of(self, part: Part) -> RodRing | None:
        """Predict how the probe rings with a part on its shank; None where it wears none."""
        sleeve = part.sleeve
        return None if sleeve is None or self.probe is None else self.probe.ring(sleeve)

    def grid_of(self, part: Part) -> PredictionGrid:
        """Return the conditions of a part; a sheath changes the stiffness of the probe."""
        ring = self.ring_of(part)
        if ring is None:
            return self.prediction
        tool = self.prediction.tool.model_copy(update={"stiffness": ring.stiffness})
        return self.prediction.model_copy(update={"tool": tool})

    @rules_validator
    def _parts_suit_the_conditions(self) -> Iterator[str]:
        counts = Counter(part.id for part in self.stimuli)
        for name in (counts - Counter(set(counts))).elements():
            yield f"id must be unique in its set, got {name!r} twice"
        if not all(part.crossed for part in self.stimuli) and not self.prediction.step_heights:
            yield "prediction.step_heights must be given for a set with tips or sheaths, got none"
        if any(part.ball is None for part in self.stimuli) and not self.prediction.tip_radii:
            yield (
                "prediction.tip_radii must be given for a set with blocks, crowns or sheaths, "
                "got none"
            )
        given = {"probe": self.probe, "damping_rig": self.damping_rig}
        yield next((line for part in self.stimuli for line in part.lacks(given)), "")
        if not self.stimuli:
            yield "a set must declare at least one stimulus, got none"


def make_file_model() -> type[Table]:
    """Make the model of a file: the fields of a set, and a list of tables for each kind."""
    fields: dict[str, Any] = {
        name: (field.annotation, field) for name, field in StimulusSet.model_fields.items()
    }
    fields.pop("stimuli")
    for stanza, kind in list_kinds().items():
        fields[stanza] = (Annotated[tuple[kind, ...], BeforeValidator(kind.prepare_stanzas)], ())  # type: ignore[valid-type]
    return create_model("StimulusFile", __base__=Table, **fields)


def validate_set(declared: Mapping[str, object]) -> StimulusSet:
    """Validate what a file declares; tips and steps that it leaves out are those of the paper."""
    values = dict(make_file_model().model_validate(declared))
    parts = tuple(part for stanza in list_kinds() for part in values.pop(stanza))
    grid: PredictionGrid = values["prediction"]
    more: dict[str, tuple[float, ...]] = {}
    if any(part.ball is None for part in parts) and not grid.tip_radii:
        more["tip_radii"] = (PAPER.ball_radius,)
    if not all(part.crossed for part in parts) and not grid.step_heights:
        more["step_heights"] = PAPER_STEPS
    return StimulusSet(**values | {"prediction": grid.model_copy(update=more)}, stimuli=parts)
