"""What the page calls things: robots of joints and flying vehicles share sections, in other words."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Words:
    """Nouns of one kind of robot.

    Attributes:
        robot: what moves.
        motion, motions: what is asked for.
        output: one learned command.
        feedback: the robot's own controller.
    """

    robot: str
    motion: str
    motions: str
    output: str
    feedback: str


JOINT_WORDS = Words("robot", "trajectory", "trajectories", "joint", "PD")
FLIGHT_WORDS = Words("vehicle", "flight", "flights", "command", "PID")


@dataclass(frozen=True)
class Baseline:
    """A controller that the learned one is held against.

    Attributes:
        name: on a curve.
        style: its colour.
        card: under its number on the first screen.
        sentence: of the headline; {error} and {relation} are filled in.
    """

    name: str
    style: str
    card: str
    sentence: str


BASELINES = {
    "pd": Baseline("PD alone", "c2", "with PD alone", "PD control alone has {error} ({relation})."),
    "rigid_body": Baseline(
        "rigid body",
        "c5",
        "with an identified rigid body",
        "PD with an identified rigid-body model has {error} ({relation}).",
    ),
    "perfect": Baseline(
        "perfect model",
        "c3",
        "with a perfect model",
        "A perfect model of this robot has {error}, about the floor.",
    ),
    "pid": Baseline("PID alone", "c2", "with PID alone", "PID control alone has {error} ({relation})."),
    "analytic": Baseline(
        "analytic, no drag",
        "c5",
        "with the analytic model without drag",
        "With the analytic inverse model without drag it is {error} ({relation}),",
    ),
    "exact_drag": Baseline(
        "analytic, exact linear drag",
        "c3",
        "with the exact linear drag",
        "and with the exact linear drag as well {error} ({relation}).",
    ),
}
"""In the order in which they are told of; a campaign has those of its kind."""

TESTS = {
    "fourier": "a smooth Fourier test motion",
    "moves": "point-to-point moves",
    "uniform": "a random test flight",
    "boundary": "a test flight at the edge of its limits",
}

TITLES = {"fourier": "smooth Fourier test motion"}
"""Where a title has another word than a sentence."""

ERROR_AXES = {"deg": "tracking error (degrees)", "m": "position error (m)"}


def baseline_name(name: str) -> str:
    return BASELINES[name].name if name in BASELINES else name


def baseline_style(name: str) -> str:
    return BASELINES[name].style if name in BASELINES else "c7"


def test_name(name: str) -> str:
    """A test motion in a sentence."""
    return TESTS.get(name, f"the test “{name}”")


def test_title(name: str) -> str:
    """A test motion in a title."""
    return TITLES.get(name, TESTS.get(name, name))
