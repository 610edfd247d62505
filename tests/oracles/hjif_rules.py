"""The rules of MPEG haptics that concern a VectorialWave, in our own reading: what a document of
ours is held against.

They are those that MPEG's public reference software enforces when it loads a file; its JSON schema
is not published with it.
"""

import itertools
import math
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    NonNegativeInt,
    ValidationError,
    model_validator,
)

from stepblocks.errors import HapticsError

_UNIT = 127  # component of a direction that stands for 1
_OFFSET = r"[+-][0-2]\d:[0-5]\dZ?"
_DATE = rf"^[+-]?\d{{4}}(-[01]\d(-[0-3]\d(T[0-2]\d:[0-5]\d:?([0-5]\d(\.\d+)?)?{_OFFSET})?)?)?$"
# the year of publication, from 2023, and the amendment
_VERSION = r"^(20(2[3-9]|[3-9]\d)|2[1-9]\d\d)(-[1-9])?$"
_MODALITY = (
    r"^(Other|Pressure|Acceleration|Velocity|Position|Temperature|Vibrotactile|Water|Wind|Force|"
    r"Vibrotactile Texture|Stiffness|Friction|Electrotactile)$"
)


def _unique(items: list[Any]) -> list[Any]:
    if len({item.id for item in items}) < len(items):
        raise ValueError("id must be unique")
    return items


class _Object(BaseModel):
    model_config = ConfigDict(strict=True, extra="allow", allow_inf_nan=False)


class _Keyframe(_Object):
    relative_position: NonNegativeInt
    amplitude_modulation: float = Field(0.0, ge=-1.0, le=1.0)
    frequency_modulation: int = 0  # Hz; counts where it is given


class _Effect(_Object):
    effect_type: Literal["Basis"]
    position: NonNegativeInt
    phase: float
    base_signal: Literal["Sine", "Square", "Triangle", "SawToothUp", "SawToothDown"]
    keyframes: Annotated[list[_Keyframe], Field(min_length=2)]

    @model_validator(mode="after")
    def _ascends(self) -> "_Effect":
        places = [frame.relative_position for frame in self.keyframes]
        if any(after <= before for before, after in itertools.pairwise(places)):
            raise ValueError("relative_position must ascend")
        return self


class _Band(_Object):
    band_type: Literal["VectorialWave"]
    lower_frequency_limit: NonNegativeInt
    upper_frequency_limit: int
    effects: list[_Effect]

    @model_validator(mode="after")
    def _holds_its_tones(self) -> "_Band":
        low, high = self.lower_frequency_limit, self.upper_frequency_limit
        if low >= high:
            raise ValueError("frequency limits must ascend")
        frames = [frame for effect in self.effects for frame in effect.keyframes]
        tones = [
            frame.frequency_modulation
            for frame in frames
            if "frequency_modulation" in frame.model_fields_set
        ]
        if not all(low <= tone <= high for tone in tones):
            raise ValueError("frequency_modulation must lie within the band")
        if "curve_type" in (self.model_extra or {}):
            raise ValueError("curve_type must stand in Curve bands only")
        return self


class _Direction(_Object):
    X: int
    Y: int
    Z: int

    @model_validator(mode="after")
    def _is_a_unit_vector(self) -> "_Direction":
        if abs(math.hypot(self.X, self.Y, self.Z) / _UNIT - 1.0) > 0.01:
            raise ValueError(f"direction must be a unit vector in whole {_UNIT}ths")
        return self


class _Channel(_Object):
    id: int
    description: str
    gain: float
    mixing_coefficient: float
    body_part_mask: int
    direction: _Direction = _Direction(X=_UNIT, Y=0, Z=0)
    bands: Annotated[list[_Band], Field(max_length=7)]  # of level 1


class _Perception(_Object):
    id: int
    avatar_id: int  # 0 stands for none
    description: str
    perception_modality: Annotated[str, Field(pattern=_MODALITY)]
    effect_library: list[Any]
    channels: Annotated[
        list[_Channel], Field(max_length=127), AfterValidator(_unique)
    ]  # of level 1


class _Body(_Object):
    id: int
    lod: int
    type: Literal["Vibration", "Pressure", "Temperature", "Custom"]


class _Document(_Object):
    version: Annotated[str, Field(pattern=_VERSION)]
    profile: Literal["Main"]
    level: Literal[1]
    date: Annotated[str, Field(pattern=_DATE)]  # ISO 8601, its time with an offset
    description: str
    timescale: Annotated[int, Field(gt=0, le=48_000)]  # ticks per second, in the profile Main
    avatars: Annotated[list[_Body], AfterValidator(_unique)]
    perceptions: Annotated[list[_Perception], AfterValidator(_unique)]
    syncs: list[Any]

    @model_validator(mode="after")
    def _names_its_avatars(self) -> "_Document":
        known = [avatar.id for avatar in self.avatars]
        if 0 in known:
            raise ValueError("an avatar's id must not be 0, which stands for none")
        if not {perception.avatar_id for perception in self.perceptions} <= {0, *known}:
            raise ValueError("avatar_id must name an avatar")
        return self


def check_hjif(document: Any, place: str) -> None:
    """Hold a document against the rules of the standard that concern a VectorialWave, in our own
    reading.
    """
    try:
        _Document.model_validate(document)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"])) or "document"
        raise HapticsError(
            f"{where}: {first['msg']}, got {str(first['input'])[:60]!r} [{place}]"
        ) from error
