"""Valid OBJ and STL are read, however a program writes them; what is none is refused."""

import struct

import numpy as np
import pytest

from stepblocks.artefacts.meshes.measures import MeshMeasures
from stepblocks.files.stl import read_stl
from stepblocks.files.wavefront import read_obj

# a corner of a cube: four vertices, four triangles, wound outwards
POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=np.float64)
TRIANGLES = [(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)]
FACES = "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"


def write_vertices(behind=""):
    return "".join(f"v {x:g} {y:g} {z:g}{behind}\n" for x, y, z in POINTS)


def write_facets(capitals=False, turned=False):
    text = "solid corner\n"
    for triangle in TRIANGLES:
        a, b, c = POINTS[list(triangle)]
        normal = np.cross(b - a, c - a) * (-1.0 if turned else 1.0)
        text += "facet normal {:g} {:g} {:g}\nouter loop\n".format(*normal)
        for corner in (a, b, c):
            text += "vertex {:g} {:g} {:g}\n".format(*corner)
        text += "endloop\nendfacet\n"
    text += "endsolid corner\n"
    return text.upper() if capitals else text


@pytest.mark.parametrize(
    "text",
    [
        write_vertices() + FACES,
        write_vertices(" 0.5 0.25 1") + FACES,  # colours, as scanners write them
        write_vertices(" 1.0") + FACES,  # w
        write_vertices() + "vn 0 0 1\n" + FACES.replace(" 1", " 1//1").replace(" 2", " 2//1"),
        write_vertices() + "vt 0 0\n" + FACES.replace(" 4", " 4/1"),
        write_vertices() + "f -4 -2 -3\nf -4 -3 -1\nf -3 -2 -1\nf -4 -1 -2\n",
        "\ufeff# a comment\nmtllib a.mtl\no corner\ns off\n" + write_vertices() + FACES,
        write_vertices() + FACES.replace("f 1 3 2", "f 1 3 \\\n2"),
    ],
)
def test_every_valid_obj_gives_the_same_mesh(text, tmp_path):
    (tmp_path / "a.obj").write_text(text, encoding="utf-8")
    mesh = read_obj(tmp_path / "a.obj")
    np.testing.assert_array_equal(mesh.vertices, POINTS)
    assert [tuple(row) for row in mesh.triangles] == TRIANGLES


@pytest.mark.parametrize(
    "statement", ["v 0 0", "v 0 0 0 2", "f 1 2", "f 1 2 9", "f 0 1 2", "v a b c"]
)
def test_a_wrong_statement_is_refused_with_its_line(statement, tmp_path):
    (tmp_path / "a.obj").write_text(write_vertices() + FACES + statement + "\n")
    with pytest.raises(ValueError, match="line 9"):
        read_obj(tmp_path / "a.obj")


@pytest.mark.parametrize("capitals", [False, True])
@pytest.mark.parametrize("turned", [False, True])
def test_normals_of_stl_text_are_held_against_the_order_of_the_corners(capitals, turned, tmp_path):
    (tmp_path / "a.stl").write_text(write_facets(capitals, turned))
    mesh = read_stl(tmp_path / "a.stl")
    measures = MeshMeasures(mesh.vertices, mesh.triangles)
    assert measures.volume == pytest.approx(1.0 / 6.0, rel=1e-12)
    assert measures.count_inward_normals(mesh.normals) == (4 if turned else 0)


def test_binary_stl_has_its_normals_too_and_a_cut_file_is_refused(tmp_path):
    body = b""
    for triangle in TRIANGLES:
        body += struct.pack("<3f9fH", 0.0, 0.0, 0.0, *POINTS[list(triangle)].ravel(), 0)
    whole = b"solid or not".ljust(80) + struct.pack("<I", 4) + body
    (tmp_path / "a.stl").write_bytes(whole)
    mesh = read_stl(tmp_path / "a.stl")
    assert mesh.triangles.shape == (4, 3)
    # a normal of zero is none, and is not counted
    assert MeshMeasures(mesh.vertices, mesh.triangles).count_inward_normals(mesh.normals) == 0
    for broken in (whole[:-1], b"solid " + whole[6:-1], write_facets()[:-40].encode()):
        (tmp_path / "b.stl").write_bytes(broken)
        with pytest.raises(ValueError, match=r"facets|size of a binary"):
            read_stl(tmp_path / "b.stl")
