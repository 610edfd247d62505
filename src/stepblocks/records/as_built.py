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
from stepblocks.mistakes import validate_file_data
from stepblocks.quantities import format_quantity, make_quantity_parser
from stepblocks.scans.scan import ScannedProfile
from stepblocks.scans.text import read_text_scan

# characteristics that are the height of a step: at the edge itself, or of a feature that is as high
_HEIGHTS = ("step_height", "groove_depth", "ridge_height")
_RECORDS = "*.as-built.toml"
_FAILED = "does not conform"  # verdict of what lies outside of its limits
_VALUE_DIGITS = 9  # of a value in the record
_STD_DIGITS = 4  # of its standard uncertainty
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
        for key in _HEIGHTS:
            if key in self.values:
                return self.values[key]
        return None

    @property
    def contact_height(self) -> float | None:
        """Height that a tip meets [m]: the step with a burr on it that does not conform."""
        return _compute_contact_height(self.height, self.values.get("burr"))

    @property
    def second_height(self) -> AsBuiltValue | None:
        """Height of the second step; None where there is none, or it was not measured."""
        return self.values.get("second_step_height")

    @property
    def second_contact_height(self) -> float | None:
        """Height that a tip meets at the second step [m], as `contact_height`."""
        return _compute_contact_height(self.second_height, self.values.get("second_burr"))


def _compute_contact_height(
    measured_height: AsBuiltValue | None, burr: AsBuiltValue | None
) -> float | None:
    """Compute a height [m] with a burr that fails its limit on it; None without a height."""
    if measured_height is None:
        return None
    if burr is None or burr.verdict != _FAILED:
        return measured_height.value
    return measured_height.value + burr.value


class _Head(BaseModel):
    """A record as it stands in its file, without its values."""

    version: Literal[1] = Field(alias="schema")
    stimulus: str
    scan: str
    scan_sha256: str
    convention: str
    edge_is_arc: bool = True
    profile: str | None = None
    profile_sha256: str = ""


class _Record(_Head):
    """A record as it is read."""

    values: Annotated[dict[str, AsBuiltValue], Field(min_length=1)]


class _WrittenValue(BaseModel):
    """A value and its uncertainty with their units."""

    value: str
    std: str
    verdict: str


class _WrittenRecord(_Head):
    """A record as it is written."""

    values: dict[str, _WrittenValue]

    def to_toml(self) -> str:
        """Return the text of the file; what has its usual value is left out."""
        return tomli_w.dumps(self.model_dump(by_alias=True, exclude_defaults=True))


def write_as_built(path: Path, record: AsBuilt) -> list[Path]:
    """Write a record as TOML with units, and its surface beside it as CSV.

    Parameters
    ----------
    path : Path
        Of the record, ``<id>.as-built.toml``.
    record : AsBuilt
        What is known of the part.

    Returns
    -------
    list of Path
        The record, and ``<id>.as-built.profile.csv`` where it has a surface.
    """
    written = [path]
    profile = None
    digest = ""
    if record.surface is not None:
        table = _format_profile_csv(record.surface)
        surface_path = path.with_name(f"{path.stem}.profile.csv")
        replace_text(surface_path, table)
        written.append(surface_path)
        profile = surface_path.name
        digest = hashlib.sha256(table.encode()).hexdigest()
    document = _WrittenRecord(
        schema=1,
        stimulus=escape_file_name(record.stimulus),
        scan=escape_file_name(record.scan),
        scan_sha256=escape_file_name(record.scan_sha256),
        convention=escape_file_name(record.convention),
        edge_is_arc=record.arc,
        profile=profile,
        profile_sha256=digest,
        values={key: _format_value_with_units(value) for key, value in record.values.items()},
    )
    replace_text(path, document.to_toml())
    return written


def _format_value_with_units(value: AsBuiltValue) -> _WrittenValue:
    """Return a value with its unit."""
    return _WrittenValue(
        value=format_quantity(value.value, "length", _VALUE_DIGITS),
        std=format_quantity(value.std, "length", _STD_DIGITS),
        verdict=value.verdict,
    )


