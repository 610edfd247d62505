"""What is known of probe and gauges before the trials, as a session declares it."""

from functools import partial
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from stepblocks.contact.laws import build_laws
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
    """A table that may hold nothing but its fields."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def _require_law(kind: str, declared: dict[str, Any]) -> dict[str, Any]:
    build_laws({kind: declared})
    return declared


def _refuse_tool(_: object) -> None:
    raise ValueError(
        "must be left out: `loop` fits spring, ring and decay of a tool of one mode, and what "
        "overtones do to a release is no law of equations (1) and (2)"
    )


class Probe(Strict):
    """The explorer.

    Attributes
    ----------
    spring_constant : Stiffness
        [N/m].
    tip_radius : _Length | None
        [m].
    friction, contact : dict or None
        Laws that are known beforehand: the name of each under ``law``, and its numbers.
    tool : None
        What a set and a sweep know as a law of the tool is refused, with the reason.
    """

    spring_constant: Stiffness
    tip_radius: _Length | None = None
    friction: (
        Annotated[dict[str, Any], AfterValidator(partial(_require_law, "friction"))] | None
    ) = None
    contact: Annotated[dict[str, Any], AfterValidator(partial(_require_law, "contact"))] | None = (
        None
    )
    tool: Annotated[None, BeforeValidator(_refuse_tool)] = None


_KnownZero = tuple[_Force, Annotated[_Force, Field(gt=0.0)]] | None
_KnownShare = tuple[_Ratio, _Gain] | None
# of gains the law has the logarithm
_KnownGain = (
    Annotated[
        tuple[_Gain, _Gain],
        AfterValidator(lambda known: (float(np.log(known[0])), known[1] / known[0])),
    ]
    | None
)
# and of a corner frequency the time constant
_KnownBandwidth = (
    Annotated[
        tuple[Frequency, Frequency],
        AfterValidator(
            lambda known: (0.5 / np.pi / known[0], 0.5 / np.pi * known[1] / known[0] ** 2)
        ),
    ]
    | None
)


class Calibration(Strict):
    """Value and standard uncertainty of each constant, by its parameter in the laws.

    None where it is not known.
    """

    tangential_zero: _KnownZero = Field(default=None, serialization_alias="zero_n")
    normal_zero: _KnownZero = Field(default=None, serialization_alias="normal_zero_n")
    tangential_gain: _KnownGain = Field(default=None, serialization_alias="ln_gain")
    normal_gain: _KnownGain = Field(default=None, serialization_alias="normal_ln_gain")
    cross_talk: _KnownShare = None  # normal force in the tangential gauge
    normal_cross_talk: _KnownShare = None  # tangential force in the normal one
    bandwidth: _KnownBandwidth = Field(default=None, serialization_alias="time_constant_s")
    clock: _KnownGain = Field(default=None, serialization_alias="ln_clock")  # shown over true time
    spring_constant: tuple[Stiffness, Stiffness] | None = (
        None  # with the error of the handle's speed
    )
    # by which the load differs from what is set, in all trials alike
    load_error: _KnownZero = Field(default=None, serialization_alias="load_bias_n")

    def list_known(self) -> dict[str, tuple[float, float]]:
        """Return what is known by the names of parameters."""
        return self.model_dump(by_alias=True, exclude_none=True)
