"""Meshes against trimesh and pycollada: the same shapes, and why those two do not read them at run time.

docs/decisions/0054-mesh-readers.md
"""

from __future__ import annotations

import io
import struct
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from loading_examples import example_robot
from numpy.typing import NDArray

from etude.errors import UsageError
from etude_arm.loading.hulls import volume
from etude_arm.loading.mesh_readers import read_triangles

trimesh = pytest.importorskip("trimesh", reason="pip install '.[test]'")
pytest.importorskip("collada", reason="pip install '.[test]'")

SAME = 1e-6
"""Of volumes, and of the corners of the box around a mesh over its largest side."""
TRIANGLE = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
 <asset><created>2024-01-01T00:00:00</created><modified>2024-01-01T00:00:00</modified></asset>
 <library_geometries><geometry id="g"><mesh>
  <source id="p"><float_array id="pa" count="9">0 0 0 1 0 0 0 1 0</float_array>
   <technique_common><accessor source="#pa" count="3" stride="3"><param name="X" type="float"/>
    <param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
  <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
  <triangles count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles>
 </mesh></geometry></library_geometries>
 <library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g">{colour}
 </instance_geometry></node></visual_scene></library_visual_scenes>
 <scene><instance_visual_scene url="#s"/></scene></COLLADA>"""
LOST_COLOUR = """<bind_material><technique_common><instance_material symbol="m" target="#lost"/>
</technique_common></bind_material>"""


def meshes() -> list[Path]:
    """Of all robots of the package example-robot-data."""
    root = example_robot(".")
    return sorted(path for path in root.rglob("*") if path.suffix.lower() in (".stl", ".obj", ".dae"))


def theirs(suffix: str, data: bytes) -> NDArray[np.float64]:
    """(n, 3) corners by trimesh; of OBJ the lines `v` and `f`, since its materials ask for Pillow."""
    if suffix == ".obj":
        data = b"\n".join(line for line in data.splitlines() if line.split(None, 1)[:1] in ([b"v"], [b"f"]))
    scene = trimesh.load_scene(io.BytesIO(data), file_type=suffix[1:], process=False)
    parts = [np.zeros((0, 3)), *(part.vertices[part.faces].reshape(-1, 3) for part in scene.dump())]
    return np.concatenate(parts)


def unlike(paths: Sequence[Path]) -> list[str]:
    """Names of meshes whose hulls or boxes differ."""
    found = []
    for path in paths:
        ours, other = read_triangles(path).reshape(-1, 3), theirs(path.suffix.lower(), path.read_bytes())
        if not len(other) or not _equal(ours, other):
            found.append(path.name)
    return found


def _equal(ours: NDArray[np.float64], other: NDArray[np.float64]) -> bool:
    size = np.ptp(ours, axis=0).max()
    box = [np.abs(end(ours, axis=0) - end(other, axis=0)).max() for end in (np.min, np.max)]
    return max(box) <= SAME * size and abs(volume(ours) - volume(other)) <= SAME * volume(ours)


def test_a_few_meshes_are_those_of_trimesh() -> None:
    assert unlike(meshes()[::41]) == []


@pytest.mark.slow
def test_all_meshes_are_those_of_trimesh_but_one_that_it_loses(capsys: pytest.CaptureFixture[str]) -> None:
    """Prints the CPU time of both readers by format."""
    paths = meshes()
    assert unlike(paths) == ["anymal_foot.dae"], "it names a texture that it does not hold"
    for suffix in (".stl", ".obj", ".dae"):
        own = [path for path in paths if path.suffix.lower() == suffix]
        seconds = [time.process_time()]
        for read in (read_triangles, lambda path: theirs(path.suffix.lower(), path.read_bytes())):
            for path in own:
                read(path)
            seconds.append(time.process_time())
        with capsys.disabled():
            print(f"\n{suffix}: {len(own)} files, {np.diff(seconds).round(2)} s, ours and theirs")


def test_a_shape_without_its_colour_is_a_shape(tmp_path: Path) -> None:
    """trimesh gives an empty scene, without an error: a link would be checked for collisions without it."""
    path = tmp_path / "a.dae"
    path.write_text(TRIANGLE.format(colour=LOST_COLOUR))
    assert len(read_triangles(path)) == 1
    assert len(theirs(".dae", path.read_bytes())) == 0
    assert len(theirs(".dae", TRIANGLE.format(colour="").encode())) == 3


def test_a_cut_ply_is_refused_where_trimesh_takes_what_is_left(tmp_path: Path) -> None:
    """And polygons of different sizes in a binary file are read, where trimesh refuses them."""
    head = "ply\nformat {} 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    head += "element face 2\nproperty list uchar int vertex_indices\nend_header\n"
    points = [(0, 0, 0), (1, 0, 0), (1, 2, 0), (0, 2, 3)]
    text = head.format("ascii") + "".join(f"{x} {y} {z}\n" for x, y, z in points) + "3 0 1 2\n"
    (tmp_path / "cut.ply").write_text(text)
    with pytest.raises(UsageError, match="shorter than its header states"):
        read_triangles(tmp_path / "cut.ply")
    assert len(theirs(".ply", text.encode()))
    data = head.format("binary_little_endian").encode() + b"".join(struct.pack("<3f", *p) for p in points)
    data += struct.pack("<B3iB4i", 3, 0, 1, 2, 4, 0, 1, 2, 3)
    (tmp_path / "mixed.ply").write_bytes(data)
    assert len(read_triangles(tmp_path / "mixed.ply")) == 3
    with pytest.raises(ValueError, match="unexpected length"):
        theirs(".ply", data)
