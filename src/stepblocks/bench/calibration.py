"""Constants of probe and gauges that are known before the trials, as a session declares them."""

from functools import partial
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from stepblocks.contact.laws import build_declared_laws
from stepblocks.quantities import make_quantity_parser

Stiffness = Annotated[
    float, BeforeValidator(make_quantity_parser("stiffness")), Field(gt=0.0, le=1e9)
]
Frequency = Annotated[
    float, BeforeValidator(make_quantity_parser("frequency")), Field(gt=0.0, le=1e9)
]
_Length = Annotated[float, BeforeValidator(make_quantity_parser("length")), Field(gt=0.0)]
_Force = Annotated[float, BeforeValidator(make_quantity_parser("force"))]
_Ratio = Annotated[float, BeforeValidator(make_quantity_parser("ratio"))]
_Gain = Annotated[_Ratio, Field(gt=0.0)]


class Strict(BaseModel):
    """A table without unknown fields."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def _validate_declared_law(law_kind: str, declared: dict[str, Any]) -> dict[str, Any]:
    """Return a ``friction`` or ``contact`` law as declared; refuse one that cannot be built."""
    build_declared_laws({law_kind: declared})
    return declared


def _refuse_tool_law(_: object) -> None:
    """Refuse any law of the tool."""
    raise ValueError(
        "must be left out: `loop` fits spring, ring and decay of a tool of one mode, and what "
        "overtones do to a release is no law of equations (1) and (2)"
    )


_FrictionLaw = Annotated[
    dict[str, Any], AfterValidator(partial(_validate_declared_law, "friction"))
]
_ContactLaw = Annotated[dict[str, Any], AfterValidator(partial(_validate_declared_law, "contact"))]


class Probe(Strict):
    """The explorer.

    Attributes
    ----------
    spring_constant : Stiffness
        [N/m].
    tip_radius : _Length | None
        [m].
    friction, contact : dict or None
        Laws that are known before the session: the name of each under ``law``, and its numbers.
    tool : None
        A law of the tool, which a set and a sweep accept, is refused with the reason.
    """

    spring_constant: Stiffness
    tip_radius: _Length | None = None
    friction: _FrictionLaw | None = None
    contact: _ContactLaw | None = None
    tool: Annotated[None, BeforeValidator(_refuse_tool_law)] = None


def _convert_gain_to_logarithm(gain_with_std: tuple[float, float]) -> tuple[float, float]:
    """Return the logarithm of a gain with its standard uncertainty."""
    gain, std = gain_with_std
    return float(np.log(gain)), std / gain


def _convert_corner_frequency_to_time_constant(
    frequency_with_std: tuple[float, float],
) -> tuple[float, float]:
    """Return a time constant [s] with its standard uncertainty from a corner frequency [Hz]."""
    frequency, std = frequency_with_std
    return 0.5 / np.pi / frequency, 0.5 / np.pi * std / frequency**2


# pairs of a value and its standard uncertainty
_KnownZero = tuple[_Force, Annotated[_Force, Field(gt=0.0)]] | None
_KnownShare = tuple[_Ratio, _Gain] | None
_KnownGain = Annotated[tuple[_Gain, _Gain], AfterValidator(_convert_gain_to_logarithm)] | None
_KnownBandwidth = (
    Annotated[
        tuple[Frequency, Frequency], AfterValidator(_convert_corner_frequency_to_time_constant)
    ]
    | None
)
_KnownStiffness = tuple[Stiffness, Stiffness] | None


class Calibration(Strict):
    """Value and standard uncertainty of each constant, by its parameter in the laws.

    None where it is not known.

    Attributes
    ----------
    tangential_zero, normal_zero : pair of forces
        Readings of the gauges without load [N].
    tangential_gain, normal_gain : pair of ratios
        Logarithm of the gains of the gauges [1].
    cross_talk : pair of ratios
        Share of the normal force in the tangential gauge [1].
    normal_cross_talk : pair of ratios
        Share of the tangential force in the normal gauge [1].
    bandwidth : pair of frequencies
        Time constant of the tangential gauge [s].
    clock : pair of ratios
        Logarithm of the shown over the true time [1].
    spring_constant : pair of stiffnesses
        With the error of the handle's speed [N/m].
    load_error : pair of forces
        Difference between the load and what is set, alike in all trials [N].
    """

    tangential_zero: _KnownZero = Field(default=None, serialization_alias="zero_n")
    normal_zero: _KnownZero = Field(default=None, serialization_alias="normal_zero_n")
    tangential_gain: _KnownGain = Field(default=None, serialization_alias="ln_gain")
    normal_gain: _KnownGain = Field(default=None, serialization_alias="normal_ln_gain")
    cross_talk: _KnownShare = None
    normal_cross_talk: _KnownShare = None
    bandwidth: _KnownBandwidth = Field(default=None, serialization_alias="time_constant_s")
    clock: _KnownGain = Field(default=None, serialization_alias="ln_clock")
    spring_constant: _KnownStiffness = None
    load_error: _KnownZero = Field(default=None, serialization_alias="load_bias_n")

    def list_known_constants(self) -> dict[str, tuple[float, float]]:
        """Return the known constants with standard uncertainties, by the names of the laws."""
        return self.model_dump(by_alias=True, exclude_none=True)
