"""A stimulus set: everything one file declares; and the list of the kinds that a file may hold."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache, partial
from html import escape
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self, TypeGuard

from pydantic import FailFast, Field, InstanceOf, ValidationError, create_model, model_validator

from stepblocks.contact.operating_point import PAPER, OperatingPoint
from stepblocks.contact.rod import RodRing
from stepblocks.declaration.series import MAX_SERIES, expand_series, merge_tables
from stepblocks.declaration.write import format_set_as_toml
from stepblocks.errors import StepblocksError, StimulusError
from stepblocks.files.atomic import replace_text
from stepblocks.mistakes import (
    Location,
    Mistake,
    collect_mistakes,
    format_mistakes,
    list_mistakes,
    shorten_value,
)
from stepblocks.parts.conditions import (
    PAPER_STEPS,
    DampingRig,
    OrderSpec,
    PredictionGrid,
    ProbeSpec,
)
from stepblocks.parts.declared import Identity, Table, make_rules_validator
from stepblocks.parts.felt_tolerance import has_felt_tolerance, resolve_felt_tolerance
from stepblocks.parts.kind import Part
from stepblocks.parts.kinds.crown_on_tooth import CrownOnTooth
from stepblocks.parts.kinds.kit_part import KitPart
from stepblocks.parts.kinds.margin import MarginBlock
from stepblocks.parts.kinds.scanned_margin import ScannedMargin
from stepblocks.parts.kinds.sheath import Sheath
from stepblocks.parts.kinds.step_block import StepBlock
from stepblocks.parts.kinds.tips import HookTip, StraightTip
from stepblocks.parts.tolerance import Origin

# The kinds, in the order in which a set holds them; a new one stands here
SHIPPED: tuple[type[Part], ...] = (
    StepBlock,
    MarginBlock,
    CrownOnTooth,
    ScannedMargin,
    StraightTip,
    HookTip,
    Sheath,
    KitPart,
)
_registered: list[type[Part]] = []  # as long as a `register_kind` lasts

_SHOWN_NAMES = 6  # of a set whose parts are all named in a line, fewer than


def list_kinds() -> dict[str, type[Part]]:
    """Return the kinds that stimulus files may declare, by the names of their stanzas."""
    return {kind.stanza: kind for kind in (*SHIPPED, *_registered)}


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
    _registered.append(kind)
    try:
        yield
    finally:
        _registered.remove(kind)


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

    if TYPE_CHECKING:  # a field holds what was read of what is given

        def __init__(self, **fields: object) -> None: ...

    name: Identity
    title: Annotated[str, Field(min_length=1, max_length=200)]
    source: Annotated[str, Field(max_length=500)] = ""
    prediction: PredictionGrid = PredictionGrid()
    # of entries that are no parts the first is enough: millions of mistakes fill the memory
    stimuli: Annotated[tuple[InstanceOf[Part], ...], FailFast()]
    order: OrderSpec = OrderSpec()
    probe: ProbeSpec | None = None
    damping_rig: DampingRig | None = None

    def __getattr__(self, name: str) -> tuple[Any, ...]:
        """Parts of one kind, by the name of its stanza."""
        if name not in list_kinds():
            raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")
        return tuple(part for part in self.stimuli if part.stanza == name)

    @classmethod
    def declare(cls, name: str, **declared: object) -> "StimulusSet":
        """Declare a set in Python as a file does, with the same defaults.

        Parameters
        ----------
        name : str
            Of the set, and of the file that `to_toml` writes.
        **declared
            Tables of a stimulus file: ``prediction``, ``order``, and lists of stanzas by kind,
            such as ``step_block=[{"id": "a", "height": "25 um"}]``. A stanza is a mapping, which
            may stand for a series, or a part. Numbers are in SI.

        Returns
        -------
        StimulusSet
            Validated, every series expanded, all values in SI.

        Raises
        ------
        StimulusError
            With all mistakes: name, rule, value and place.
        """
        # the place is said in one line, whatever was given as the name
        return make_set_from_tables(
            name, declared, Path(), " ".join(str(name).split()), [], Origin.PYTHON
        )

    def to_toml(self, path: str | Path | None = None) -> str:
        """Write the set as a stimulus file that reads back as the same set.

        Parameters
        ----------
        path : str or Path, optional
            Where to write it; the stem must be the name of the set. Nothing is written where
            omitted.

        Returns
        -------
        str
            The text of the file.

        Raises
        ------
        StimulusError
            If the name of the file is not that of the set, or a part cannot be stated in a file.
        """
        if path is not None and not isinstance(path, str | Path):
            raise StimulusError(f"path must be that of a file, got {shorten_value(path)}")
        text = format_set_as_toml(self, self.name, self.stimuli)
        if path is None:
            return text
        if Path(path).stem != self.name:
            raise StimulusError(f"the file must be named after its set, {self.name!r} [{path}]")
        replace_text(Path(path), text)
        return text

    def __repr__(self) -> str:
        names = [part.id for part in self.stimuli]
        shown = names
        if len(names) >= _SHOWN_NAMES:
            shown = [*names[:3], "...", names[-1]]
        return f"StimulusSet({self.name!r}, {len(names)} stimuli: {', '.join(shown)})"

    __str__ = __repr__

    def _repr_html_(self) -> str:
        rows = []
        for part in self.stimuli:
            cells = (part.id, part.kind_name, part.summary, part.material.order_text)
            rows.append("<tr>" + "".join(f"<td>{escape(cell)}" for cell in cells))
        return (
            f"<b>{escape(self.title)}</b>"
            f"<table><tr><th>stimulus<th>kind<th>size<th>material{''.join(rows)}</table>"
        )

    def with_parts(self, parts: Iterable[Part]) -> Self:
        """Return the set with other parts under the same conditions."""
        return self.model_copy(update={"stimuli": tuple(parts)})

    def keep_felt(self) -> Self:
        """Return the set without the parts that take no part in a drag; it may be empty."""
        return self.with_parts([part for part in self.stimuli if part.is_felt])

    def predict_ring(self, part: Part) -> RodRing | None:
        """Predict how the probe rings with a part on its shank; None where it wears none."""
        sleeve = part.sleeve
        if sleeve is None or self.probe is None:
            return None
        return self.probe.predict_ring(sleeve)

    def find_conditions(self, part: Part) -> PredictionGrid:
        """Return the conditions of a part; a sheath changes the stiffness of the probe."""
        ring = self.predict_ring(part)
        if ring is None:
            return self.prediction
        tool = self.prediction.tool.model_copy(update={"stiffness": ring.stiffness})
        return self.prediction.model_copy(update={"tool": tool})

    def describe_alike(self) -> dict[str, str]:
        """Say which bench blocks have the sizes of another: no hand and no scan tells them apart.

        Returns
        -------
        dict of str to str
            A sentence by the identity of each block that repeats an earlier one.
        """
        first_by_sizes: dict[tuple[object, ...], str] = {}
        sentences = {}
        for part in self.stimuli:
            if not part.has_working_faces:
                continue
            sizes: list[object] = [part.stanza]
            for edge in part.list_felt_edges():
                sizes += [size.nominal for size in edge.sizes.values()]
            first = first_by_sizes.setdefault(tuple(sizes), part.id)
            if first != part.id:
                sentences[part.id] = f"{part.id} has the sizes of {first}: {part.summary}"
        return sentences

    @model_validator(mode="after")
    def _add_conditions_of_paper(self) -> Self:
        """Add tips and steps of the paper that parts need and a declaration leaves out."""
        additions: dict[str, tuple[float, ...]] = {}
        if not self.prediction.tip_radii and any(part.ball is None for part in self.stimuli):
            additions["tip_radii"] = (PAPER.ball_radius,)
        if not self.prediction.step_heights and not all(part.crossed for part in self.stimuli):
            additions["step_heights"] = PAPER_STEPS
        if additions:
            completed = self.prediction.model_copy(update=additions)
            object.__setattr__(self, "prediction", completed)  # frozen from here on
        return self

    @make_rules_validator
    def _yield_set_breaches(self) -> Iterator[str]:
        """Yield what parts and conditions of the set lack for each other."""
        declared = [part.id for part in self.stimuli]
        for name in self.order.quantities:
            if name not in declared:
                yield f"order.quantities must name parts of the set, got {name!r}"
        for name in _list_repeated_names(declared):
            yield (
                f"id must be unique in its set, got {name!r} twice; in a series it names what "
                f"varies, such as '{name}-{{height_um:03}}'"
            )
        yield from self._yield_missing_conditions()
        if not self.stimuli:
            yield "a set must declare at least one stimulus, got none"

    def _yield_missing_conditions(self) -> Iterator[str]:
        """Yield the first of what the parts need and the set lacks, if anything."""
        conditions = {"probe": self.probe, "damping_rig": self.damping_rig}
        for part in self.stimuli:
            for sentence in part.list_missing_conditions(conditions):
                yield sentence
                return


def _list_repeated_names(names: Sequence[str]) -> list[str]:
    """List names as often as they repeat an earlier one, by their first appearance."""
    repeated: list[str] = []
    for name, count in Counter(names).items():
        repeated += [name] * (count - 1)
    return repeated


def choose_operating_point(
    stimuli: StimulusSet, part: Part, overrides: Mapping[str, float]
) -> OperatingPoint:
    """Choose the first condition of a part's set, changed by `overrides` and by the part itself."""
    conditions = stimuli.find_conditions(part)
    tool = conditions.as_tool()
    ring = stimuli.predict_ring(part)
    if ring is not None:  # how the probe rings with this part on its shank
        tool = ring.as_tool(tool)
    fields: dict[str, Any] = {"tool": tool, "tissue": part.tissue(tool), **overrides}
    if part.ball is not None:
        fields["ball_radius"] = part.ball.nominal
    return conditions.make_first_operating_point(**fields)


