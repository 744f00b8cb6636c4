"""What the page calls things. Names that it does not know stand for themselves."""

from __future__ import annotations

from dataclasses import dataclass


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
    "pid": Baseline("PID alone", "c2", "with PID alone", "PID control alone has {error} ({relation})."),
    "rigid_body": Baseline(
        "identified physics",
        "c5",
        "with identified physics",
        "With identified physics alone it is {error} ({relation}).",
    ),
    "online": Baseline(
        "learning on line",
        "c4",
        "while it goes on learning",
        "While the model goes on learning in the test it is {error} ({relation}).",
    ),
    "perfect": Baseline(
        "perfect model",
        "c3",
        "with a perfect model",
        "A perfect model of this robot has {error}, about the floor.",
    ),
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
"""In the order in which they are told of."""
FEEDBACK = ("pd", "pid")
"""Baselines without any feedforward: where the first round starts from."""

TESTS = {
    "fourier": "a smooth Fourier test motion",
    "moves": "point-to-point moves",
    "uniform": "a random test flight",
    "boundary": "a test flight at the edge of its limits",
}

TITLES = {"fourier": "smooth Fourier test motion"}
"""Where a title has another word than a sentence."""

QUANTITIES = {"deg": "tracking error (degrees)", "m": "position error (m)"}


def baseline(name: str) -> Baseline:
    """What is known of a baseline; one from elsewhere is told of by its name."""
    plain = name.replace("_", " ")
    words = Baseline(plain, "c7", f"with {plain}", f"With {plain} it is {{error}} ({{relation}}).")
    return BASELINES.get(name, words)


def in_telling_order(names: list[str]) -> list[str]:
    """Known baselines first, in their order; then the others."""
    return [n for n in BASELINES if n in names] + [n for n in names if n not in BASELINES]


def error_axis(unit: str) -> str:
    """Title of an axis of tracking errors in that unit."""
    return QUANTITIES.get(unit, f"tracking error ({unit})")


def test_name(name: str) -> str:
    """A test motion in a sentence."""
    return TESTS.get(name, f"the test “{name}”")


def test_title(name: str) -> str:
    """A test motion in a title."""
    return TITLES.get(name, TESTS.get(name, name))


def unit_sign(unit: str) -> str:
    """A unit as it is written on the page."""
    return {"deg": "°", "1": ""}.get(unit, unit.replace("^2", "²").replace("^3", "³"))
