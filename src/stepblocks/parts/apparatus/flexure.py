"""The flexure by beam theory: stiffness, first frequency and output of its bridge."""

import math
from dataclasses import dataclass

from stepblocks.parts.apparatus.declared import Apparatus, Flexure
from stepblocks.parts.apparatus.layout import list_components
from stepblocks.parts.material import MATERIALS

LEAVES = 2
_SHEAR_SHARE = 5.0 / 6.0  # of a section that is a rectangle, of which shear is carried (Timoshenko)
_WIDE = 5.0  # width over thickness from which on a leaf bends as a plate
# mass of a beam between parallel ends over what moves with its end, for its deflection
# 3 s^2 - 2 s^3 under a force there (Rayleigh)
_LEAF_SHARE = 13.0 / 35.0
_HUNG = ("yoke", "pivot-bearing-left", "pivot-bearing-right", "axle")  # beside what is on the pivot


@dataclass(frozen=True)
class FlexureFigures:
    """What the leaves do under a pull at the tip.

    Attributes
    ----------
    stiffness : float
        Of both leaves along the drag [N/m].
    frequency : float
        First one along the drag, with the arm, the explorer and a weight below the leaves [Hz].
    moved_mass : float
        Mass that counts in it [kg].
    sensitivity : float
        Output of the full bridge over its supply for a newton at the tip [1/N].
    """

    stiffness: float
    frequency: float
    moved_mass: float
    sensitivity: float


def compute_flexure_figures(kit: Apparatus, weight_mass: float | None = None) -> FlexureFigures:
    """Compute stiffness, first frequency and output of the flexure.

    Parameters
    ----------
    kit : Apparatus
        What is declared.
    weight_mass : float, optional
        Mass of the weight on the explorer [kg]; that of the heaviest where omitted.

    Returns
    -------
    FlexureFigures
        By Euler, Bernoulli and Timoshenko, the frequency by Rayleigh.
    """
    stiffness = LEAVES * compute_leaf_stiffness(kit.flexure)
    mass = _compute_hung_mass(kit, weight_mass) + LEAVES * _LEAF_SHARE * _compute_leaf_mass(
        kit.flexure
    )
    frequency = math.sqrt(stiffness / mass) / (2.0 * math.pi)
    return FlexureFigures(stiffness, frequency, mass, _compute_bridge_sensitivity(kit.flexure))


def compute_leaf_stiffness(leaf: Flexure) -> float:
    """Compute the stiffness of one leaf whose clamped ends stay parallel [N/m].

    Bending gives 12 E I / L^3; shear adds the deflection F L / (5/6 G A).
    """
    length = leaf.length.nominal
    width = leaf.width.nominal
    thickness = leaf.thickness.nominal
    modulus = leaf.modulus.value
    second_moment = width * thickness**3 / 12.0
    shear_modulus = modulus / (2.0 * (1.0 + leaf.poisson.value))
    by_bending = length**3 / (12.0 * find_bending_modulus(leaf) * second_moment)
    by_shear = length / (_SHEAR_SHARE * shear_modulus * width * thickness)
    return 1.0 / (by_bending + by_shear)


def find_bending_modulus(leaf: Flexure) -> float:
    """Find the modulus in bending [Pa]: of a wide leaf that of a plate, E / (1 - nu^2).

    Its clamped ends keep a wide leaf from curving across (Timoshenko and Woinowsky-Krieger, Theory
    of Plates and Shells, 1959, article 2).
    """
    modulus = leaf.modulus.value
    if leaf.width.nominal < _WIDE * leaf.thickness.nominal:
        return modulus
    return modulus / (1.0 - leaf.poisson.value**2)


def _compute_bridge_sensitivity(leaf: Flexure) -> float:
    """Compute the output of the full bridge over its supply for a newton [1/N].

    Each leaf carries half of the pull; its moment falls from F L / 4 at an end to none in its
    middle. Every gauge has the same strain, two with either sign.
    """
    lever = 0.5 * leaf.length.nominal - leaf.gauge_place.nominal
    moment = lever / LEAVES
    section_modulus = leaf.width.nominal * leaf.thickness.nominal**2 / 6.0
    strain = moment / (find_bending_modulus(leaf) * section_modulus)
    return leaf.gauge_factor.value * strain


def _compute_leaf_mass(leaf: Flexure) -> float:
    """Find the mass of one leaf [kg]."""
    density = MATERIALS["1.4301"].density
    assert density is not None  # of every material that has a key
    return density.value * leaf.length.nominal * leaf.width.nominal * leaf.thickness.nominal


def _compute_hung_mass(kit: Apparatus, weight_mass: float | None) -> float:
    """Find the mass below the leaves [kg]: their lower end, the yoke, and all on the pivot."""
    masses = []
    for component in list_components(kit, weight_mass):
        if component.is_on_pivot or component.name in _HUNG:
            masses.append(component.mass)
        if component.name == "flexure":
            lower_end = min(component.boxes, key=lambda box: box.low[2])
            masses.append(component.mass / component.volume * lower_end.volume)
    return math.fsum(masses)
