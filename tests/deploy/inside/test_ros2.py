"""The exported controller, compiled against stand-ins of ros2_control, commands what the model says."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from c_models import ARM, QUADROTOR, arm_model, arm_spec, quadrotor_model, quadrotor_spec

from compilers import run, tool
from etude.deploy import planned
from etude.deploy.targets.c99.self_test import expected_outputs
from etude.deploy.targets.ros2.target import ROS2
from etude.errors import UsageError
from etude.types import Array, Delivered

HERE = Path(__file__).parents[1]
PACKAGE = "arm4_feedforward"
STRICT = ("-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O0")
J, PERIOD, FADE = 4, 0.01, 0.2


def spec() -> Any:
    return replace(arm_spec(), command_unit="N m")


@dataclass(frozen=True)
class Built:
    """The package on disk, its program, and the model."""

    folder: Path
    delivered: Delivered
    model: Any
    plan: Any

    def drive(self, rows: Array, *words: float) -> tuple[list[str], Array, str]:
        """Names of interfaces, commands of each row and of the end, and what was allocated."""
        lines = "\n".join(" ".join(repr(float(v)) for v in row) for row in rows)
        (self.folder / "rows").write_text(lines)
        said = run(["sh", "-c", f"./drive {' '.join(map(str, words))} < rows"], self.folder).splitlines()
        return said[:3], np.array([[float(v) for v in line.split()] for line in said[3:-1]]), said[-1]


def build(folder: Path, delivered: Delivered) -> None:
    for name, data in delivered.files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    include = f"include/{PACKAGE}"
    run([tool("gcc"), "-std=c99", "-O0", f"-I{include}", "-c", "src/arm4.c", "-o", "model.o"], folder)
    header = f'-DHEADER="{PACKAGE}/feedforward.hpp"'
    flags = [*STRICT, "-Iinclude", f"-I{include}", f"-I{HERE / 'ros2_stubs'}", f"-DPACKAGE={PACKAGE}", header]
    sources = ["src/feedforward.cpp", str(HERE / "ros2_drive.cpp"), "model.o"]
    run([tool("g++"), *flags, *sources, "-lm", "-o", "drive"], folder)


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Built:
    model = arm_model("exact", "standing", physics=True, memory=True, points=24)
    folder = tmp_path_factory.mktemp("ros2")
    delivered = ROS2(model, ARM, spec(), {"model_hash": "ab" * 32})
    build(folder, delivered)
    return Built(folder, delivered, model, planned(model, ARM, spec(), "arm4"))


def motion(plan: Any, count: int) -> Array:
    """(T, 3 J) within the data, slow enough for the memory."""
    t = np.arange(count)[:, None] * PERIOD
    middle, half = 0.5 * (plan.low + plan.high), 0.5 * (plan.high - plan.low)
    return np.asarray(middle + 0.8 * half * np.sin(2.0 * np.pi * 1.3 * t + np.arange(3 * J)))


def rows_of(references: Array, effort: float = 0.0, states: Array | None = None) -> Array:
    count = len(references)
    states = np.zeros((count, 2 * J)) if states is None else states
    return np.column_stack([np.full(count, PERIOD), references, np.full((count, J), effort), states])


def part(count: int) -> Array:
    """(T, 1) of the command while it fades in."""
    return np.minimum(1.0, np.arange(1, count + 1) * PERIOD / FADE)[:, None]


def test_it_commands_what_the_model_says(built: Built) -> None:
    asked = motion(built.plan, 60)
    names, found, allocated = built.drive(rows_of(asked, effort=0.01))
    in_order = [f"learned_feedforward/{n}/{o}" for o in ("position", "velocity", "acceleration", "effort")
                for n in spec().names]  # fmt: skip
    assert names[0].split() == in_order
    assert names[1].split() == [f"{n}/effort" for n in spec().names]
    assert names[2].split() == []
    said = expected_outputs(built.plan, asked).mean
    wanted = np.clip(part(60) ** 2 * said + 0.01, built.plan.least, built.plan.most)
    np.testing.assert_allclose(found[:-1], wanted, atol=1e-12)
    np.testing.assert_array_equal(found[-1], 0.0)
    assert allocated == "0 allocations"


def test_it_fades_where_nobody_asks_and_comes_back(built: Built) -> None:
    asked = motion(built.plan, 120)
    asked[40:80, 5] = np.nan
    _, found, _ = built.drive(rows_of(asked, effort=0.01))
    assert np.isfinite(found).all()
    told = np.concatenate([np.arange(1, 41), 40 - np.arange(1, 41), np.arange(1, 41)]) * PERIOD / FADE
    told[40:80] = np.maximum(0.0, 1.0 - np.arange(1, 41) * PERIOD / FADE)
    told = np.clip(told, 0.0, 1.0)[:, None]
    last = expected_outputs(built.plan, asked[:40]).mean[-1]
    np.testing.assert_allclose(found[40:80], np.clip(told[40:80] * last + 0.01, *limits(built)), atol=1e-12)
    np.testing.assert_allclose(found[65:80], 0.01, atol=1e-15)
    kept = expected_outputs(built.plan, np.concatenate([asked[:40], asked[80:]])).mean[40:]
    np.testing.assert_allclose(found[80:120], np.clip(told[80:] * kept + 0.01, *limits(built)), atol=1e-12)


def limits(built: Built) -> tuple[Array, Array]:
    return built.plan.least, built.plan.most


def test_far_outside_the_data_physics_and_the_feedback_stay(built: Built) -> None:
    """An arm whose gravity went there would fall."""
    asked = motion(built.plan, 90)
    asked[40:, 0] += 50.0
    states = np.column_stack([asked[:, :J] - 1e-3, asked[:, J : 2 * J] - 0.02])
    names, found, _ = built.drive(rows_of(asked, states=states), 2.0, 0.5)
    assert names[2].split() == [f"{n}/{o}" for o in ("position", "velocity") for n in spec().names]
    fed = 2.0 * 1e-3 + 0.5 * 0.02
    said = expected_outputs(built.plan, asked).mean
    wanted = np.clip(part(90) ** 2 * said + part(90) * fed, *limits(built))
    np.testing.assert_allclose(found[30], wanted[30], atol=1e-12)
    np.testing.assert_allclose(found[65:90], wanted[65:90], atol=1e-12)
    assert np.abs(said[65:90]).max() > 0.05  # physics go on


def test_what_is_no_number_or_too_large_is_left_out_or_clamped(built: Built) -> None:
    asked = motion(built.plan, 50)
    states = np.column_stack([asked[:, :J] - 1e-3, asked[:, J : 2 * J]])
    states[:, 1] = np.nan
    rows = rows_of(asked, states=states)
    rows[:, 1 + 3 * J] = np.inf  # efforts: one is no number, one is far beyond a limit
    rows[:, 2 + 3 * J] = 1e6
    _, found, _ = built.drive(rows, 2.0, 0.0)
    said = expected_outputs(built.plan, asked).mean
    wanted = said[45] + 2.0 * 1e-3 * np.array([1.0, 0.0, 1.0, 1.0])
    wanted[1] = built.plan.most[1]
    np.testing.assert_allclose(found[45], np.clip(wanted, *limits(built)), atol=1e-12)


def test_it_begins_anew_when_it_is_activated_again(built: Built) -> None:
    _, found, _ = built.drive(rows_of(motion(built.plan, 40)), 0.0, 0.0, J, 2)
    np.testing.assert_array_equal(found[:41], found[41:])


def test_a_wrong_number_of_gains_is_refused(built: Built) -> None:
    (built.folder / "rows").write_text("")
    assert run(["sh", "-c", "./drive 1 1 3 < rows 2> said; echo $?"], built.folder) == "3\n"
    assert "'p' and 'd' must hold 4 numbers" in (built.folder / "said").read_text()


def test_the_package_names_one_thing_by_one_name(built: Built) -> None:
    files = {name: data.decode() for name, data in built.delivered.files.items()}
    assert not [name for name, text in files.items() if re.search(r"@[A-Z]\w*@", text)]
    package = ET.fromstring(files["package.xml"])
    plugin = ET.fromstring(files["plugin.xml"])
    (row,) = plugin
    assert package.findtext("name") == plugin.get("path") == PACKAGE
    assert row.get("type") == f"{PACKAGE}::Feedforward"
    assert row.get("base_class_type") == "controller_interface::ChainableControllerInterface"
    assert f"type: {row.get('name')}" in files["config/controllers.yaml"]
    assert f"add_library({PACKAGE} SHARED src/feedforward.cpp src/arm4.c)" in files["CMakeLists.txt"]
    found = {d.text for d in package.iter("depend")}
    assert found == set(re.search(r"DEPENDENCIES (.*)\)", files["CMakeLists.txt"])[1].split())  # type: ignore[index]
    assert "abababababab" in files["README.md"]


def test_who_has_no_efforts_of_joints_is_refused() -> None:
    model = arm_model("exact", "ard_se", points=12)
    with pytest.raises(UsageError, match="are in pwm, an effort is in N m or N"):
        ROS2(model, ARM, arm_spec(), {})
    named = ROS2(model, ARM, arm_spec(), {"interface": "pwm"})
    assert b'"interface", "pwm"' in named.files["src/feedforward.cpp"]
    with pytest.raises(UsageError, match="commands joints by name"):
        ROS2(quadrotor_model("quadrotor", points=12), QUADROTOR, quadrotor_spec("quadrotor"), {})
    with pytest.raises(UsageError, match="--to ros2 has no option --real"):
        ROS2(model, ARM, spec(), {"real": "float"})
