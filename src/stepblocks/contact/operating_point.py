"""Under what a counterface is felt.

The ball, the load, the friction, the speed, and the tool as a spring that rings.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from stepblocks.contact.domain import (
    MOST_BALL,
    convert_fields_in_place,
    format_changed_fields,
    read_number,
    require_not_negative,
)
from stepblocks.contact.laws import ContactLaw, FrictionLaw, Overtone
from stepblocks.errors import ContactError
from stepblocks.mistakes import shorten_value
from stepblocks.quantities import Measure

# figure 5: 86 % of the energy of the ring lies in 250 to 350 Hz
_BAND_SHARE = 0.86  # [1]
_HALF_BAND = 50.0  # [Hz]
# Just noticeable difference of power [dB] at the fingertip, 250-350 Hz (Weber fraction 0.41 of
# energy, 0.19 of amplitude). It was not measured on a hand-held explorer: a median of 0.20 of
# amplitude stands in the abstract of "Vibrotactile difference thresholds: effects of vibration
# frequency, vibration magnitude, contact area, and body location" (thenar, 125 Hz, 10 dB over
# threshold, 12 subjects; up to 0.58 elsewhere). Craig (1972, Perception & Psychophysics 11, 150) is
# remembered, not checked, for 1.5 dB. The fraction rises towards threshold, which is ignored, and
# was not measured on a short ring felt through a tool: treat it as a factor of two.
LEVEL_DIFFERENCE = 1.5
WEBER_FRACTION = 10.0 ** (LEVEL_DIFFERENCE / 10.0) - 1.0  # of the energy [1]


class Limit(NamedTuple):
    """A greatest tangential force."""

    name: str  # of the field of `Limits`
    force: float  # [N]


@dataclass(frozen=True)
class Limits:
    """Greatest tangential forces that something holds or gives.

    Beyond the first that a growing pull meets, the tip does not slip. ``Limits()`` has none: the
    equations alone. A tool that states no limits has those of a hand and of the explorer, whichever
    function is asked, as a stimulus file, a table or a grid has that states none.

    Attributes
    ----------
    strength : float
        At which the tool yields [N].
    spring : float
        To which its spring is linear [N].
    gauge : float
        That the gauge shows [N].
    hand : float
        That a hand pulls [N].

    Examples
    --------
    >>> from stepblocks import PAPER, Step
    >>> from dataclasses import replace
    >>> Step("100 um").release(PAPER).status.value
    'beyond-hand'
    >>> unlimited = replace(PAPER, tool=Tool(limits=Limits()))
    >>> Step("100 um").release(unlimited).status.value
    'releases'
    """

    strength: float = math.inf
    spring: float = math.inf
    gauge: float = math.inf
    hand: float = math.inf

    if TYPE_CHECKING:  # a field holds SI, whatever was given

        def __init__(
            self,
            strength: Measure = ...,
            spring: Measure = ...,
            gauge: Measure = ...,
            hand: Measure = ...,
        ) -> None: ...

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            force = read_number(f"limit of the {name}", value, "force")
            if not force > 0.0:
                raise ContactError(f"limit of the {name} must be positive, got {force:g} N")
            object.__setattr__(self, name, force)

    @property
    def first(self) -> Limit:
        """The limit that a growing pull meets first."""
        limits = [Limit(name, value) for name, value in vars(self).items()]
        return min(limits, key=lambda limit: limit.force)


# What every tool is held to unless it says otherwise, with where each comes from [N]
LIMIT_SOURCES = {
    "strength": (
        13.0,
        "assumed: a steel shank of 4 mm on 91.6 mm (stimuli/sheaths.toml) yields at its clamp "
        "from 190 MPa",
    ),
    "spring": (
        90.0,
        "a deflection of a tenth of that free length, to which the elastica is linear within 1 %",
    ),
    "gauge": (
        20.0,
        "assumed: twice the greatest force that the gauges of Caries Res 2003;37:365 saw; take "
        "your gauge's",
    ),
    "hand": (
        9.87,
        "1006 g, the greatest of five dentists: Caries Res 2003;37:365, doi 10.1159/000072169",
    ),
}
SHIPPED_LIMITS = Limits(**{name: value for name, (value, _) in LIMIT_SOURCES.items()})


@dataclass(frozen=True)
class Tool:
    """The explorer as a spring that rings.

    The defaults are those of the paper, and for the limits, of which it states none, the shipped
    ones.

    Of its ring the paper says 250 to 350 Hz (figure 5) and "approximately 250 Hz", where less than
    half of a line would lie in that band. The defaults are its middle, a deviation that reaches
    both ends, and the decay of a Lorentzian line with the 86 % of figure 5.

    Attributes
    ----------
    stiffness : float
        Tangential, k of equation (1) [N/m].
    conversion : float
        Share C_v of the stored energy that becomes vibration, 0 to 1 [1].
    ring_duration : float
        Time over which the vibration energy is spent [s].
    detection_threshold : float
        Vibration power that a fingertip just detects [W].
    frequency : float
        Of the ring [Hz].
    decay_time : float
        Of its amplitude, to 1/e [s].
    frequency_deviation : float
        How far the frequency may be off to either side [Hz].
    limits : Limits
        Forces beyond which the tip does not slip; `SHIPPED_LIMITS` by default.
    overtones : Overtone or sequence of Overtone
        Further modes, each above `frequency`; the drag in time takes them.
    """

    stiffness: float = 9.81e3
    conversion: float = 0.20
    ring_duration: float = 16e-3
    detection_threshold: float = 0.08e-6
    frequency: float = 300.0
    decay_time: float = math.tan(0.5 * math.pi * _BAND_SHARE) / (math.tau * _HALF_BAND)
    frequency_deviation: float = _HALF_BAND
    limits: Limits = SHIPPED_LIMITS
    overtones: tuple[Overtone, ...] = ()
    __repr__ = format_changed_fields

    if TYPE_CHECKING:  # a field holds SI, whatever was given

        def __init__(
            self,
            stiffness: Measure = ...,
            conversion: Measure = ...,
            *,
            ring_duration: Measure = ...,
            detection_threshold: Measure = ...,
            frequency: Measure = ...,
            decay_time: Measure = ...,
            frequency_deviation: Measure = ...,
            limits: Limits = ...,
            overtones: Overtone | Sequence[Overtone] = ...,
        ) -> None: ...

    def __post_init__(self) -> None:
        convert_fields_in_place(
            self,
            stiffness=("stiffness", 1e12),
            conversion=("ratio", 1.0),
            ring_duration=("time", 1e4),
            detection_threshold=("power", 1e3),
            frequency=("frequency", 1e7),
            decay_time=("time", 1e6),
        )
        convert_fields_in_place(self, 0.0, frequency_deviation=("frequency", 1e7))
        if not isinstance(self.limits, Limits):
            raise ContactError(
                "limits must be Limits, such as Limits(hand=9.87), got "
                f"{shorten_value(self.limits)}"
            )
        overtones: object = self.overtones
        if not isinstance(overtones, (list, tuple)):
            overtones = (overtones,)
        for overtone in overtones:
            if not isinstance(overtone, Overtone) or not overtone.frequency > self.frequency:
                raise ContactError(
                    f"overtones must be Overtone objects above the frequency of the tool, "
                    f"{self.frequency:g} Hz, got {shorten_value(overtone)}"
                )
        object.__setattr__(self, "overtones", tuple(overtones))

    @property
    def effective_mass(self) -> float:
        """The mass that rings at this frequency on this spring [kg]."""
        return self.stiffness / (math.tau * self.frequency) ** 2

    @property
    def damping_ratio(self) -> float:
        """Share of critical damping that gives this decay time, ``1 / (2 pi f T)`` [1]."""
        return 1.0 / (math.tau * self.frequency * self.decay_time)


# dimensions of the fields of `Tissue`; a damping is a number alone
_TISSUE = {"stiffness": "stiffness", "damping": "ratio", "friction": "force"}


@dataclass(frozen=True)
class Tissue:
    """A soft wall along which the tool rubs; none by default.

    A spring and a damper (Kelvin, Voigt) lie between both until the wall slips.
    """

    stiffness: float = 0.0  # along the drag [N/m]
    damping: float = 0.0  # N s/m
    friction: float = 0.0  # at which the tool slides along it [N]

    if TYPE_CHECKING:  # a field holds SI, whatever was given

        def __init__(
            self, stiffness: Measure = ..., damping: Measure = ..., friction: Measure = ...
        ) -> None: ...

    def __post_init__(self) -> None:
        for name, dimension in _TISSUE.items():
            value = read_number(f"{name} of the tissue", getattr(self, name), dimension)
            require_not_negative(f"{name} of the tissue", value)
            object.__setattr__(self, name, value)


@dataclass(frozen=True)
class OperatingPoint:
    """Ball, load, friction, speed and tool of a drag.

    Equations (1) and (2) know nothing of the speed, the tissue and the contact, the drag in time
    does.

    Attributes
    ----------
    ball_radius : float
        R of the probe tip [m].
    normal_load : float
        F_py [N].
    friction : float
        Coefficient mu at the release [1]. It may be given as a `FrictionLaw`: the equations take
        its value at rest, the drag in time all of it.
    tool : Tool
        The explorer as a spring that rings.
    speed : float
        Of the handle along the drag [m/s].
    tissue : Tissue
        What the tool rubs along beside the edge.
    friction_law : FrictionLaw, optional
        The law that was given as `friction`.
    contact : ContactLaw, optional
        Contact of tip and surface; that of steel on steel by default.
    """

    ball_radius: float
    normal_load: float
    friction: float
    tool: Tool = Tool()
    speed: float = 5e-3
    tissue: Tissue = Tissue()
    friction_law: FrictionLaw | None = None
    contact: ContactLaw | None = None
    __repr__ = format_changed_fields

    if TYPE_CHECKING:  # a field holds SI, whatever was given

        def __init__(
            self,
            ball_radius: Measure,
            normal_load: Measure,
            friction: Measure | FrictionLaw,
            tool: Tool = ...,
            speed: Measure = ...,
            *,
            tissue: Tissue = ...,
            friction_law: FrictionLaw | None = ...,
            contact: ContactLaw | None = ...,
        ) -> None: ...

    def __post_init__(self) -> None:
        friction: object = self.friction
        if isinstance(friction, FrictionLaw):
            object.__setattr__(self, "friction_law", friction)
        convert_fields_in_place(
            self,
            ball_radius=("length", MOST_BALL),
            normal_load=("force", 1e4),
            speed=("speed", 100.0),
        )
        if self.friction_law is not None:
            at_rest = self.friction_law.coefficient(0.0, self.normal_load, 0.0, 0.0)
            object.__setattr__(self, "friction", at_rest)
        convert_fields_in_place(self, 0.0, friction=("ratio", 1e3))


# The blunt tip and the spring of the paper. It states a band of loads and no friction: 1 N and
# 0.15, steel on steel with a trace of grease, stand for them; 5 mm/s is a speed of the hand.
PAPER = OperatingPoint(ball_radius=125e-6, normal_load=1.0, friction=0.15)
