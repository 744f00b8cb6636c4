"""PLY meshes, and a mesh whose form is not read beside its converted copy."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from etude.errors import UsageError
from etude_arm.loading.mesh_paths import MeshPaths
from etude_arm.loading.mesh_readers import read_triangles

POINTS = [(0, 0, 0), (1, 0, 0), (1, 2, 0), (0, 2, 3)]
TRIANGLES = np.array(POINTS, dtype=float)[[[0, 1, 2], [0, 1, 2], [0, 2, 3]]]
HEAD = """ply
format {} 1.0
comment element vertex 7
element vertex 4
property float x
property float y
property double z
property uchar red
element edge 1
property int vertex1
element face 2
property uchar flags
property list uchar int vertex_indices
end_header
"""
FACES = [[0, 1, 2], [0, 1, 2, 3]]


def ascii_ply() -> bytes:
    rows = (
        [f"{x} {y} {z} 255" for x, y, z in POINTS]
        + ["2"]
        + [f"9 {len(f)} {' '.join(map(str, f))}" for f in FACES]
    )
    return (HEAD.format("ascii") + "\n".join(rows)).encode()


def binary_ply(order: str, name: str) -> bytes:
    body = b"".join(struct.pack(f"{order}ffdB", *point, 10) for point in POINTS) + struct.pack(f"{order}i", 2)
    body += b"".join(struct.pack(f"{order}BB{len(face)}i", 9, len(face), *face) for face in FACES)
    return HEAD.format(name).encode() + body


@pytest.mark.parametrize(
    "data",
    [
        ascii_ply(),
        ascii_ply().replace(b"\n", b"\r\n"),
        binary_ply("<", "binary_little_endian"),
        binary_ply(">", "binary_big_endian"),
    ],
    ids=["ascii", "carriage returns", "little", "big"],
)
def test_every_form_of_ply_gives_the_same_triangles(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "a.PLY"
    path.write_bytes(data)
    np.testing.assert_array_equal(read_triangles(path), TRIANGLES)


def test_points_without_faces_are_kept(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    path.write_text(
        "ply\nformat ascii 1.0\nelement vertex 2\nproperty float z\nproperty float x\nproperty float y\n"
        "end_header\n3 1 2\n6 4 5\n"
    )
    np.testing.assert_array_equal(read_triangles(path)[:, 0], [[1, 2, 3], [4, 5, 6]])


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"solid",
        ascii_ply()[:-6],
        binary_ply("<", "binary_little_endian")[:-3],
        ascii_ply().replace(b"ascii", b"binary_middle_endian"),
        ascii_ply().replace(b"property float x", b"property float u"),
        ascii_ply().replace(b"9 3 0 1 2", b"9 3 0 1 7"),
        HEAD.format("ascii").encode(),
    ],
)
def test_what_is_no_ply_is_refused(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(data)
    with pytest.raises(UsageError, match=r"the mesh cannot be read.*a\.ply.*Export it again"):
        read_triangles(path)


def test_a_converted_copy_is_taken_as_the_refusal_says(tmp_path: Path) -> None:
    (tmp_path / "a.gltf").write_bytes(b"glTF")
    found = MeshPaths(tmp_path / "arm.urdf").find("a.gltf")
    assert found is not None
    with pytest.raises(UsageError, match=r"'\.gltf' are not read.*in the same folder and with the same name"):
        read_triangles(found)
    (tmp_path / "a.ply").write_bytes(ascii_ply())
    assert MeshPaths(tmp_path / "arm.urdf").find("a.gltf") == tmp_path / "a.ply"
    (tmp_path / "a.stl").touch()  # one that is read is taken as it is
    assert MeshPaths(tmp_path / "arm.urdf").find("a.ply") == tmp_path / "a.ply"
