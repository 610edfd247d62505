"""Every artefact of every shipped stimulus, as it lies on disk; and that the checks can fail."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from oracles.shipped import load_all_shipped
from stepblocks.artefacts.check import check_artefact
from stepblocks.artefacts.meshes.read import MESH_READERS, read_mesh
from stepblocks.artefacts.meshes.write import MESH_FORMATS
from stepblocks.build.make import list_possible_artefact_paths
from stepblocks.parts.shapes import Mesh

SETS = {stimuli.name: stimuli for stimuli in load_all_shipped()}
ARTEFACTS = [
    pytest.param(name, stimulus, path.name, id=f"{name}/{path.name}")
    for name, stimuli in SETS.items()
    for stimulus in stimuli.stimuli
    for path in list_possible_artefact_paths(stimulus, Path())
]


def test_every_mesh_format_has_a_reader():
    assert set(MESH_FORMATS) == set(MESH_READERS)


@pytest.mark.parametrize(("set_name", "stimulus", "artefact"), ARTEFACTS)
def test_what_lies_on_disk_is_what_was_asked_for(shipped_output, set_name, stimulus, artefact):
    verdicts = check_artefact(stimulus, shipped_output / set_name / stimulus.id / artefact)
    assert verdicts
    assert [str(verdict) for verdict in verdicts if not verdict.passed] == []


@pytest.mark.parametrize("form", MESH_FORMATS)
@pytest.mark.parametrize("block", SETS["paper-ten"].stimuli, ids=lambda block: block.id)
def test_ten_steps_are_within_a_nanometre_in_every_mesh_format(shipped_output, form, block):
    """Independent of the verdicts: the two uppermost levels at the edge, by vertices."""
    vertices, *_ = read_mesh(shipped_output / "paper-ten" / block.id / f"{block.id}{form}")
    on_edge = vertices[(np.abs(vertices[:, 0]) < 1e-8) & (vertices[:, 2] > -1e-6)]
    levels = np.unique(np.round(on_edge[:, 2] * 1e10))
    assert levels.max() - levels.min() == pytest.approx(block.height.nominal * 1e10, abs=10)


def test_meshes_stay_small(shipped_output):
    # A 10 um edge on a 20 mm block must not need a million triangles.
    meshes = list((shipped_output / "paper-ten").glob("*/*.stl"))
    assert meshes
    for path in meshes:
        _, triangles, *_ = read_mesh(path)
        assert len(triangles) < 5_000


@pytest.fixture
def block():
    return SETS["paper-ten"].stimuli[4]


@pytest.fixture
def folder(shipped_output, block, tmp_path):
    copy = tmp_path / block.id
    shutil.copytree(shipped_output / "paper-ten" / block.id, copy)
    return copy


def failures(stimulus, path):
    return [verdict.quantity for verdict in check_artefact(stimulus, path) if not verdict.passed]


def rewrite(form, path, vertices, triangles):
    MESH_FORMATS[form](path, Mesh("changed", vertices, triangles))


@pytest.mark.repeats
@pytest.mark.parametrize("form", MESH_FORMATS)
def test_a_flipped_triangle_is_caught(form, folder, block):
    path = folder / f"{block.id}{form}"
    vertices, triangles, *_ = read_mesh(path)
    triangles[7] = triangles[7, ::-1]
    rewrite(form, path, vertices, triangles)
    assert "edges without exactly one neighbour" in failures(block, path)


@pytest.mark.repeats
@pytest.mark.parametrize("form", MESH_FORMATS)
def test_an_inward_winding_is_caught(form, folder, block):
    path = folder / f"{block.id}{form}"
    vertices, triangles, *_ = read_mesh(path)
    rewrite(form, path, vertices, triangles[:, ::-1])
    assert "volume" in failures(block, path)


@pytest.mark.repeats
@pytest.mark.parametrize("form", MESH_FORMATS)
def test_two_nanometres_too_high_are_caught(form, folder, block):
    path = folder / f"{block.id}{form}"
    vertices, triangles, *_ = read_mesh(path)
    vertices[vertices[:, 2] > 0.5 * block.height.nominal, 2] += 2e-9
    rewrite(form, path, vertices, triangles)
    assert failures(block, path) == ["step height"]


def test_a_concave_piece_is_caught(folder, block):
    from stepblocks.artefacts.meshes.write import write_convex_pieces

    path = folder / f"{block.id}.convex.obj"
    vertices, triangles, *_ = read_mesh(folder / f"{block.id}.stl")
    write_convex_pieces(path, [Mesh("whole", vertices, triangles)])
    assert "concavity of the pieces" in failures(block, path)


@pytest.mark.parametrize("suffix", [".tiff", ".npz"])
def test_a_mirrored_height_field_is_caught(suffix, folder, block):
    path = folder / f"{block.id}.heightfield{suffix}"
    if suffix == ".npz":
        with np.load(path) as archive:
            np.savez_compressed(path, **{name: archive[name][..., ::-1] for name in archive.files})
    else:
        import tifffile

        tifffile.imwrite(path, tifffile.imread(path)[:, ::-1])
    assert "largest error of a height" in failures(block, path)


def test_swapped_rows_of_a_height_field_are_caught(folder, block):
    path = folder / f"{block.id}.heightfield.npz"
    with np.load(path) as archive:
        content = {name: archive[name] for name in archive.files}
    content["height_m"], content["y_m"] = content["height_m"][::-1], content["y_m"][::-1]
    np.savez_compressed(path, **content)
    assert "positions along y" in failures(block, path)


def test_an_eight_bit_height_field_is_caught(folder, block):
    import tifffile

    path = folder / f"{block.id}.heightfield.tiff"
    tifffile.imwrite(path, tifffile.imread(path).astype(np.uint8))
    assert "bits per height, floating point" in failures(block, path)


@pytest.mark.parametrize(
    ("old", "new", "found"),
    [("AP242", "AP214", "schema AP242"), (",5.E-02)", ",5.0002E-02)", "step height")],
)
def test_a_falsified_step_file_is_caught(folder, block, old, new, found):
    path = folder / f"{block.id}.step"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    assert any(line.startswith(found) for line in failures(block, path))


def test_an_empty_picture_is_caught(folder, block):
    from PIL import Image

    path = folder / f"{block.id}.png"
    Image.new("RGB", (960, 400), "white").save(path)
    assert failures(block, path) == ["something is drawn"]


@pytest.mark.repeats
@pytest.mark.parametrize(
    "artefact",
    [path.name for path in list_possible_artefact_paths(SETS["paper-ten"].stimuli[4], Path())],
)
@pytest.mark.parametrize("damage", ["missing", "empty", "truncated", "garbage"])
def test_a_damaged_file_is_a_failed_verdict_not_a_traceback(folder, block, artefact, damage):
    path = folder / artefact
    content = path.read_bytes()
    path.unlink()
    if damage != "missing":
        path.write_bytes(
            {
                "empty": b"",
                "truncated": content[: len(content) // 3],
                "garbage": b"\x00\xff garbage " * 40,
            }[damage]
        )
    verdicts = check_artefact(block, path)
    assert any(not verdict.passed for verdict in verdicts)
    json.dumps([verdict.as_record() for verdict in verdicts], allow_nan=False)


def test_no_integer_height_fields_exist(shipped_output):
    import tifffile

    for path in shipped_output.rglob("*.tiff"):
        assert tifffile.imread(path).dtype == np.float32


def test_a_sphere_fitted_to_exact_points_has_their_radius():
    # Origin: points constructed on a sphere of 125 um about (3, -2, 125) um.
    from stepblocks.artefacts.meshes.measures import fit_sphere_radius_and_form

    angles = np.linspace(0.1, 1.4, 20)[:, None], np.linspace(0.0, 6.0, 25)[None, :]
    ball = np.stack(
        np.broadcast_arrays(
            np.sin(angles[0]) * np.cos(angles[1]),
            np.sin(angles[0]) * np.sin(angles[1]),
            -np.cos(angles[0]),
        ),
        axis=-1,
    )
    radius, form = fit_sphere_radius_and_form(
        ball.reshape(-1, 3) * 125e-6 + np.array([3e-6, -2e-6, 125e-6])
    )
    assert radius == pytest.approx(125e-6, rel=1e-10)
    assert form < 1e-14
