"""Every artefact of a stimulus, read back from disk and measured against what was asked for.

A mesh is read by another library than wrote it, STEP by a parser of its text beside the kernel,
TIFF by Pillow; heights are compared with a closed form of the section that did not write them.
"""

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stepblocks.artefacts.meshes.measures import MeshMeasures
from stepblocks.artefacts.meshes.read import MESH_READERS, read_mesh, read_pieces
from stepblocks.artefacts.step.check_step import (
    ALLOWED,
    Characteristic,
    StepReport,
    check_step,
    choose_display_unit,
)
from stepblocks.errors import MetrologyError
from stepblocks.files.confined import read_confined
from stepblocks.files.text import Document, read_document
from stepblocks.parts.body import Block
from stepblocks.parts.characteristics import FORM, Characteristic as Wanted
from stepblocks.parts.kind import NANOMETRE, Part
from stepblocks.parts.verdict import Finding, Verdict

VOLUME_LIMIT = 1e-6  # volume against its closed form, relative
_PIECES_LIMIT = 2e-3  # pieces of a body of revolution are polygons of 96 sides: 1 - sin(t)/t


def check_artefact(part: Part, path: str | Path) -> list[Verdict]:
    """Read one artefact back and measure it.

    Parameters
    ----------
    part : Part
        What was asked for.
    path : str or Path
        The artefact; its name says what it is.

    Returns
    -------
    list of Verdict
        At least one; a file that cannot be read fails as such.

    Raises
    ------
    MetrologyError
        If the name is that of no artefact.
    """
    path = Path(path)
    kind = "".join(path.suffixes[-2:]) if path.name.endswith(".convex.obj") else path.suffix
    checker = _CHECKERS.get(kind)
    if checker is None:
        raise MetrologyError(
            f"must be one of {', '.join(sorted(_CHECKERS))}, got {path.suffix or 'no suffix'} "
            f"[{path}]"
        )
    try:
        found = list(checker(part, path))
    except MetrologyError as error:
        found = [Finding(str(error), 1.0, 0.0, 0.0, "file")]
    return [replace(one, artefact=path.name) for one in found]


def _check_step(stimulus: Part, path: Path) -> Iterator[Verdict]:
    report, findings = check_part_step(path, stimulus)
    yield Finding(
        "schema AP242",
        1.0,
        float(any("AP242" in schema for schema in report.schema)),
        0.0,
        "count",
    )
    found_volumes = read_confined(f"{__name__}:measure_volumes", path, raises=MetrologyError)[
        "volumes"
    ]
    volumes = stimulus.volumes()
    yield Finding("solids", len(volumes), len(found_volumes), 0.0, "count")
    for index, (volume, found_volume) in enumerate(
        zip(volumes, found_volumes, strict=False), start=1
    ):
        yield Finding(
            f"volume of solid {index}", volume, found_volume, 1e-6, "volume", relative=True
        )
    for one, found in match_characteristics(report, stimulus):
        if one.kind not in FORM:
            yield Finding(
                f"{one.label}, of its faces",
                one.nominal,
                math.nan if found is None or found.geometry is None else found.geometry,
                ALLOWED,
                one.quantity,
                relative=one.quantity == "angle",
            )
    yield Finding(
        f"tolerances, material and types as asked for{f' ({findings[0]})' if findings else ''}",
        0.0,
        len(findings),
        0.0,
        "count",
    )


def measure_volumes(path: Path) -> dict[str, object]:
    """Integrate the volume of each solid by the kernel, in the confined process."""
    from stepblocks.cad import kernel

    return {"volumes": [kernel.compute_volume(body) for body in kernel.read_step(path)]}


