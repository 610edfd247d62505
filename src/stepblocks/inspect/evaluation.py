"""What is asked of an evaluation of a scan, and what it returns."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, NoReturn

from stepblocks.errors import MetrologyError
from stepblocks.inspect.budget import Measured
from stepblocks.inspect.layout import DeclaredLayout
from stepblocks.inspect.noise import Array, Mask
from stepblocks.inspect.notes import Note
from stepblocks.quantities import format_quantity
from stepblocks.scans.scan import ScannedProfile

_LARGEST_STYLUS = 10e-3  # radius of a probe that scans a surface at all [m]


class Window(NamedTuple):
    """A stretch of a profile that was evaluated."""

    begin: float  # m
    end: float  # m
    name: str  # such as the letter of ISO 5436-1; empty where it has none


class Mark(NamedTuple):
    """A place of a profile that a plot names."""

    position: float  # m
    name: str


class Extent(NamedTuple):
    """How far a face was scanned."""

    across: float  # the edge [m]
    along: float  # the edge [m]


@dataclass(frozen=True)
class Shown:
    """What a plot shows of a scan.

    It is one profile, levelled on its lower or outer face, and the map that it belongs to.

    Attributes
    ----------
    position, height : array, shape (n,)
        m.
    windows : tuple of Window
        The stretches that were evaluated [m], with their names.
    fitted : array or None
        What was fitted to the profile [m].
    dropped : array of bool or None
        Points left out as spikes.
    marks : tuple of Mark
        Places that are named, where several features were evaluated.
    """

    position: Array
    height: Array
    windows: tuple[Window, ...] = ()
    fitted: Array | None = None
    dropped: Mask | None = None
    marks: tuple[Mark, ...] = ()


@dataclass(frozen=True)
class EvaluationOptions:
    """How a scan is to be evaluated; what is not given follows the data.

    Attributes
    ----------
    exclusion : float or None
        Half width kept out at every edge [m]; by default where the flank is.
    degree : int or None
        Of the polynomial that a profile is levelled by, 1 to 3; by default as the data carry.
    begin, end : float or None
        Part of each profile that is looked at [m]; by default all of it.
    edges : tuple of int or None
        Which features, counted from 1; by default all.
    along : {"x", "y"} or None
        Direction of the profiles of a map; by default whichever shows features.
    area : tuple of float or None
        Rectangle of a map that is looked at, from and to along x, from and to along y [m].
        Positions count from its corner; by default the whole map.
    stylus_radius : float or None
        Radius of the stylus [m], 0 of an optical instrument. Where it is not stated, a radius of an
        edge is an upper bound.
    stylus_cone : float or None
        Full angle of the stylus [rad], 0 of an optical instrument. Where it is not stated, 60 and
        90 deg are taken as possible (ISO 3274).
    layout : DeclaredLayout or None
        What the part has beside its working edge; `inspect_scan` takes it from the declaration.

    Raises
    ------
    MetrologyError
        If a length or an angle is one that nothing can have.
    """

    exclusion: float | None = None
    degree: int | None = None
    begin: float | None = None
    end: float | None = None
    edges: tuple[int, ...] | None = None
    along: Literal["x", "y"] | None = None
    area: tuple[float, ...] | None = None
    stylus_radius: float | None = None
    stylus_cone: float | None = None
    layout: DeclaredLayout | None = None

    def __post_init__(self) -> None:
        radius = self.stylus_radius
        if radius is not None and not 0.0 <= radius <= _LARGEST_STYLUS:
            _raise_broken_rule("stylus radius must be from 0 to 10 mm", radius, "length")
        cone = self.stylus_cone
        if cone is not None and not 0.0 <= cone < math.pi:
            _raise_broken_rule("stylus cone must be at least 0 and below 180 deg", cone, "angle")
        if self.exclusion is not None and not self.exclusion >= 0.0:
            _raise_broken_rule("exclusion must not be negative", self.exclusion, "length")


def _raise_broken_rule(rule: str, value: float, dimension: str) -> NoReturn:
    """Raise that a value breaks a rule."""
    raise MetrologyError(f"{rule}, got {format_quantity(value, dimension)}")


AS_FOUND = EvaluationOptions()


@dataclass(frozen=True)
class Evaluation:
    """What a scan says.

    Attributes
    ----------
    values : dict of Measured
        By key of the characteristic.
    convention : str
        How the values are defined.
    notes : tuple of Note
        What was left out, cut or is in doubt.
    shown : Shown or None
        What a plot shows; None of what another program measured.
    arc : bool
        Whether the edge is an arc, of which its radius then says all.
    missing : dict of str
        Why a characteristic was not measured, by its key.
    covered : dict of Extent
        How far a face was scanned, by key of the form characteristic.
    surface : ScannedProfile or None
        The edge between level faces, where it is no arc and was seen.
    faces : tuple of ScannedProfile
        Profiles of the faces, levelled, for their roughness.
    """

    values: dict[str, Measured]
    convention: str
    notes: tuple[Note, ...]
    shown: Shown | None = None
    arc: bool = True
    missing: Mapping[str, str] = field(default_factory=dict)
    covered: Mapping[str, Extent] = field(default_factory=dict)
    surface: ScannedProfile | None = None
    faces: tuple[ScannedProfile, ...] = ()
