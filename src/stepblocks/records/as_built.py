"""The as-built record: what a machined stimulus measures, with uncertainty.

Predictions and the closed loop read it.
"""

import hashlib
import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tomli_w
from pydantic import BaseModel, BeforeValidator, Field

from stepblocks.errors import MetrologyError, PipelineError
from stepblocks.files.atomic import replace_text
from stepblocks.files.text import escape_file_name, is_file, read_document
from stepblocks.mistakes import validate_data
from stepblocks.quantities import format_quantity, make_quantity_parser
from stepblocks.scans.scan import ScannedProfile
from stepblocks.scans.text import read_text_scan

_SCHEMA = 1  # of the record's format
_TEXTS = ("stimulus", "scan", "scan_sha256", "convention")
_LENGTH = BeforeValidator(make_quantity_parser("length"))


@dataclass(frozen=True)
class AsBuiltValue:
    """One measured characteristic."""

    value: Annotated[float, _LENGTH]  # m
    std: Annotated[float, Field(ge=0.0), _LENGTH]  # combined standard uncertainty [m]
    verdict: str  # against the limits of the stimulus


@dataclass(frozen=True)
class AsBuilt:
    """What is known of one machined stimulus.

    Attributes
    ----------
    stimulus : str
        Identity of the part.
    scan, scan_sha256 : str
        File name of the scan, and the hash of its bytes.
    convention : str
        How the values are defined.
    values : dict of str to AsBuiltValue
        By key of the characteristic, such as ``step_height``: ``value`` and ``std``, its combined
        standard uncertainty [m], and ``verdict`` against the limits of the stimulus.
    surface : ScannedProfile, optional
        Levelled profile across the edge, for what the values do not say of its form.
    arc : bool
        Whether the edge is an arc; where not, its surface says what its radius cannot.
    """

    stimulus: str
    scan: str
    scan_sha256: str = field(repr=False)
    convention: str = field(repr=False)
    values: dict[str, AsBuiltValue] = field(repr=False)
    surface: ScannedProfile | None = field(default=None, compare=False, repr=False)
    arc: bool = True

    @property
    def height(self) -> AsBuiltValue | None:
        """Height of the step, measured at the edge itself or at the feature that is as high."""
        return next(
            (
                self.values[key]
                for key in ("step_height", "groove_depth", "ridge_height")
                if key in self.values
            ),
            None,
        )


class _Record(BaseModel):
    # A record as it stands in its file.
    version: Literal[1] = Field(alias="schema")
    stimulus: str
    scan: str
    scan_sha256: str
    convention: str
    values: Annotated[dict[str, AsBuiltValue], Field(min_length=1)]
    edge_is_arc: bool = True
    profile: str | None = None
    profile_sha256: str = ""


def write_as_built(path: Path, record: AsBuilt) -> list[Path]:
    """Write a record as TOML with units, and its surface beside it as CSV; return both paths."""
    document: dict[str, object] = {
        "schema": _SCHEMA,
        **{name: escape_file_name(getattr(record, name)) for name in _TEXTS},
        **({} if record.arc else {"edge_is_arc": False}),
    }
    written = [path]
    if record.surface is not None:
        table = io.StringIO()
        np.savetxt(
            table,
            np.column_stack([record.surface.position, record.surface.height]) * 1e6,
            "%.6f",
            ",",
            header="x_um,z_um",
            comments="",
        )
        written.append(path.with_name(f"{path.stem}.profile.csv"))
        replace_text(written[-1], table.getvalue())
        document |= {
            "profile": written[-1].name,
            "profile_sha256": hashlib.sha256(table.getvalue().encode()).hexdigest(),
        }
    document["values"] = {
        key: {
            "value": format_quantity(one.value, "length", 9),
            "std": format_quantity(one.std, "length", 4),
            "verdict": one.verdict,
        }
        for key, one in record.values.items()
    }
    replace_text(path, tomli_w.dumps(document))
    return written


def read_as_built(path: str | Path) -> AsBuilt:
    """Read a record of `stepblocks inspect`.

    Parameters
    ----------
    path : str or Path
        ``<id>.as-built.toml``; the profile that it names must lie beside it.

    Returns
    -------
    AsBuilt
        Values in SI, and the scanned profile where the record has one.

    Raises
    ------
    MetrologyError
        If the file is no such record, or the profile is missing or not the one that was inspected.
    """
    path = Path(path)
    raw = validate_data(
        _Record, read_document(path, "record", MetrologyError), path, MetrologyError
    )
    return AsBuilt(
        raw.stimulus,
        raw.scan,
        raw.scan_sha256,
        raw.convention,
        raw.values,
        _read_surface(path, raw.profile, raw.profile_sha256),
        raw.edge_is_arc,
    )


def read_records(paths: Sequence[Path]) -> dict[str, AsBuilt]:
    """Read one record of each stimulus from files and folders of records."""
    files = [
        file
        for path in paths
        for file in (sorted(path.glob("*.as-built.toml")) if path.is_dir() else [path])
    ]
    records: dict[str, AsBuilt] = {}
    for file in files:
        record = read_as_built(file)
        PipelineError.require(
            records.setdefault(record.stimulus, record) is record,
            f"records must name each stimulus once, got {record.stimulus} twice [{file}]",
        )
    PipelineError.require(records, "expected at least one record (*.as-built.toml), got none")
    return records


def list_measured_edges(records: dict[str, AsBuilt]) -> dict[str, dict[str, float]]:
    """List heights and edge radii of inspected blocks for the closed loop, units in the names."""
    edges: dict[str, dict[str, float]] = {}
    for block, record in records.items():
        for name, one in (
            ("height", record.height),
            ("edge_radius", record.values.get("edge_radius")),
        ):
            if record.height is not None and one is not None:
                edges.setdefault(block, {}).update(
                    {f"{name}_m": one.value, f"{name}_std_m": one.std}
                )
    return edges


def _read_surface(record: Path, name: str | None, digest: str) -> ScannedProfile | None:
    if name is None:
        return None
    MetrologyError.require(
        digest and Path(name).name == name,
        "profile must be the name of a file beside the record, with profile_sha256, got "
        f"{name!r} [{record}]",
    )
    path = record.with_name(name)
    MetrologyError.require(
        is_file(path), f"profile must lie beside the record, missing {name!r} [{record}]"
    )
    surface = read_text_scan(path)
    if hashlib.sha256(path.read_bytes()).hexdigest() != digest or not isinstance(
        surface, ScannedProfile
    ):
        raise MetrologyError(
            f"profile must be the one that was inspected, got another under the name {name!r} "
            f"[{record}]"
        )
    return surface
