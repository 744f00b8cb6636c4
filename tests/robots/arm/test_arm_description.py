"""A robot's model comes along, includes and all."""

from __future__ import annotations

from pathlib import Path

import pytest

from etude.errors import UsageError
from etude.robots.arm.loading.pack import packed


def test_a_model_without_includes_is_copied_byte_by_byte(tmp_path: Path) -> None:
    path = tmp_path / "a.urdf"
    path.write_bytes(b"<robot name='a'/>\r\n<!-- as it is -->")
    assert packed(path) == (path.read_bytes(), {})


def test_includes_take_their_places(tmp_path: Path) -> None:
    (tmp_path / "parts").mkdir()
    (tmp_path / "a.xml").write_text("<mujoco><a/><include file='parts/b.xml'/><d/></mujoco>")
    (tmp_path / "parts" / "b.xml").write_text(
        "<mujocoinclude><b><include file='parts/c.xml'/></b></mujocoinclude>"
    )
    (tmp_path / "parts" / "c.xml").write_text("<mujoco><c/></mujoco>")
    assert packed(tmp_path / "a.xml")[0].endswith(b"<mujoco><a /><b><c /></b><d /></mujoco>")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<mujoco><include file='a.xml'/></mujoco>", "circle"),
        ("<mujoco><include file='missing.xml'/></mujoco>", "cannot be read"),
        ("<mujoco><include/></mujoco>", "cannot be read"),
        ("<mujoco><include", "not a readable"),
    ],
)
def test_includes_that_lead_nowhere(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "a.xml"
    path.write_text(text)
    with pytest.raises(UsageError, match=message):
        packed(path)
