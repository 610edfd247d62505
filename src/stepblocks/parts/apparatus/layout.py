"""All components of the apparatus where they stand, by the stages in which they are assembled."""

from collections.abc import Sequence
from dataclasses import dataclass

from stepblocks.parts.apparatus.component import Component
from stepblocks.parts.apparatus.damping_rig import yield_damping_rig_components
from stepblocks.parts.apparatus.declared import Apparatus
from stepblocks.parts.apparatus.frame import make_stand_in_block, yield_frame_components
from stepblocks.parts.apparatus.probe_arm import (
    compute_carriage_height_mm,
    make_flexure,
    yield_balanced_arm_components,
    yield_carriage_components,
    yield_yoke_components,
)
from stepblocks.parts.apparatus.pull import yield_pull_components


@dataclass(frozen=True)
class Stage:
    """Components that are mounted together."""

    title: str
    components: Sequence[Component]


def list_assembly_stages(kit: Apparatus, weight_mass: float | None = None) -> list[Stage]:
    """List the stages of the assembly, with the components where they stand.

    Parameters
    ----------
    kit : Apparatus
        What is declared.
    weight_mass : float, optional
        Mass of the weight on the explorer [kg]; that of the heaviest where omitted.

    Returns
    -------
    list of Stage
        In the frame of the rig, at the middle of the travel: x along the drag, y along the edge, z
        up; the tip touches at the origin.
    """
    if weight_mass is None:
        weight_mass = max(kit.normal_weights)
    carriage_low_mm = compute_carriage_height_mm(kit.flexure)
    flexure_and_pivot = [make_flexure(kit.flexure), *yield_yoke_components()]
    block_and_pull = [make_stand_in_block(), *yield_pull_components()]
    damping_rig = yield_damping_rig_components(kit.displacement.value)
    return [
        Stage("frame", list(yield_frame_components(carriage_low_mm))),
        Stage("carriage", list(yield_carriage_components(carriage_low_mm))),
        Stage("flexure and pivot", flexure_and_pivot),
        Stage("arm", list(yield_balanced_arm_components(weight_mass))),
        Stage("block and pull", block_and_pull),
        Stage("damping rig", list(damping_rig)),
    ]


def list_components(kit: Apparatus, weight_mass: float | None = None) -> list[Component]:
    """List the components of a kit, in the order of its parts list; see `list_assembly_stages`."""
    components: list[Component] = []
    for stage in list_assembly_stages(kit, weight_mass):
        components += stage.components
    return components


def list_made_component_names(kit: Apparatus) -> list[str]:
    """List the names of the components of a kit that are made, not bought."""
    return [component.name for component in list_components(kit) if component.is_made]


def find_component(kit: Apparatus, name: str) -> Component:
    """Find the component of a name.

    Raises
    ------
    KeyError
        If the kit has none of that name.
    """
    for component in list_components(kit):
        if component.name == name:
            return component
    raise KeyError(name)