def _format_profile_csv(surface: ScannedProfile) -> str:
    """Return positions and heights of a profile as CSV, in micrometres."""
    table = io.StringIO()
    columns = np.column_stack([surface.position, surface.height]) * 1e6
    np.savetxt(table, columns, "%.6f", ",", header="x_um,z_um", comments="")
    return table.getvalue()


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
    document = read_document(path, "record", MetrologyError)
    record = validate_file_data(_Record, document, path, MetrologyError)
    surface = None
    if record.profile is not None:
        surface = _read_verified_surface(path, record.profile, record.profile_sha256)
    return AsBuilt(
        stimulus=record.stimulus,
        scan=record.scan,
        scan_sha256=record.scan_sha256,
        convention=record.convention,
        values=record.values,
        surface=surface,
        arc=record.edge_is_arc,
    )


def read_one_record_per_stimulus(record_paths: Sequence[Path]) -> dict[str, AsBuilt]:
    """Read one record of each stimulus from files and folders of records.

    Raises
    ------
    PipelineError
        If there is no record, or two of one stimulus.
    """
    records: dict[str, AsBuilt] = {}
    for serial, of_block in read_records_by_serial(record_paths).items():
        for stimulus, record in of_block.items():
            if stimulus in records:
                raise PipelineError(
                    f"records must name each stimulus once, got {stimulus} twice: give the folder "
                    f"of one serial number [{serial}]"
                )
            records[stimulus] = record
    return records


def read_records_by_serial(record_paths: Sequence[Path]) -> dict[str, dict[str, AsBuilt]]:
    """Read the records of several blocks, by serial number and stimulus.

    Parameters
    ----------
    record_paths : sequence of Path
        Files; folders of them; and folders that `write_many` wrote, with one folder for each serial
        number.

    Returns
    -------
    dict
        Records by stimulus, by serial number; those that no folder names have an empty one.

    Raises
    ------
    PipelineError
        If there is no record, or two of one stimulus under one number.
    """
    groups: dict[str, dict[str, AsBuilt]] = {}
    for serial, file in _list_record_files_with_serials(record_paths):
        record = read_as_built(file)
        group = groups.setdefault(serial, {})
        if record.stimulus in group:
            raise PipelineError(
                f"records must name each stimulus once, got {record.stimulus} twice [{file}]"
            )
        group[record.stimulus] = record
    if not groups:
        raise PipelineError("expected at least one record (*.as-built.toml), got none")
    return groups


def _list_record_files_with_serials(record_paths: Sequence[Path]) -> list[tuple[str, Path]]:
    """List records with their serial numbers: files, those of folders and of folders in these."""
    files: list[tuple[str, Path]] = []
    for path in record_paths:
        if not path.is_dir():
            files.append(("", path))
            continue
        for file in sorted(path.glob(_RECORDS)):
            files.append(("", file))
        for file in sorted(path.glob(f"*/{_RECORDS}")):
            files.append((file.parent.name, file))
    return files


def collect_measured_edges(records_by_block: dict[str, AsBuilt]) -> dict[str, dict[str, float]]:
    """List heights and edge radii of inspected blocks for the closed loop, units in the names.

    A block of which no height was measured is left out.
    """
    edges: dict[str, dict[str, float]] = {}
    for block, record in records_by_block.items():
        height = record.height
        if height is None:
            continue
        edges[block] = {"height_m": height.value, "height_std_m": height.std}
        radius = record.values.get("edge_radius")
        if radius is not None:
            edges[block] |= {"edge_radius_m": radius.value, "edge_radius_std_m": radius.std}
    return edges


def _read_verified_surface(
    record_path: Path, file_name: str, expected_sha256: str
) -> ScannedProfile:
    """Read the profile that a record names, which must have this SHA-256 and lie beside it."""
    if not expected_sha256 or Path(file_name).name != file_name:
        raise MetrologyError(
            "profile must be the name of a file beside the record, with profile_sha256, got "
            f"{file_name!r} [{record_path}]"
        )
    path = record_path.with_name(file_name)
    if not is_file(path):
        raise MetrologyError(
            f"profile must lie beside the record, missing {file_name!r} [{record_path}]"
        )
    surface = read_text_scan(path)
    is_inspected = hashlib.sha256(path.read_bytes()).hexdigest() == expected_sha256
    if not is_inspected or not isinstance(surface, ScannedProfile):
        raise MetrologyError(
            f"profile must be the one that was inspected, got another under the name {file_name!r} "
            f"[{record_path}]"
        )
    return surface
