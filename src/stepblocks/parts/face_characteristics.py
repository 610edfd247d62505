"""Characteristics of the faces beside a working edge, and of the edge itself."""

import math
from collections.abc import Iterator

from stepblocks.parts.characteristics import (
    Characteristic,
    FaceRule,
    Kind,
    Rule,
    make_characteristic,
)
from stepblocks.parts.declared import FaceDemands
from stepblocks.parts.tolerance import ANGULAR_DEVIATION, Dimension

# distance from a working edge within which nothing may stand over the upper face [m]
BURR_ZONE = 0.2e-3
# ISO 2768-2:1989, table 1, class H, of a length up to 10 mm [m]
RISER_STRAIGHTNESS = 0.02e-3
_FACE_FORM = "interferometer, form of the face, minimum zone"
_EDGE_SECTION = "section or replica across the edge"


def make_zone_characteristic(
    key: str, label: str, kind: Kind, zone: Dimension, faces: tuple[Rule, ...], method: str
) -> Characteristic:
    """State the zone of a form or texture; a default zone is none that the file states."""
    return Characteristic(
        key,
        label,
        kind,
        0.0,
        0.0,
        zone.upper,
        faces=faces,
        method=method,
        states=() if zone.usual else (zone,),
    )


def make_form_characteristics(
    demands: FaceDemands,
    lower_face: FaceRule,
    upper_face: FaceRule,
    lower_label: str,
    upper_label: str,
) -> Iterator[Characteristic]:
    """State flatness and parallelism of the two working faces.

    Parameters
    ----------
    demands : dict of str to Dimension
        Demands on the faces in force.
    lower_face, upper_face : FaceRule
        The faces.
    lower_label, upper_label : str
        What a person calls them.

    Yields
    ------
    Characteristic
        Flatness of either face, then parallelism of the upper one to the lower one.
    """
    flatness = demands["flatness"]
    yield make_zone_characteristic(
        "flatness_lower",
        f"flatness, {lower_label}",
        "flatness",
        flatness,
        (lower_face,),
        _FACE_FORM,
    )
    yield make_zone_characteristic(
        "flatness_upper",
        f"flatness, {upper_label}",
        "flatness",
        flatness,
        (upper_face,),
        _FACE_FORM,
    )
    parallelism = demands["parallelism"]
    label = f"parallelism, {upper_label} to A"
    yield make_zone_characteristic(
        "parallelism", label, "parallelism", parallelism, (upper_face, lower_face), _FACE_FORM
    )


def make_roughness_and_base_characteristics(
    demands: FaceDemands, lower_face: FaceRule, upper_face: FaceRule, base_face: FaceRule
) -> Iterator[Characteristic]:
    """State the roughness of the working faces, and the form of the base under the lower one."""
    yield make_zone_characteristic(
        "roughness",
        "roughness Ra, working faces",
        "roughness",
        demands["roughness"],
        (lower_face, upper_face),
        "profilometer or interferometer, ISO 21920-2",
    )
    yield make_zone_characteristic(
        "flatness_base",
        "flatness, base",
        "flatness",
        demands["base_flatness"],
        (base_face,),
        "optical flat or electronic comparator",
    )
    yield make_zone_characteristic(
        "parallelism_base",
        "parallelism, lower face to B, the base",
        "parallelism",
        demands["base_parallelism"],
        (lower_face, base_face),
        "comparator on a surface plate",
    )


def make_contact_roughness_characteristic(
    roughness: Dimension, faces: tuple[Rule, ...] = (), place: str = "where a tip touches"
) -> Characteristic:
    """State the roughness of the surface at which tip and part touch; a note without its faces."""
    kind: Kind = "roughness" if faces else "note"
    return make_zone_characteristic(
        "roughness",
        f"roughness Ra, {place}",
        kind,
        roughness,
        faces,
        "profilometer or interferometer, ISO 21920-2",
    )


def make_burr_characteristic(
    burr: Dimension, faces_label: str = "the upper face"
) -> Characteristic:
    """State the largest height of a burr over the faces at a working edge (ISO 13715)."""
    return make_zone_characteristic(
        "burr",
        f"burr over {faces_label} within {BURR_ZONE * 1e3:g} mm of the edge",
        "note",
        burr,
        (),
        "profilometer or interferometer, ISO 13715",
    )


def make_edge_characteristics(
    burr: Dimension, wall: FaceRule | None, lower_face: FaceRule
) -> Iterator[Characteristic]:
    """State the burr at the working edge (ISO 13715), and angle and straightness of its wall.

    Parameters
    ----------
    burr : Dimension
        Largest height of a burr over the upper face.
    wall : FaceRule or None
        Riser of the step; None where it is all rounding, and nothing is upright.
    lower_face : FaceRule
        Lower working face.

    Yields
    ------
    Characteristic
        Burr, and angle and straightness of the wall.
    """
    yield make_burr_characteristic(burr)
    if wall is None:
        return
    yield make_characteristic(
        "riser_angle",
        "angle",
        Dimension(0.5 * math.pi, ANGULAR_DEVIATION, -ANGULAR_DEVIATION, "angle"),
        wall,
        lower_face,
        label="angle of the riser to the faces",
        method=_EDGE_SECTION,
    )
    yield Characteristic(
        "riser_straightness",
        "straightness of the riser across the edge",
        "note",
        0.0,
        0.0,
        RISER_STRAIGHTNESS,
        method=_EDGE_SECTION,
    )
