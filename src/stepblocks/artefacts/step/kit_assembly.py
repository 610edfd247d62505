"""The STEP file of the apparatus: every component where it stands, each of its material."""

from pathlib import Path

from stepblocks.artefacts.step.write import write_conforming_step
from stepblocks.parts.apparatus.declared import Apparatus
from stepblocks.parts.apparatus.layout import list_components
from stepblocks.parts.conditions import OrderSpec


def write_kit_assembly(path: Path, kit: Apparatus, order: OrderSpec) -> None:
    """Write the components of a kit, what is made and what is bought, as one product.

    Parameters
    ----------
    path : Path
        Where to write it.
    kit : Apparatus
        What is declared.
    order : OrderSpec
        Author, date and revision of the header.

    Raises
    ------
    SolidError
        If an operation of the kernel does not give one valid solid.
    """
    components = list_components(kit)
    bodies = [(component.name, component.build_solid()) for component in components]
    materials = [component.material for component in components]
    write_conforming_step(path, kit.id, bodies, materials, [], order=order)
