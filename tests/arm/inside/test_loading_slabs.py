"""Bent links of an MJCF: slabs collide in the place of their hulls, and nothing else changes."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from test_loading_meshes import inside, solid

from etude_arm.loading.load import load
from etude_arm.loading.pack import packed

BENT = solid((0, 0, 0, 0.1, 0.1, 0.5), (0, 0, 0.4, 0.6, 0.1, 0.5))
"""An L, whose hull holds half as much air again."""
MJCF = """<mujoco><compiler angle="radian"/><default>
  <default class="mm"><mesh scale="1e-3 1e-3 1e-3"/></default>
  <default class="hard"><geom type="mesh"/></default>
  <default class="soft"><geom type="mesh" contype="0" conaffinity="0"/></default></default>
 <asset><mesh name="bent" class="mm" vertex="{bent}" face="{faces}" refpos="2 3 4"/>
  <mesh name="whole" vertex="{whole}"/><mesh name="short" vertex="{short}"/></asset>
 <worldbody><body name="a" pos="0 0 .2"><joint name="j" axis="0 1 .3" range="-1 1"/>
  {geoms}</body></worldbody></mujoco>"""
AT = 'pos=".05 .02 0" quat=".8 .1 .2 .5"'


def text(points: np.ndarray) -> str:
    return " ".join(map(repr, points.ravel().tolist()))


def written(folder: Path, geoms: str) -> Path:
    bent, count = BENT.reshape(-1, 3), 3 * len(BENT)
    shapes = {"bent": 1e3 * bent + [2.0, 3.0, 4.0], "whole": bent, "short": bent * [0.9, 1.0, 1.0]}
    faces = " ".join(map(str, range(count)))
    path = folder / "arm.xml"
    path.write_text(
        MJCF.format(geoms=geoms, faces=faces, **{name: text(own) for name, own in shapes.items()})
    )
    return path


def models(path: Path, notes: list[str]) -> tuple[mujoco.MjModel, mujoco.MjModel]:
    """The file's, and that of its copy with slabs."""
    data, meshes = packed(path, overlapping=["a"], notes=notes)
    copy = path.parent / "copy" / "robot.xml"
    for name, content in {copy.name: data, **meshes}.items():
        (copy.parent / name).parent.mkdir(parents=True, exist_ok=True)
        (copy.parent / name).write_bytes(content)
    return load(path).model(), load(copy).model()


def hulls(model: mujoco.MjModel) -> list[np.ndarray]:
    """Corners of each shape, in the world."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    found = []
    for g in range(model.ngeom):
        first, count = (int(of[model.geom_dataid[g]]) for of in (model.mesh_vertadr, model.mesh_vertnum))
        points = model.mesh_vert[first : first + count]
        found.append(points @ data.geom_xmat[g].reshape(3, 3).T + data.geom_xpos[g])
    return found


def check_slabs(before: mujoco.MjModel, after: mujoco.MjModel) -> None:
    """The slabs fill the hull to its ends, hold the body and less air, and weigh nothing."""
    (whole,), parts = hulls(before), hulls(after)
    assert len(parts) == 4
    for most in (np.min, np.max):
        np.testing.assert_allclose(most(np.concatenate(parts), axis=0), most(whole, axis=0), atol=1e-6)
    np.testing.assert_allclose(after.body_mass, before.body_mass, rtol=1e-6)
    np.testing.assert_allclose(after.body_inertia, before.body_inertia, rtol=1e-5)
    air = whole.mean(axis=0) + np.random.default_rng(0).uniform(-0.3, 0.3, (4000, 3))
    held = [np.any([inside(air, part) for part in of], axis=0) for of in ([whole], parts)]
    assert held[1].sum() < 0.75 * held[0].sum()
    assert not np.any(held[1] & ~held[0])


def test_a_bent_mesh_collides_as_its_slabs(tmp_path: Path) -> None:
    notes: list[str] = []
    geom = f'<frame pos="0 0 .1"><geom name="l" class="hard" mesh="bent" {AT} density="500"/></frame>'
    check_slabs(*models(written(tmp_path, geom), notes))
    assert notes == []


def test_a_hull_made_before_gives_way_to_slabs_of_what_is_drawn_if_that_fills_it(tmp_path: Path) -> None:
    notes: list[str] = []
    drawn = f'<geom class="soft" mesh="bent" {AT} mass="0"/>'
    check_slabs(*models(written(tmp_path, f'<geom class="hard" mesh="whole" {AT}/>{drawn}'), notes))
    assert len(notes) == 1
    assert "shapes of a in" in notes[0]


@pytest.mark.parametrize(
    "geoms",
    [
        f'<geom class="hard" mesh="whole" {AT}/>',
        f'<geom class="hard" mesh="whole" {AT}/><geom class="soft" mesh="short" {AT}/>',
        f'<geom class="hard" mesh="whole" {AT}/><geom class="soft" mesh="bent"/>',
        f'<replicate count="2" offset="0 1 0"><geom class="hard" mesh="bent" {AT}/></replicate>',
    ],
    ids=["nothing drawn", "drawn shorter", "drawn elsewhere", "copies"],
)
def test_else_the_hull_stays(tmp_path: Path, geoms: str) -> None:
    notes: list[str] = []
    before, after = models(written(tmp_path, geoms), notes)
    assert after.ngeom == before.ngeom
    assert notes == []