def check_part_step(path: Path, stimulus: Part) -> tuple[StepReport, list[str]]:
    """Check that the STEP file of a part conforms and holds every characteristic."""
    report = check_step(path, require_ap242=True)
    findings = list(report.findings)
    left = [*report.dimensions, *report.tolerances]
    pairs = match_characteristics(report, stimulus)
    for one, found in pairs:
        if found is None:
            scale, unit = choose_display_unit(one.quantity == "angle")
            values = ", ".join(f"{value * scale:.9g}" for value in _list_values(one))
            findings.append(f"{one.label}: must stand in the file as {one.kind} of {values} {unit}")
        else:
            left.remove(found)
            if found in report.dimensions and found.geometry is None and not found.problem:
                findings.append(
                    f"{found.ref} {one.label}: the faces that it names do not determine it"
                )
    findings += [
        f"{item.ref} {item.kind} {item.value * 1e3:.9g} mm: was not asked for" for item in left
    ]
    if stimulus.has_working_faces:
        flat = {
            face
            for one, found in pairs
            if found and one.key in ("flatness_lower", "flatness_upper")
            for face in found.faces
        }
        rough = stimulus.face_demands["roughness"].upper
        if dict(report.textures).keys() != flat or any(
            abs(value - rough) > ALLOWED for _, value in report.textures
        ):
            findings.append(f"surface texture: every working face must have Ra {rough * 1e6:g} um")
    stated = stimulus.material.density
    if (not report.densities) != (stated is None) or any(
        stated is None or abs(value / stated.value - 1.0) > 1e-9 for value in report.densities
    ):
        wanted = "not be stated" if stated is None else f"be {stated.value:g} kg/m^3"
        findings.append(
            f"density must {wanted}, got {', '.join(map(str, report.densities)) or 'none'}"
        )
    if not report.materials or any(
        name != stimulus.material.order_text for name in report.materials
    ):
        findings.append(
            f"material must be {stimulus.material.order_text!r}, got "
            + (", ".join(report.materials) or "none")
        )
    return report, findings


def match_characteristics(
    report: StepReport, stimulus: Part
) -> list[tuple[Wanted, Characteristic | None]]:
    """Find every characteristic of a part in its file."""
    left = [*report.dimensions, *report.tolerances]
    pairs: list[tuple[Wanted, Characteristic | None]] = []
    for one in (one for one in stimulus.characteristics() if one.kind not in ("note", "roughness")):
        label = one.label if one.kind in ("distance", "angle") else ""
        found = next(
            (
                item
                for item in left
                if item.name == label and _is_same_value(item, one.kind, _list_values(one))
            ),
            None,
        )
        if found is not None:
            left.remove(found)
        pairs.append((one, found))
    return pairs


def _list_values(characteristic: Wanted) -> tuple[float, ...]:
    return (
        (characteristic.upper,)
        if characteristic.kind in FORM
        else (characteristic.nominal, characteristic.lower, characteristic.upper)
    )


# What a kind of ours is called in the file, after the surface that carries it
_NAMES = {
    "distance": ("linear distance", "linear distance centre outer"),
    "angle": ("angular size", "angular location"),
    "radius": ("radius", "spherical radius", "toroidal major radius"),
}


def _is_same_value(item: Characteristic, kind: str, declared: tuple[float, ...]) -> bool:
    got = (item.value,) if len(declared) == 1 else (item.value, item.lower, item.upper)
    return item.kind in _NAMES.get(kind, (kind,)) and all(
        abs(a - b) <= ALLOWED for a, b in zip(got, declared, strict=True)
    )


def _check_mesh(part: Part, path: Path) -> Iterator[Verdict]:
    mesh = MeshMeasures(*read_mesh(path))
    body = part.bodies.index(path.stem) if path.stem in part.bodies else 0
    yield Finding("edges without exactly one neighbour", 0.0, mesh.count_bad_edges(), 0.0, "count")
    yield Finding(
        "volume", part.volumes()[body], mesh.volume, VOLUME_LIMIT, "volume", relative=True
    )
    yield from part.measure_mesh(body, mesh)


def _check_pieces(part: Part, path: Path) -> Iterator[Verdict]:
    pieces = [MeshMeasures(*arrays) for arrays in read_pieces(path)]
    yield Finding(
        "edges without exactly one neighbour",
        0.0,
        sum(piece.count_bad_edges() for piece in pieces),
        0.0,
        "count",
    )
    yield Finding(
        "concavity of the pieces",
        0.0,
        max(piece.measure_concavity() for piece in pieces),
        NANOMETRE,
    )
    yield Finding(
        "volume of the pieces",
        math.fsum(part.volumes()) + part.removed_volume,
        math.fsum(piece.volume for piece in pieces),
        _PIECES_LIMIT if part.is_turned else VOLUME_LIMIT,
        "volume",
        relative=True,
    )


def read_image(path: Path, mode: str = "") -> dict[str, object]:
    """Read an image; called in the confined process, as `read_arrays` is."""
    from PIL import Image

    with Image.open(path) as image:
        return {"pixels": np.asarray(image.convert(mode) if mode else image)}


