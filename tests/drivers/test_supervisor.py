"""Each thing that a supervisor watches stops a motion when it lasts, and not when it is one sample."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from etude.drivers import Bounds, PlannedMotion, Reaction, Sample, Supervisor, planned
from etude.errors import UsageError
from etude.testing import FakeRobot
from etude.trajectories import PointToPoint

NAMES = ("base", "elbow")
ONES = np.ones(2)
BOUNDS = Bounds(
    error=0.1 * ONES,
    lower=-1.0 * ONES,
    upper=1.0 * ONES,
    velocity=2.0 * ONES,
    effort=50.0 * ONES,
    residual=3.0 * ONES,
)
FROM = 60
"""Row from which on something is wrong."""
Change = Callable[[Sample], Sample]


def motion() -> PlannedMotion:
    path = PointToPoint(np.array([[0.0, 0.0], [0.5, -0.4]]), 0.5, dwell=0.1, peak_acceleration=2.0)
    text = path.to_json().encode()
    return planned(text, number=1, part="motion", speed=100, names=NAMES, joints=NAMES, rate=100.0)


def watched(change: Change, rows: int, known: bool = True, measured: bool = True) -> Supervisor:
    """Of a robot that is where it is asked to be; the change is of so many rows from `FROM` on."""
    own = motion()
    supervisor = Supervisor(BOUNDS, FakeRobot(NAMES).about(), own, np.zeros_like(own.q) if known else None)
    for row, t in enumerate(own.t):
        qd = own.qd[row] if measured else None
        sample = Sample(10.0 + t, own.q[row] + 1e-9 * row, 0.1 * ONES, qd, own.q[row], 500.0 + t, float(t))
        sample = change(sample) if FROM <= row < FROM + rows else sample
        if supervisor.watch(sample) is Reaction.STOP:
            break
    return supervisor


def off(**values: float) -> Change:
    """A sample with something added to the elbow."""

    def change(sample: Sample) -> Sample:
        added = {name: getattr(sample, name) + np.array([0.0, value]) for name, value in values.items()}
        return replace(sample, **added)  # type: ignore[arg-type]

    return change


def beyond(place: float) -> Change:
    """The elbow is there, and was asked to be."""

    def change(sample: Sample) -> Sample:
        q = np.array([sample.q[0], place])
        return replace(sample, q=q, asked=q)

    return change


CASES: dict[str, Change] = {
    "elbow is 0.2 from its set-point, more than 0.1": off(q=0.2),
    "elbow is 1.4 above its upper limit": beyond(2.4),
    "elbow is 1.4 below its lower limit": beyond(-2.4),
    "elbow moves at": off(qd=-3.0),
    "the command of elbow is 60.1, more than 50": off(command=60.0),
    "a position is not a number": off(q=np.nan),
    "the driver does not report its set-points": lambda s: replace(s, asked=None),
    "the robot's clock is 2.00 s off ours": lambda s: replace(s, t=s.t + 2.0),
    "the robot's clock jumped by": lambda s: replace(s, t=s.t - 0.3),
}


@pytest.mark.parametrize("words", CASES)
def test_what_lasts_stops_and_a_glitch_does_not(words: str) -> None:
    assert watched(CASES[words], 1).reason == ""
    assert watched(CASES[words], 99).reason.startswith(words)


def test_what_the_robot_reports_stops_at_once() -> None:
    assert watched(lambda s: replace(s, fault="reflex"), 1).reason == "fake robot reports: reflex"


def test_a_push_shows_in_the_command_where_stiff_feedback_hides_it() -> None:
    """5 N m of a push in means of 0.1 s, against what was predicted; nothing where nothing is."""
    found = watched(off(command=5.0), 99)
    assert found.reason.startswith("the command of elbow is")
    assert "from the model, more than 3" in found.reason
    assert watched(off(command=5.0), 4).reason == "", "means of 0.1 s"
    assert watched(off(command=5.0), 99, known=False).reason == ""


def test_velocities_are_told_from_positions_where_they_are_not_measured() -> None:
    def runs(sample: Sample) -> Sample:
        assert sample.at is not None
        way = np.array([0.0, 3.0 * (sample.at - 0.01 * FROM)])
        return replace(sample, q=sample.q + way, asked=sample.q + way)

    assert watched(runs, 99, measured=False).reason.startswith("elbow moves at")


def test_frozen_encoders_are_noticed_while_the_motion_goes_on() -> None:
    held = motion().q[FROM]
    found = watched(lambda s: replace(s, q=held), 99)
    assert found.reason.startswith("no position changes although")
    at = float(found.reason.split(" at ")[1].split(" s ")[0])
    assert at - 0.01 * FROM < 0.15, "at 0.4 rad/s"


def test_the_worst_error_leaves_a_glitch_out() -> None:
    assert watched(off(q=0.09), 1).worst_error.max() < 1e-6
    assert watched(off(q=0.09), 9).worst_error.max() == pytest.approx(0.09, abs=1e-6)


def test_bounds_and_motion_have_to_fit() -> None:
    about, own = FakeRobot(NAMES).about(), motion()
    with pytest.raises(UsageError, match=r"bounds\.error has shape"):
        Supervisor(replace(BOUNDS, error=np.ones(3)), about, own)
    with pytest.raises(UsageError, match="the motion has the joints elbow, base"):
        Supervisor(BOUNDS, about, replace(own, joints=NAMES[::-1]))
    with pytest.raises(UsageError, match="predicted commands have shape"):
        Supervisor(BOUNDS, about, own, np.zeros((2, 2)))