def make_file_model() -> type[Table]:
    """Make the model of a file: the fields of a set, and a list of tables for each kind."""
    return _make_model_of_kinds(tuple(list_kinds().items()))


@lru_cache(maxsize=2)  # making it takes longer than reading a file by it
def _make_model_of_kinds(kinds: tuple[tuple[str, type[Part]], ...]) -> type[Table]:
    """Make the model of a file that may declare kinds, each by the name of its stanza."""
    fields: dict[str, Any] = {}
    for name, field in StimulusSet.model_fields.items():
        if name != "stimuli":
            fields[name] = (field.annotation, field)
    for stanza, kind in kinds:
        fields[stanza] = (tuple[kind, ...], ())  # type: ignore[valid-type]
    return create_model("StimulusFile", __base__=Table, **fields)


def validate_set(declared: Mapping[str, object], origin: Origin = Origin.FILE) -> StimulusSet:
    """Validate the declaration of a set, of a file or of Python, and return the set."""
    fields = dict(make_file_model().model_validate(declared, context=origin))
    parts: list[Part] = []
    for stanza in list_kinds():
        parts += fields.pop(stanza)
    fields["stimuli"] = tuple(parts)
    return StimulusSet.model_validate(fields)


def make_set_from_tables(
    name: str,
    tables: dict[str, Any],
    folder: Path,
    place: object,
    mistakes: list[Mistake],
    origin: Origin = Origin.FILE,
) -> StimulusSet:
    """Make a set of the tables of a file in a folder, or say all that is wrong with them.

    Parameters
    ----------
    name : str
        Name of the set.
    tables : dict
        Tables of the file; its stanzas are replaced by what they stand for.
    folder : Path
        Where the files lie that stanzas name.
    place : object
        What is read, for the message.
    mistakes : list of Mistake
        What is wrong so far; the list grows.
    origin : Origin
        Whether numbers without a unit are read, in SI.

    Returns
    -------
    StimulusSet
        Validated, every series expanded, all values in SI.

    Raises
    ------
    StimulusError
        With all mistakes: name, rule, value and place.
    """
    _expand_stanzas_of_kinds(tables, folder, mistakes)
    total = sum(len(tables.get(kind, ())) for kind in list_kinds())
    if total > MAX_SERIES:
        raise StimulusError(f"a set must have at most {MAX_SERIES} stimuli, got {total} [{place}]")
    declared = {"name": name, "title": name, **tables}
    try:
        stimuli = validate_set(declared, origin)
    except ValidationError as error:
        # where stanzas could not be read, a set without any is no mistake of its own
        if total or not mistakes:
            locate = partial(_locate_stanza, declared)
            validate = partial(validate_set, origin=origin)
            mistakes += list_mistakes(error, make_file_model(), declared, locate, validate)
    if mistakes:
        raise StimulusError(format_mistakes(mistakes, place))
    return _resolve_felt_tolerances(stimuli, place)


