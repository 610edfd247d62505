"""Force-feedback devices as data: every figure with its source and how far it can be trusted."""

from __future__ import annotations

import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from stepblocks.errors import HapticsError
from stepblocks.quantities import parse_quantity

_MAX_FILE_BYTES = 200_000


class Figure(BaseModel):
    """One figure of a device."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    value: float  # in SI
    source: Annotated[str, Field(min_length=1, max_length=200)]
    confidence: Literal["datasheet", "code", "remembered", "assumed"]


def _figure(dimension: str) -> BeforeValidator:
    def parse(raw: object) -> object:
        if isinstance(raw, dict) and "value" in raw:
            value = parse_quantity(raw["value"], dimension)
            if value <= 0.0:
                raise ValueError(f"value must be positive, got {raw['value']!r}")
            return {**raw, "value": value}
        return raw

    return BeforeValidator(parse)


Length = Annotated[Figure, _figure("length")]
Force = Annotated[Figure, _figure("force")]


class Device(BaseModel):
    """A force-feedback device; a figure that nobody stated is None."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    id: Annotated[str, Field(pattern=r"^[a-z][a-z0-9]*(-[a-z0-9]+)*$", max_length=40)]
    name: Annotated[str, Field(min_length=1, max_length=60)]
    maker: Annotated[str, Field(min_length=1, max_length=60)]
    position_resolution: Length  # smallest step of the measured position [m]
    peak_force: Force  # N
    continuous_force: Force | None = None  # that it can hold [N]
    stiffness_limit: Annotated[Figure, _figure("stiffness")] | None = None  # stiffest spring rendered stably [N/m]
    update_rate: Annotated[Figure, _figure("frequency")]  # of the servo loop [Hz]
    travel: Length | None = None  # shortest side of the workspace [m]
    actuated_axes: Annotated[int, Field(ge=1, le=12)]  # degrees of freedom
    sensed_axes: Annotated[int, Field(ge=1, le=12)]


class _DeviceFile(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    device: Annotated[tuple[Device, ...], Field(min_length=1, max_length=500)]


def load_devices(path: str | Path | None = None) -> tuple[Device, ...]:
    """Read device profiles: the shipped ones, and those of a file of the user's.

    Examples
    --------
    >>> [device.id for device in load_devices()][:3]
    ['touch', 'touch-x', 'premium-1-5']
    """
    shipped = files("stepblocks.simulators").joinpath("devices.toml").read_text(encoding="utf-8")
    devices = {device.id: device for device in _parse(shipped, "devices.toml")}
    if path is not None:
        devices |= {device.id: device for device in _parse(_text(Path(path)), str(path))}
    return tuple(devices.values())


def _text(path: Path) -> str:
    try:
        if path.stat().st_size > _MAX_FILE_BYTES:
            raise HapticsError(f"a device file must be at most {_MAX_FILE_BYTES} bytes, got more [{path}]")
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise HapticsError(f"cannot be read: {error.strerror} [{path}]") from error
    except UnicodeDecodeError as error:
        raise HapticsError(f"must be UTF-8 text: byte {error.start} is not [{path}]") from error


def _parse(text: str, place: str) -> tuple[Device, ...]:
    try:
        return _DeviceFile.model_validate(tomllib.loads(text)).device
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise HapticsError(f"must be TOML: {error} [{place}]") from error
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise HapticsError(f"{where}: {first['msg']}, got {first.get('input')!r:.60} [{place}]") from error


def device_named(name: str, devices: tuple[Device, ...]) -> Device:
    """Find a device by its id.

    Examples
    --------
    >>> device_named("omega-3", load_devices()).peak_force.value
    12.0
    """
    found = {device.id: device for device in devices}
    if name not in found:
        raise HapticsError(f"device must be one of {', '.join(found)}, got {name!r}")
    return found[name]
