"""Brings a robot of joints into a campaign folder, so that the folder needs nothing outside itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from etude.errors import UsageError
from etude.types import Described
from etude_arm.robot_file import read_robot, robot_to_toml
from etude_arm.spec import ArmSpec

if TYPE_CHECKING:
    from etude_arm.clearance.surroundings import Floor
    from etude_arm.loading.loaded import Loaded

ROBOT_FILE = "robot.toml"
MODEL_NAME = "robot_model"


def read(
    path: Path,
    joints: Sequence[str] | None = None,
    held: Mapping[str, float] | None = None,
    limits: Mapping[str, Mapping[str, float]] | None = None,
) -> tuple[ArmSpec, tuple[str, ...]]:
    """The robot of a robot file, a URDF or an MJCF; and what a person should confirm of it.

    `joints` and `held` choose an arm of a model file, see `loading.load.load`; `limits` count in
    place of the file's.
    """
    if path.suffix.lower() == ".toml":
        if joints or held or limits:
            raise UsageError(
                "a robot file says itself which joints move, how far and fast, and where others are held",
                where=str(path),
                next_step="Change its [[axis]] and [held] tables, or give the URDF or MJCF to --robot.",
            )
        return read_robot(path), ()
    from etude_arm.urdf import spec_from_model

    found = spec_from_model(path, joints=joints, held=held, given=limits)
    return found.spec, found.confirm


def describe(
    path: Path,
    joints: Sequence[str] | None = None,
    held: Mapping[str, float] | None = None,
    mesh_roots: Sequence[Path] = (),
    limits: Mapping[str, Mapping[str, float]] | None = None,
    floor: float | None = None,
) -> Described:
    """robot.toml and a whole copy of the model file that it points to, with its meshes.

    Args:
        path, joints, held, limits: as of `read`. mesh_roots: folders to look for meshes in first.
        floor: its height, m, which the owner knows; else the model file's, or one at 0 is assumed.

    Raises:
        UsageError: no robot, or a model file that cannot be read or completed.
    """
    spec, confirm = read(path, joints, held, limits)
    if floor is not None:
        spec = replace(spec, around=replace(spec.around, floor=_floor(path, floor)))
    files: dict[str, bytes] = {}
    if spec.model_file is not None:
        from etude_arm.clearance.of_robot import completed
        from etude_arm.clearance.srdf import disabled
        from etude_arm.loading.crowded import crowded_links, crowds, hemmed_in
        from etude_arm.loading.lengths import check_lengths
        from etude_arm.loading.load import load_arm
        from etude_arm.loading.pack import packed
        from etude_arm.loading.placeholders import made_up
        from etude_arm.weight import sentences as weight_sentences

        name, leave = f"{MODEL_NAME}{spec.model_file.suffix}", disabled(spec.model_file)
        loaded = load_arm(spec, mesh_roots=mesh_roots)
        if whole_file := path.suffix.lower() != ".toml":
            check_lengths(loaded)
        crowded = crowded_links(crowds(loaded, spec.lower, spec.upper))
        finer: list[str] = []
        files[name], meshes = packed(spec.model_file, mesh_roots, crowded, finer)
        files |= meshes
        whole, spec = spec, replace(spec, model_file=Path(name))
        final = _loaded_from(spec, files)
        around, of_around = completed(spec, final, leave, whole_file=whole_file)
        if around.collision.look:
            finer += hemmed_in(crowds(final, spec.lower, spec.upper), around.collision.ignore)
        spec = replace(spec, around=around)
        home = np.array(around.search.home) if around.search else 0.5 * (spec.lower + spec.upper)
        confirm = (
            *confirm,
            *loaded.notes,
            *made_up(loaded),
            *finer,
            *of_around,
            *weight_sentences(whole, home),
        )
    spec = replace(spec, confirm=tuple(dict.fromkeys((*spec.confirm, *confirm))))
    return Described({ROBOT_FILE: robot_to_toml(spec).encode(), **files}, spec.confirm)


def _floor(path: Path, height: float) -> Floor:
    """UsageError: a robot file says where its own is, or it is no number."""
    from etude_arm.clearance.surroundings import Floor

    if path.suffix.lower() == ".toml":
        raise UsageError(
            "a robot file says itself where the floor is",
            where=str(path),
            next_step="Write [floor] in it, or in the campaign's robot.toml.",
        )
    return Floor(height)


def _loaded_from(spec: ArmSpec, files: Mapping[str, bytes]) -> Loaded:
    """The model as the campaign will load it: its shapes are those that were packed."""
    from etude_arm.loading.load import load_arm

    assert spec.model_file is not None
    with TemporaryDirectory() as folder:
        for name, data in files.items():
            path = Path(folder) / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        return load_arm(replace(spec, model_file=Path(folder) / spec.model_file))