def _resolve_felt_tolerances(stimuli: StimulusSet, place: object) -> StimulusSet:
    """Give the parts of a set the limits that follow from what is felt, or say which cannot be."""
    if not any(map(has_felt_tolerance, stimuli.stimuli)):
        return stimuli
    mistakes: list[Mistake] = []
    parts = []
    for part in stimuli.stimuli:
        if not has_felt_tolerance(part):
            parts.append(part)
            continue
        with collect_mistakes(mistakes, f"{part.stanza} {part.id!r}"):
            parts.append(resolve_felt_tolerance(part, stimuli.find_conditions(part)))
    if mistakes:
        raise StimulusError(format_mistakes(mistakes, place))
    return stimuli.with_parts(parts)


def _expand_stanzas_of_kinds(tables: dict[str, Any], folder: Path, mistakes: list[Mistake]) -> None:
    """Replace the stanzas of each kind by what they stand for, at most one more than a set holds.

    Mistakes are added to the list.
    """
    known = list_kinds()
    defaults = tables.pop("defaults", {})
    if not isinstance(defaults, dict) or not set(defaults) <= set(known):
        rule = f"defaults must be tables named {', '.join(known)}"
        mistakes.append(("", f"{rule}, got {shorten_value(defaults)}"))
        defaults = {}
    for kind in known:
        if kind in tables:
            stanzas = _expand_stanzas(kind, tables[kind], defaults.get(kind, {}), mistakes, folder)
            tables[kind] = list(islice(stanzas, MAX_SERIES + 1))


