"""The parts list of the apparatus, and the tables of its loads and of its flexure."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from stepblocks.parts.apparatus.component import Component
from stepblocks.parts.apparatus.declared import Apparatus
from stepblocks.parts.apparatus.flexure import compute_flexure_figures
from stepblocks.parts.apparatus.layout import list_components
from stepblocks.parts.apparatus.loads import (
    ErrorSource,
    Load,
    compute_normal_load,
    compute_pulling_load,
    find_largest_common_load_std,
)
from stepblocks.parts.apparatus.probe_arm import (
    WEIGHT_NAME,
    describe_bored_weight,
    describe_weight,
)

MADE = "made"
BOUGHT = "bought"


@dataclass(frozen=True)
class _Fastener:
    """Something small that is bought and that the assembly does not show."""

    count: int
    what: str
    purpose: str


_FASTENERS = (
    _Fastener(13, "screw ISO 4762 M4 x 16", "base to portals, seat, bracket and damping rig"),
    _Fastener(4, "screw ISO 4762 M4 x 30", "upper halves of clamp and jaw"),
    _Fastener(2, "screw ISO 4762 M3 x 20", "block to its seat, through the base"),
    _Fastener(2, "screw ISO 4762 M3 x 30", "flexure to carriage, from above"),
    _Fastener(2, "screw ISO 4762 M3 x 12", "yoke to flexure, from below"),
    _Fastener(2, "screw ISO 4762 M3 x 8", "hook to carriage"),
    _Fastener(2, "screw ISO 4762 M2.5 x 10", "clamp of the explorer"),
    _Fastener(
        4,
        "semiconductor strain gauge 350 ohm, 3 mm",
        "flexure, both sides of both leaves at their upper end, full bridge",
    ),
    _Fastener(1, "force-sensing resistor, 9.5 mm", "pressure sensor in the upper jaw"),
    _Fastener(1, "retaining compound for fits, 5 g", "axles, balance rod, counterweight, bearings"),
    _Fastener(1, "braided cord 0.3 mm, 0.5 m", "hook to hanger, over the pulley"),
)


def tabulate_parts(kit: Apparatus) -> list[dict[str, object]]:
    """List what a kit needs, a row each: made parts, bought parts, weights, fasteners.

    The items are the numbers on the assembly drawing and in the pictures of the stages.
    """
    components = list_components(kit)
    items = {component.name: number for number, component in enumerate(components, start=1)}
    rows = []
    for component in components:
        if component.is_made:
            rows.append(_make_component_row(MADE, [items[component.name]], [component]))
    for group in _group_bought_components(components):
        items_of_group = [items[component.name] for component in group]
        rows.append(_make_component_row(BOUGHT, items_of_group, group))
    rows += _yield_weight_rows(kit, items[WEIGHT_NAME])
    for fastener in _FASTENERS:
        rows.append(_make_unnumbered_row(fastener.count, fastener.what, fastener.purpose))
    return rows


def _group_bought_components(components: Sequence[Component]) -> list[list[Component]]:
    """Group what is bought by its designation, but for the weights."""
    groups: dict[str, list[Component]] = {}
    for component in components:
        if not component.is_made and component.name != WEIGHT_NAME:
            groups.setdefault(component.designation, []).append(component)
    return list(groups.values())


def _make_component_row(
    source: str, item_numbers: Sequence[int], components: Sequence[Component]
) -> dict[str, object]:
    """Make a row of parts that are ordered alike."""
    first = components[0]
    name, material = "", ""
    if first.is_made:
        name = first.name
        material = first.material.order_text
    return {
        "items": " ".join(map(str, item_numbers)),
        "count": len(components),
        "source": source,
        "what": first.designation or first.title,
        "part": name,
        "material": material,
        "mass_g": 1e3 * first.mass,
        "purpose": first.title,
    }


def _yield_weight_rows(kit: Apparatus, item_number: int) -> Iterator[dict[str, object]]:
    """Yield a row for each weight; those on the explorer share an item."""
    for mass in kit.normal_weights:
        what = describe_bored_weight(mass)
        yield {
            **_make_unnumbered_row(1, what, "on the shank of the explorer"),
            "items": str(item_number),
        }
    for mass in kit.pulling_weights:
        what = f"{describe_weight(mass)}, slotted 3.2"
        yield _make_unnumbered_row(1, what, "on the hanger of the cord")


def _make_unnumbered_row(count: int, article: str, purpose: str) -> dict[str, object]:
    """Make a row of something bought that no item shows."""
    return {
        "items": "",
        "count": count,
        "source": BOUGHT,
        "what": article,
        "part": "",
        "material": "",
        "mass_g": None,
        "purpose": purpose,
    }


def tabulate_loads(kit: Apparatus) -> list[dict[str, object]]:
    """List the force of every weight with the budget of its uncertainty, a row each."""
    rows = []
    for mass in kit.normal_weights:
        rows.append(_make_load_row("normal", compute_normal_load(kit, mass)))
    for mass in kit.pulling_weights:
        rows.append(_make_load_row("pull", compute_pulling_load(kit, mass)))
    return rows


def _make_load_row(axis: str, load: Load) -> dict[str, object]:
    """Return a weight with its force and what each source of error adds to it."""
    row: dict[str, object] = {
        "axis": axis,
        "weight_g": 1e3 * load.mass,
        "force_n": load.force,
        "std_n": load.std,
        "common_std_n": load.common_std,
    }
    stds = {component.source: component.std for component in load.budget}
    for source in ErrorSource:
        row[f"{source.value}_std_n"] = stds.get(source)
    return row


def tabulate_flexure(kit: Apparatus) -> list[dict[str, object]]:
    """List stiffness, first frequency and output of the flexure, a row for each weight."""
    rows: list[dict[str, object]] = []
    for mass in kit.normal_weights:
        figures = compute_flexure_figures(kit, mass)
        rows.append(
            {
                "weight_g": 1e3 * mass,
                "stiffness_n_per_m": figures.stiffness,
                "moved_mass_g": 1e3 * figures.moved_mass,
                "frequency_hz": figures.frequency,
                "output_per_n": figures.sensitivity,
            }
        )
    return rows


def format_session_lines(kit: Apparatus) -> str:
    """Write what a session of this kit declares of its load, as session.toml takes it."""
    std = find_largest_common_load_std(kit)
    spring = compute_flexure_figures(kit).stiffness
    return f"""# What a session on {kit.id} says of its load: put these lines into its session.toml.
# By the budget of the kit: mass, gravity, arm and balance of the heaviest weight. Put your own
# figures where you have measured them. The flexure is a spring of {spring * 1e-3:.4g} N/mm.
[calibration]
load_error = ["0 mN", "{std * 1e3:.2g} mN"]
"""
