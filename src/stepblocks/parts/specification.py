"""The resolved specification: what was asked for after defaults and series, with the unit in the name of every field."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from stepblocks.parts.energy_tolerance import EnergyTolerance, plain_budget
from stepblocks.parts.material import Material
from stepblocks.parts.probe import DampingRig, ProbeSpec
from stepblocks.parts.set import Stimulus
from stepblocks.parts.sheath.declaration import SheathMaterial
from stepblocks.parts.sourced import Sourced
from stepblocks.parts.tolerance import Dimension

# What people call each kind
KIND_NAMES = {
    "StepBlock": "step block",
    "MarginBlock": "margin block",
    "CrownOnTooth": "crown on tooth",
    "StraightTip": "straight probe tip",
    "HookTip": "shepherd's hook",
    "Sheath": "sheath of the probe",
}


def resolved(stimulus: Stimulus) -> dict[str, Any]:
    """Write a stimulus out in full."""
    return {"kind": KIND_NAMES[type(stimulus).__name__], **_table(stimulus)}


def resolved_probe(part: ProbeSpec | DampingRig) -> dict[str, Any]:
    """Write the probe or the rig of a set out in full."""
    return _table(part)


def _table(model: BaseModel) -> dict[str, Any]:
    return {name: _plain(getattr(model, name)) for name in type(model).model_fields if getattr(model, name) is not None}


def _plain(value: Any) -> Any:
    match value:
        case Dimension():
            unit = "rad" if value.quantity == "angle" else "m"
            record: dict[str, Any] = {
                f"nominal_{unit}": value.nominal,
                f"upper_deviation_{unit}": value.upper,
                f"lower_deviation_{unit}": value.lower,
                "tolerance": "by energy" if value.by_energy else "ISO 2768-m" if value.general else "stated",
            }
            return {**record, "source": value.source} if value.source else record
        case EnergyTolerance():
            return plain_budget(value)
        case Sourced():
            return value.record()
        case Material():
            told = {
                "name": value.name,
                "designation": value.designation,
                "density_kg_m3": value.density,
                "source": value.source,
            }
            if isinstance(value, SheathMaterial):
                told |= {
                    "modulus_pa": value.modulus,
                    "modulus_source": value.modulus_source,
                    "poisson": value.poisson,
                    "poisson_source": value.poisson_source,
                    "loss_factor": value.loss_factor,
                    "loss_factor_source": value.loss_source,
                }
            return told
        case BaseModel():
            return _table(value)
        case _:
            return value


def dimensions(stimulus: Stimulus) -> list[tuple[str, Dimension]]:
    """List every dimension of a stimulus with the name of its field."""
    return list(_walk(stimulus, ""))


def _walk(model: BaseModel, prefix: str) -> list[tuple[str, Dimension]]:
    found: list[tuple[str, Dimension]] = []
    for name in type(model).model_fields:
        value = getattr(model, name)
        if isinstance(value, Dimension):
            found.append((prefix + name, value))
        elif isinstance(value, BaseModel) and not isinstance(value, EnergyTolerance):
            found += _walk(value, f"{prefix}{name}.")
    return found