def _locate_stanza(declared: Mapping[str, Any], location: Location) -> tuple[str, Location]:
    """Split a location of pydantic's into the stanza, as a person finds it, and what is left."""
    if len(location) < 2:
        return "", location
    kind, number, *inner = location
    if kind not in list_kinds() or not isinstance(number, int):
        return "", location
    stanzas = declared.get(kind, ())
    stanza: Part | Mapping[str, object] = {}
    if number < len(stanzas):  # there is none where the name of the kind was corrected
        stanza = stanzas[number]
    return f"{kind} {shorten_value(_get_stanza_identity(stanza, number + 1))}", tuple(inner)


def _get_stanza_identity(stanza: Part | Mapping[str, object], otherwise: object) -> object:
    """Return the identity of a stanza, or what stands for it where it has none."""
    if isinstance(stanza, Part):
        return stanza.id
    return stanza.get("id", otherwise)


def _expand_stanzas(
    kind: str, raw_stanzas: object, defaults: object, mistakes: list[Mistake], folder: Path
) -> Iterator[Part | Mapping[str, object]]:
    """Expand the stanzas of a kind; those that cannot be are among the mistakes."""
    if not _are_stanzas(raw_stanzas):
        mistakes.append(
            ("", f"{kind} must be written as [[{kind}]], got {shorten_value(raw_stanzas)}")
        )
        return
    if not isinstance(defaults, dict):
        mistakes.append(("", f"defaults.{kind} must be a table, got {shorten_value(defaults)}"))
        return
    for number, stanza in enumerate(raw_stanzas, start=1):
        if isinstance(stanza, Part):
            yield stanza
            continue
        place = f"{kind} {shorten_value(_get_stanza_identity(stanza, f'number {number}'))}"
        try:
            for member in expand_series(merge_tables(defaults, stanza)):
                yield from list_kinds()[kind].expand_stanza(member, folder)
        except (ValueError, StepblocksError) as error:
            mistakes.append((place, str(error)))
        except RecursionError:
            mistakes.append((place, "tables must not nest so deep"))


def _are_stanzas(raw: object) -> TypeGuard[Sequence[Part | dict[str, object]]]:
    """Tell whether a value is a list of stanzas, as tables or as parts."""
    if not isinstance(raw, list | tuple):
        return False
    return all(isinstance(stanza, dict | Part) for stanza in raw)
