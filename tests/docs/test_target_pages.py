"""The pages on ROS 2, ONNX, PX4 and Crazyflie, followed as a new user would; what they export compiles."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path

import pytest
from test_docs import ROOT, blocks

from compilers import run, tool

DOCS, STUBS = ROOT / "docs", ROOT / "tests" / "deploy"
STRICT_C = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-O0", "-c")
STRICT_CPP = ("-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-O0", "-c")
pytestmark = pytest.mark.slow


def followed(name: str, place: Path) -> str:
    """What the page's commands say, one after the other."""
    (place / "examples").symlink_to(ROOT / "examples")
    said = ""
    page = DOCS / name
    for block in blocks(page, "sh"):
        for line in block.splitlines():
            words = shlex.split(line)
            if words[0] == "etude":
                said += run([sys.executable, "-m", "etude", *words[1:]], place)
    for block in blocks(page, "text"):
        for line in block.splitlines():
            assert line in said or line.startswith("obj-y"), f"{line}\n---\n{said}"
    return said


def test_ros2(tmp_path: Path) -> None:
    followed("deploy_ros2.md", tmp_path)
    folder = tmp_path / "lab" / "exports" / "ros2"
    include = "include/tx40_feedforward"
    run([tool("gcc"), *STRICT_C, f"-I{include}", "src/tx40.c"], folder)
    stubs = f"-I{STUBS / 'ros2_stubs'}"
    run([tool("g++"), *STRICT_CPP, "-Iinclude", f"-I{include}", stubs, "src/feedforward.cpp"], folder)
    played = (tmp_path / "lab" / "exports" / "trajectory" / "ros2_yaml" / "joint_trajectory.yaml").read_text()
    assert '"effort": [' in played


def test_onnx(tmp_path: Path) -> None:
    for library in ("onnx", "onnxruntime"):
        pytest.importorskip(library, reason="the page needs the extra 'onnx'")
    followed("deploy_onnx.md", tmp_path)
    (program,) = blocks(DOCS / "deploy_onnx.md", "py")
    said = run([sys.executable, "-c", program], tmp_path)
    assert float(said) > 0.0  # friction takes power on the way back, too


def test_px4(tmp_path: Path) -> None:
    pytest.importorskip("pyulog", reason="the page needs the extra 'px4'")
    followed("deploy_px4.md", tmp_path)
    folder = tmp_path / "sky" / "exports" / "px4"
    (program,) = blocks(DOCS / "deploy_px4.md", "c")
    (folder / "page.c").write_text(program, encoding="utf-8")
    sources = ["page.c", "sky.c", "sky_lean.c", "sky_flight.c", "sky_px4.c"]
    run([tool("gcc"), *STRICT_C, "-Wdouble-promotion", f"-I{STUBS / 'px4_stubs'}", "-I.", *sources], folder)


def test_crazyflie(tmp_path: Path) -> None:
    followed("deploy_crazyflie.md", tmp_path)
    folder = tmp_path / "cf" / "exports" / "crazyflie"
    sources = ["controller_cf.c", "cf_flight.c", "cf_lean.c", "cf.c"]
    run(
        [tool("gcc"), *STRICT_C, "-Wdouble-promotion", f"-I{STUBS / 'crazyflie_stubs'}", "-I.", *sources],
        folder,
    )
    assert "#define RATE 250" in (folder / "controller_cf.c").read_text()
