"""Meshes: the vertices that count, in metres, and hulls that contain them."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from loading_examples import ARM, MESH, write

from etude.errors import UsageError
from etude_arm.loading.hulls import SLABS, THINNEST, hull, is_hull, obj_text, slabs, volume
from etude_arm.loading.load import load
from etude_arm.loading.mesh_paths import MeshPaths
from etude_arm.loading.mesh_readers import read_triangles

CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]])
DAE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
 <asset><unit name="inch" meter="0.0254"/><up_axis>Y_UP</up_axis></asset>
 <library_geometries><geometry id="g"><mesh>
  <source id="p"><float_array id="pa" count="15">0 0 0 1 0 0 0 2 0 0 0 3 100 100 100</float_array>
   <technique_common><accessor source="#pa" count="5" stride="3"/></technique_common></source>
  <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
  <triangles count="2"><input semantic="VERTEX" source="#v" offset="0"/>
   <input semantic="NORMAL" source="#p" offset="1"/><p>0 4 1 4 2 4 0 4 2 4 3 4</p></triangles>
 </mesh></geometry></library_geometries>
 <library_visual_scenes><visual_scene id="s"><node>
  <translate>10 0 0</translate><rotate>0 0 1 90</rotate>
  <node><matrix>2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1</matrix><instance_geometry url="#g"/></node>
 </node></visual_scene></library_visual_scenes>
 <scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def binary_stl(triangles: np.ndarray, head: bytes) -> bytes:
    facets = [struct.pack("<12fH", 0, 0, 0, *triangle.ravel(), 0) for triangle in triangles]
    return head.ljust(80) + struct.pack("<I", len(facets)) + b"".join(facets)


def test_an_stl_is_binary_by_its_length_not_by_its_first_word(tmp_path: Path) -> None:
    path = tmp_path / "a.stl"
    triangles = CORNERS[[[0, 1, 2], [0, 2, 3]]]
    path.write_bytes(binary_stl(triangles, b"solid exported by somebody"))
    np.testing.assert_array_equal(read_triangles(path), triangles)
    path.write_text(
        "solid a\n facet normal 0 0 1\n  outer loop\n"
        + "".join(f"   vertex {x} {y} {z}\n" for x, y, z in triangles[0])
        + "  endloop\n endfacet\nendsolid a\n"
    )
    np.testing.assert_array_equal(read_triangles(path), triangles[:1])


def test_an_obj_gives_its_vertices_and_not_its_normals(tmp_path: Path) -> None:
    path = tmp_path / "a.OBJ"
    path.write_text(
        "mtllib x.mtl\nv 0 0 0 0.5 0.5 0.5\nvn 9 9 9\nvt 8 8\nv 1 0 0\n v 0 2 0\nf 1//1 2//1 3//1\n"
    )
    np.testing.assert_array_equal(read_triangles(path), CORNERS[None, :3])
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 2 0\nv 0 0 3\nv 5 5 5\nf 1 2 3 4\nf -5/1 -4/1 -3/1\n")
    np.testing.assert_array_equal(read_triangles(path), CORNERS[[[0, 1, 2], [0, 1, 2], [0, 2, 3]]])
    path.write_text("v 0 0 0\nv 1 0 0\n")
    np.testing.assert_array_equal(read_triangles(path)[:, 2], CORNERS[:2])


def test_a_dae_counts_used_vertices_where_the_scene_puts_them_in_metres(tmp_path: Path) -> None:
    path = tmp_path / "a.dae"
    path.write_text(DAE)
    x, y, z = CORNERS.T  # doubled, turned by 90 degrees about z, moved by 10 along x; inches; y is not up
    expected = 0.0254 * np.column_stack([10 - 2 * y, 2 * x, 2 * z])
    np.testing.assert_allclose(read_triangles(path), expected[[[0, 1, 2], [0, 2, 3]]], atol=1e-15)
    path.write_text(DAE[: DAE.index(" <library_visual_scenes>")] + "</COLLADA>")
    np.testing.assert_allclose(read_triangles(path), 0.0254 * CORNERS[[[0, 1, 2], [0, 2, 3]]])


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("a.step", b"", "form '.step' are not read.*Convert"),
        ("a.stl", b"", "holds no mesh"),
        ("a.obj", b"", "holds no mesh"),
        ("a.obj", b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "Git LFS.*git lfs pull"),
        ("a.stl", b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n", "Git LFS.*git lfs pull"),
        ("a.obj", b"v 0 0 nan\n", "are not numbers"),
        ("a.obj", b"v 0 0 zero\n", "cannot be read"),
        ("a.dae", b"<COLLADA><scene>", "cannot be read"),
        ("a.dae", b"<svg/>", "no COLLADA file"),
    ],
)
def test_a_mesh_that_is_none_says_so_with_its_path(
    tmp_path: Path, name: str, data: bytes, words: str
) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(UsageError, match=words) as refused:
        read_triangles(tmp_path / name)
    assert name in refused.value.where


points = arrays(np.float64, st.tuples(st.integers(1, 12), st.just(3)), elements=st.integers(-3, 3).map(float))


@given(points)
def test_a_hull_contains_its_points_and_its_faces_look_outwards(cloud: np.ndarray) -> None:
    """Single points, lines and flat clouds too: they are given a thickness of no more than THINNEST."""
    vertices, faces = hull(cloud)
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = (normals / np.maximum(lengths, 1e-300))[lengths[:, 0] > 1e-9]
    a = a[lengths[:, 0] > 1e-9]
    outside = np.einsum("fi,fpi->fp", normals, cloud[None] - a[:, None])
    assert outside.max() < 1e-9
    assert np.einsum("fi,fi->f", normals, vertices.mean(axis=0) - a).max() < 0
    assert np.all(vertices <= cloud.max(axis=0) + THINNEST)
    assert np.all(vertices >= cloud.min(axis=0) - THINNEST)
    volume = np.einsum(
        "fi,fi->f", vertices[faces[:, 0]], np.cross(vertices[faces[:, 1]], vertices[faces[:, 2]])
    )
    assert volume.sum() / 6 > 0


def test_a_hull_as_obj_reads_back_to_the_same_numbers(tmp_path: Path) -> None:
    vertices, faces = hull(np.random.default_rng(0).normal(size=(30, 3)))
    (tmp_path / "a.obj").write_bytes(obj_text(vertices, faces))
    np.testing.assert_array_equal(read_triangles(tmp_path / "a.obj"), vertices[faces])


def test_a_hull_that_was_written_once_is_taken_as_it_is_and_scaled_anew(tmp_path: Path) -> None:
    cloud = np.random.default_rng(1).normal(0.0, 0.1, (200, 3))
    mesh = tmp_path / "cube.obj"
    mesh.write_text("".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in cloud.tolist()))
    plain, scaled = (f'<mesh filename="cube.obj" scale="{scale}"/>' for scale in ("1 1 1", "1 1 2"))
    path = write(tmp_path, ARM.replace(MESH, plain))
    (made,) = (data for name, data in load(path).assets.items() if "upper" in name)
    mesh.write_bytes(made)
    assert made in load(path).assets.values()
    mesh.write_bytes(made.replace(b"\n", b"\n# by whoever packed it\n", 1))
    assert mesh.read_bytes() in load(path).assets.values(), "not made again"
    path = write(tmp_path, ARM.replace(MESH, scaled))
    (tall,) = (data for name, data in load(path).assets.items() if "upper" in name)
    assert is_hull(tall)
    heights = [
        np.array([line.split()[3] for line in data.splitlines() if line[:2] == b"v "], float)
        for data in (made, tall)
    ]
    np.testing.assert_array_equal(np.sort(heights[1]), 2.0 * np.sort(heights[0]))


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("package://arm_description/meshes/a.stl", "ws/arm_description/meshes/a.stl"),
        ("package://other/meshes/a.stl", "ws/arm_description/meshes/a.stl"),  # its own package, renamed
        ("package:///meshes/a.stl", "ws/arm_description/meshes/a.stl"),
        ("model://arm_description/meshes/a.stl", "ws/arm_description/meshes/a.stl"),
        ("file:///meshes/a.stl", "ws/arm_description/meshes/a.stl"),
        ("../meshes/a.stl", "ws/arm_description/urdf/../meshes/a.stl"),
        ("a.stl", "ws/arm_description/urdf/a.stl"),
        ("package://tool/b.stl", "elsewhere/tool/b.stl"),
        ("package://b_only/b.stl", "elsewhere/tool/b.stl"),
        ("package://arm_description/meshes/none.stl", None),
    ],
)
def test_meshes_are_found_on_the_way_up_and_below_the_roots(
    tmp_path: Path, name: str, place: str | None
) -> None:
    model = tmp_path / "ws/arm_description/urdf/arm.urdf"
    for file in ("ws/arm_description/meshes/a.stl", "ws/arm_description/urdf/a.stl", "elsewhere/tool/b.stl"):
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).touch()
    roots = (tmp_path / "elsewhere", tmp_path / "elsewhere/tool")
    assert MeshPaths(model, roots).find(name) == (None if place is None else tmp_path / place)
    assert (
        MeshPaths(model).find(f"file://{tmp_path}/elsewhere/tool/b.stl") == tmp_path / "elsewhere/tool/b.stl"
    )


def test_a_root_that_is_named_comes_first(tmp_path: Path) -> None:
    for folder in ("near", "root"):
        (tmp_path / folder / "arm").mkdir(parents=True)
        (tmp_path / folder / "arm/a.stl").touch()
    model = tmp_path / "near/arm.urdf"
    assert MeshPaths(model).find("package://arm/a.stl") == tmp_path / "near/arm/a.stl"
    assert MeshPaths(model, (tmp_path / "root",)).find("package://arm/a.stl") == tmp_path / "root/arm/a.stl"


@pytest.mark.parametrize(
    ("primitive", "corners"),
    [
        ("<tristrips>{}<p>0 1 2 3</p></tristrips>", [[0, 1, 2], [1, 2, 3]]),
        ("<trifans>{}<p>0 1 2 3</p></trifans>", [[0, 1, 2], [0, 2, 3]]),
        ("<polygons>{}<p>0 1 2</p><p>0 1 2 3</p></polygons>", [[0, 1, 2], [0, 1, 2], [0, 2, 3]]),
        (
            "<polylist>{}<vcount>4 3</vcount><p>0 1 2 3 1 2 3</p></polylist>",
            [[0, 1, 2], [1, 2, 3], [0, 2, 3]],
        ),
    ],
)
def test_every_primitive_of_a_dae_becomes_triangles(
    tmp_path: Path, primitive: str, corners: list[list[int]]
) -> None:
    start, end = DAE.index("<triangles"), DAE.index("</triangles>") + len("</triangles>")
    vertex = '<input semantic="VERTEX" source="#v" offset="0"/>'
    text = DAE[:start] + primitive.format(vertex) + DAE[end : DAE.index(" <library_visual_scenes>")]
    path = tmp_path / "a.dae"
    path.write_text(text + "</COLLADA>")
    np.testing.assert_allclose(read_triangles(path), 0.0254 * CORNERS[corners])


def solid(*boxes: tuple[float, ...]) -> np.ndarray:
    """Triangles of boxes, each given by two corners."""
    found = []
    for x, y, z, X, Y, Z in boxes:
        vertices, faces = hull(np.array([[a, b, c] for a in (x, X) for b in (y, Y) for c in (z, Z)]))
        found.append(vertices[faces])
    return np.concatenate(found)


def inside(points: np.ndarray, part: np.ndarray) -> np.ndarray:
    vertices, faces = hull(part)
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return np.all(np.einsum("fi,fpi->fp", np.cross(b - a, c - a), points[None] - a[:, None]) < 1e-12, axis=0)


def test_slabs_of_a_bent_mesh_contain_it_and_less_air() -> None:
    bent = solid((0, 0, 0, 1, 0.1, 0.1), (0, 0, 0, 0.1, 0.1, 0.8), (0.9, 0, 0, 1, 0.1, 0.8))
    parts = slabs(bent)
    assert len(parts) == SLABS
    assert sum(map(volume, parts)) < 0.75 * volume(bent.reshape(-1, 3))
    weights = np.random.default_rng(0).dirichlet(np.ones(3), (40, len(bent)))
    points = np.einsum("snk,nki->sni", weights, bent).reshape(-1, 3)
    assert np.any([inside(points, part) for part in parts], axis=0).all()
    air = np.array([[0.5, 0.05, 0.5]])
    assert inside(air, bent.reshape(-1, 3)).all()
    assert not np.any([inside(air, part) for part in parts])


def test_a_convex_mesh_is_not_cut() -> None:
    (whole,) = slabs(solid((0, 0, 0, 1, 0.2, 0.3)))
    np.testing.assert_allclose(volume(whole), 0.06, rtol=1e-12)
