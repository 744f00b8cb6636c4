"""URScript: what the text does when it is run, line by line, as a controller would."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from etude import plugins
from etude.errors import UsageError
from etude.testing import world
from etude_arm import ArmSpec, Axis

KIND = plugins.load("etude.robots", "arm")
UR10 = Path(__file__).parents[3] / "examples" / "ur10" / "ur10.toml"
RATES = {"urscript": 500.0, "urscript_cb": 125.0}


class Halted(Exception):
    """The program stopped itself."""


class Controller:
    """Runs a program: lists are vectors, `servoj` takes its time, and nothing moves by itself."""

    def __init__(self, text: str, stands: np.ndarray) -> None:
        self.targets: list[np.ndarray] = []
        self.times: list[float] = []
        self.stands, self.said = stands, ""
        scope: dict[str, Any] = {
            "L": lambda *values: np.array(values, dtype=float),
            "True": True,
            "norm": abs,
            "servoj": self.servoj,
            "stopj": lambda acceleration: None,
            "get_actual_joint_positions": lambda: self.stands,
            "popup": self.popup,
            "halted": self.halted,
        }
        exec(as_python(text), scope)
        scope["etude_motion"]()

    def servoj(self, q: np.ndarray, a: float, v: float, t: float, lookahead_time: float, gain: float) -> None:
        assert a == v == 0
        assert 0.03 <= lookahead_time <= 0.2
        assert 100 <= gain <= 2000
        self.targets.append(np.array(q))
        self.times.append(t)

    def popup(self, text: str, title: str, error: bool, blocking: bool) -> None:
        self.said = text

    def halted(self) -> None:
        raise Halted(self.said)


def as_python(text: str) -> str:
    """The same program: a list of numbers is a vector, blocks end by indentation, globals are declared."""
    names = ", ".join(dict.fromkeys(re.findall(r"global (\w+) =", text)))
    lines = []
    for line in text.splitlines():
        if re.fullmatch(r" *end", line):
            continue
        line = re.sub(r"^( *)(?:global|local) ", r"\1", line)
        line = re.sub(r"(?<!\w)\[([^\]]*)\]", r"L(\1)", line).replace("halt", "halted()")
        lines.append(line)
        if found := re.match(r"^( *)def ", line):
            lines.append(f"{found[1]}  global {names}")
    return "\n".join(lines)


def program(name: str, seed: int = 0) -> tuple[str, Any]:
    here = world(KIND, UR10)
    motion = here.trajectory(seed)
    (text,) = plugins.load("etude.exporters", name)(motion, here.kind, here.spec).values()
    return text.decode("ascii"), motion


@pytest.mark.parametrize("name", RATES)
def test_the_program_that_is_run_plays_the_motion_that_is_certified(name: str) -> None:
    text, motion = program(name)
    start = motion.motion(np.zeros(1), 1).orders[0, 0]
    ran = Controller(text, start + 0.019)
    assert set(ran.times) == {1.0 / RATES[name]}
    t = np.concatenate([[0.0], np.cumsum(ran.times)[:-1]])
    exact = motion.motion(np.minimum(t, motion.duration), 3)
    size = np.ptp(exact.orders[0], axis=0).max()
    np.testing.assert_allclose(ran.targets, exact.orders[0], atol=1.1e-5 * size)
    back = plugins.load("etude.exporters", name).back({"motion.script": text.encode()})
    np.testing.assert_allclose(ran.targets, back.points[0], atol=1e-8)
    assert t[-1] == pytest.approx(motion.duration, abs=1.01 / RATES[name])
    # what the controller sees of derivatives: differences of targets
    second = np.diff(ran.targets, 2, axis=0) * RATES[name] ** 2
    assert np.abs(second).max() <= np.abs(exact.orders[2]).max() * 1.01


def test_an_arm_that_stands_elsewhere_is_not_moved() -> None:
    text, motion = program("urscript_cb", 1)
    away = motion.motion(np.zeros(1), 1).orders[0, 0]
    away[5] -= 0.021
    with pytest.raises(Halted, match="not at the start"):
        Controller(text, away)


def test_the_program_has_the_form_that_a_socket_takes() -> None:
    """`def` and `end` in the first column, all else behind a blank; ASCII."""
    text, _ = program("urscript", 2)
    first, *inner, last = text.splitlines()
    assert first == "def etude_motion():"
    assert last == "end"
    assert all(line.startswith(" ") for line in inner)


@pytest.mark.parametrize(("count", "unit"), [(5, "rad"), (7, "rad"), (6, "m")])
def test_another_robot_is_refused(count: int, unit: Any) -> None:
    motion = world(KIND, UR10).trajectory(0)
    axes = tuple(Axis(f"j{i}", -1.0, 1.0, 1.0, 1.0, 1.0, unit=unit) for i in range(count))
    with pytest.raises(UsageError, match="6 revolute joints"):
        plugins.load("etude.exporters", "urscript")(motion, KIND, ArmSpec("other", axes, "N m", 100.0))


def test_a_long_program_is_said() -> None:
    text, _ = program("urscript")
    own = plugins.load("etude.exporters", "urscript")
    (follows,) = own.notes({"motion.script": text.encode()})
    assert "0.1 s late" in follows
    calls = [line for line in text.splitlines() if line.startswith("  etude_to(")]
    longer = text.replace(calls[1], "\n".join([calls[1]] * 1001))
    assert "1000 lines" in own.notes({"motion.script": longer.encode()})[1]
