"""Binary glTF: nodes, indices, strides, and what cannot be read."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from etude.errors import UsageError
from etude_arm.loading.mesh_readers import read_triangles

POINTS = np.array([(0, 0, 0), (1, 0, 0), (1, 2, 0), (0, 2, 3)], dtype="<f4")
INDICES = np.array([0, 1, 2, 0, 2, 3], dtype="<u2")
TRIANGLES = POINTS.astype(float)[INDICES.reshape(-1, 3)]
HALF = np.sqrt(0.5)


def content(**more: Any) -> dict[str, Any]:
    """Points with a stride of 16 bytes behind the indices."""
    return {
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
        "bufferViews": [{"buffer": 0, "byteOffset": 12, "byteStride": 16}, {"buffer": 0}],
        "buffers": [{"byteLength": 76}],
    } | more


def glb(folder: Path, said: dict[str, Any], cut: int = 0) -> Path:
    numbers = INDICES.tobytes() + np.pad(POINTS, ((0, 0), (0, 1)), constant_values=9).astype("<f4").tobytes()
    text = json.dumps(said).encode()
    text += b" " * (-len(text) % 4)
    numbers = numbers[: len(numbers) - cut]
    chunks = (
        struct.pack("<I", len(text)) + b"JSON" + text + struct.pack("<I", len(numbers)) + b"BIN\0" + numbers
    )
    path = folder / "a.glb"
    path.write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks)
    return path


def test_points_are_taken_as_they_stand(tmp_path: Path) -> None:
    np.testing.assert_array_equal(read_triangles(glb(tmp_path, content())), TRIANGLES)


def test_nodes_shift_turn_and_scale_what_hangs_on_them(tmp_path: Path) -> None:
    nodes = [
        {"children": [1], "translation": [1, 2, 3], "rotation": [0, 0, HALF, HALF]},  # a quarter turn about z
        {"mesh": 0, "scale": [0.001, 0.001, 0.002]},
    ]
    x, y, z = np.moveaxis(TRIANGLES * [0.001, 0.001, 0.002], -1, 0)
    wanted = np.stack([1.0 - y, 2.0 + x, 3.0 + z], axis=-1)
    np.testing.assert_allclose(read_triangles(glb(tmp_path, content(nodes=nodes))), wanted, atol=1e-12)
    matrix = [0, 0.001, 0, 0, -0.001, 0, 0, 0, 0, 0, 0.002, 0, 1, 2, 3, 1]  # the same, column by column
    nodes = [{"mesh": 0, "matrix": matrix}, {"mesh": 0}]  # the second is not in the scene
    np.testing.assert_allclose(read_triangles(glb(tmp_path, content(nodes=nodes))), wanted, atol=1e-12)


@pytest.mark.parametrize(
    ("more", "cut", "said"),
    [
        ({"accessors": [{"componentType": 5126, "count": 4, "type": "VEC3"}] * 2}, 0, "compressed"),
        ({"buffers": [{"uri": "a.bin"}]}, 0, "in another file"),
        ({}, 8, "ends before"),
        ({"nodes": [{"children": [0]}]}, 0, "form a circle"),
    ],
)
def test_what_cannot_be_read_is_said(tmp_path: Path, more: dict[str, Any], cut: int, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        read_triangles(glb(tmp_path, content(**more), cut))


def test_another_file_of_that_name_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.glb").write_bytes(b"solid of something else")
    with pytest.raises(UsageError, match="not binary glTF"):
        read_triangles(tmp_path / "a.glb")