def read_arrays(path: Path) -> dict[str, object]:
    """Read the heights and positions of an npz."""
    with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
        return {
            name: np.asarray(archive[name], dtype=np.float64) for name in ("height_m", "x_m", "y_m")
        }


def _check_tiff(part: Part, path: Path) -> Iterator[Verdict]:
    heights = read_confined(f"{__name__}:read_image", path, raises=MetrologyError)["pixels"]
    yield Finding(
        "bits per height, floating point",
        32.0,
        8.0 * heights.dtype.itemsize * (heights.dtype.kind == "f"),
        0.0,
        "count",
    )
    yield from _check_field(part, path, heights.astype(np.float64) * 1e-6, _read_sidecar(path))


def _check_npz(part: Part, path: Path) -> Iterator[Verdict]:
    found = read_confined(f"{__name__}:read_arrays", path, raises=MetrologyError)
    heights, columns, rows = (found[name] for name in ("height_m", "x_m", "y_m"))
    side = _read_sidecar(path)
    yield from _check_field(part, path, heights, side)
    # heights that are equal along y cannot tell swapped rows; the positions that the archive gives
    # them can
    for name, found in (("x", columns), ("y", rows)):
        expected = side[f"origin_{name}_m"] + side[f"spacing_{name}_m"] * np.arange(found.size)
        worst = np.abs(found - expected).max() if found.ndim == 1 and found.size else math.inf
        yield Finding(f"positions along {name}", 0.0, float(worst), NANOMETRE)


def _read_sidecar(path: Path) -> Document:
    # Read where the points of a height field lie
    try:
        side = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
        return {"shape": side["shape_rows_columns"]} | {
            name: float(side[name])
            for name in ("origin_x_m", "origin_y_m", "spacing_x_m", "spacing_y_m")
        }
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise MetrologyError(
            f"needs its sidecar {path.stem}.json with shape, origin and spacing [{path}]"
        ) from error


def _check_field(
    part: Part, path: Path, heights: NDArray[np.float64], side: Document
) -> Iterator[Verdict]:
    # Compare a height field with the closed form of the profile. The step is measured between the
    # outer thirds.
    if not isinstance(part, Block):
        raise MetrologyError(f"a height field belongs to a block, got {part.id} [{path}]")
    MetrologyError.require(
        heights.ndim == 2 and list(heights.shape) == side["shape"],
        f"must have the rows and columns of its sidecar, {side['shape']}, got "
        f"{list(heights.shape)} [{path}]",
    )
    x = side["origin_x_m"] + side["spacing_x_m"] * np.arange(heights.shape[1])
    yield Finding(
        "largest error of a height",
        0.0,
        float(np.abs(heights - [part.top(position) for position in x.tolist()]).max()),
        NANOMETRE,
    )
    third = heights.shape[1] // 3
    step = (
        math.fsum(heights[:, -third:].mean(axis=0)) / third
        - math.fsum(heights[:, :third].mean(axis=0)) / third
    )
    yield Finding("step between the outer thirds", part.rise, step, NANOMETRE)


def _check_picture(part: Part, path: Path) -> Iterator[Verdict]:
    found = read_confined(f"{__name__}:read_image", path, "L", raises=MetrologyError)
    pixels = found["pixels"].astype(np.float64)
    yield Finding(
        "something is drawn",
        1.0,
        float(np.mean(np.abs(pixels - np.median(pixels)) > 8.0) > 0.02),
        0.0,
        "count",
    )


def _check_specification(part: Part, path: Path) -> Iterator[Verdict]:
    found = read_document(path, "specification", MetrologyError, form="JSON")
    wanted = json.loads(json.dumps(part.record()))
    wrong = (
        # a file of version 1.0.0 states no schema
        sum(found.get(name) != wanted.get(name) for name in found | wanted if name != "schema")
        if isinstance(found, dict)
        else len(wanted)
    )
    yield Finding("entries that differ from what was asked for", 0.0, wrong, 0.0, "count")


_CHECKERS: dict[str, Callable[[Part, Path], Iterator[Verdict]]] = {
    ".step": _check_step,
    ".convex.obj": _check_pieces,
    ".tiff": _check_tiff,
    ".npz": _check_npz,
    ".png": _check_picture,
    ".json": _check_specification,
    **dict.fromkeys(MESH_READERS, _check_mesh),
}
