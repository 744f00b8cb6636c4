"""Chains: where their parts are, that these meet at rest, and that each is proved by itself."""

from __future__ import annotations

import json
from itertools import pairwise

import numpy as np
import pytest

from etude.errors import UsageError
from etude.limits import AxisLimit, certify, certify_bytes
from etude.trajectories import Chain, FourierTrajectory, PointToPoint, chained, from_json, segment_starts


def swing(middle: float, size: float = 1.0) -> FourierTrajectory:
    """From rest to rest in 10 s: middle + size (cos 2wt - cos wt / ...), one axis."""
    omega0 = 2.0 * np.pi / 10.0
    return FourierTrajectory(np.array([[middle], [size], [-size], [0.0], [0.0]]), omega0, 10.0)


def way(start: float, end: float, speed: float = 0.5) -> PointToPoint:
    return PointToPoint(np.array([[start], [end]]), speed, dwell=0.25)


def chain() -> Chain:
    return Chain(
        (
            ("approach", way(-1.0, 0.0)),
            ("segment", swing(0.0)),
            ("link", way(0.0, 0.3)),
            ("segment", swing(0.3, 0.2)),
            ("return", way(0.3, -1.0)),
        )
    )


def test_pieces_follow_each_other_and_segments_say_when_they_start() -> None:
    found = chain().pieces()
    assert [label for _, label, _ in found] == ["approach", "segment", "link", "segment", "return"]
    for (start, _, piece), (following, _, _) in pairwise(found):
        assert following == pytest.approx(start + piece.duration)
    assert segment_starts(chain()) == [found[1][0], found[3][0]]
    assert segment_starts(swing(0.0)) == [0.0]
    assert chain().duration == pytest.approx(sum(piece.duration for _, _, piece in found))


def test_in_each_piece_it_is_that_piece() -> None:
    whole = chain()
    for start, _, piece in whole.pieces():
        t = np.linspace(0.01, piece.duration - 0.01, 50)
        np.testing.assert_allclose(whole.motion(t + start, 4).orders, piece.motion(t, 4).orders, atol=1e-9)


def test_times_in_any_order_and_none_at_all() -> None:
    whole = chain()
    t = np.random.default_rng(0).permutation(np.linspace(-1.0, whole.duration + 1.0, 301))
    order = np.argsort(t)
    np.testing.assert_array_equal(whole.motion(t).orders[:, order], whole.motion(t[order]).orders)
    assert whole.motion(np.zeros(0), 2).orders.shape == (2, 0, 1)


def test_a_limit_that_one_piece_leaves_is_refused_with_that_piece() -> None:
    speed = (AxisLimit("velocity", 1, ("a",), np.array([-2.1]), np.array([2.1]), rest=True),)
    assert certify_bytes(chain().to_json().encode(), speed).ok
    hurried = Chain((*chain().parts[:2], ("link", way(0.0, 0.3, 2.2)), *chain().parts[3:]))
    (row,) = certify(hurried, speed).failed
    assert row.where == f"link at {hurried.pieces()[2][0]:g} s"
    assert row.proved_upper == pytest.approx(2.2)


def test_the_file_holds_every_part_to_the_bit() -> None:
    again = from_json(chain().to_json())
    assert isinstance(again, Chain)
    assert again.to_json() == chain().to_json()
    assert [piece.form for _, _, piece in again.pieces()] == ["moves", "fourier", "moves", "fourier", "moves"]


def test_what_does_not_meet_at_rest_is_no_chain() -> None:
    with pytest.raises(UsageError, match=r"parts 1 and 2 .* a step of 0.1"):
        chained([swing(0.0), swing(0.3)], [[way(0.1, 0.3)]])
    moving = FourierTrajectory(np.array([[0.0], [1.0], [0.0]]), 2.0 * np.pi / 10.0, 10.0)
    with pytest.raises(UsageError, match="one of 1 in speed"):
        Chain((("segment", moving), ("segment", swing(0.0))))
    two = PointToPoint(np.zeros((2, 2)), 1.0)
    with pytest.raises(UsageError, match="different numbers of axes"):
        Chain((("segment", swing(0.0)), ("link", two)))


def test_a_single_segment_is_itself_and_chains_hold_no_chains() -> None:
    assert chained([swing(0.0)], []) == swing(0.0)
    for parts in ((), (("segment", swing(0.0)),), (("link", way(0.0, 1.0)), ("link", way(1.0, 0.0)))):
        with pytest.raises(UsageError, match="two parts or more"):
            Chain(parts)
    with pytest.raises(UsageError, match="one of segment, link"):
        Chain((("segment", swing(0.0)), ("pause", swing(0.0))))
    with pytest.raises(UsageError, match="a chain itself"):
        Chain((("segment", chain()), ("link", way(-1.0, 0.0))))
    with pytest.raises(UsageError, match="piece by piece"):
        chain().bound(1, 1)


def test_damaged_files_are_refused() -> None:
    content = json.loads(chain().to_json())
    nested = {"form": "chain", "parts": [["segment", content], content["parts"][2]]}
    for damaged in (
        {"form": "chain"},
        {"form": "chain", "parts": 3},
        {"form": "chain", "parts": [["segment"]]},
        {"form": ["chain"]},
        nested,
    ):
        with pytest.raises(UsageError, match="trajectory file"):
            from_json(json.dumps(damaged))
