"""Before any log: what the limits alone say. Between segments: which way is taken, and when there is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from design_examples import arm_family, arm_home, arm_inputs, arm_limits, arm_point, arm_spec

from etude.design import DesignConfig, chain_design, linked_chain, prior_latents
from etude.design.chain_design import dropped_sentence
from etude.design.latents import NOISE, SIGNAL
from etude.errors import UnsafeTrajectoryError
from etude.limits import certify
from etude.models import ModelConfig
from etude.types import Motion
from etude_arm import KIND

SPEC = arm_spec()
RANGES = {
    "q": (SPEC.lower, SPEC.upper),
    "qd": (-SPEC.velocity, SPEC.velocity),
    "qdd": (-SPEC.acceleration, SPEC.acceleration),
}


def test_lengths_are_half_ranges_and_commands_parts_of_their_limits() -> None:
    found = prior_latents(arm_inputs(), RANGES, SPEC.command, ModelConfig(), SPEC.names)
    assert found is not None
    assert [latent.commands for latent in found] == [(0,), (1,)]
    assert [latent.factors.tolist() for latent in found] == [[50.0], [20.0]]
    half = [0.8, 0.7, 0.5, 0.8, 1.0, 2.0, *[1.0] * (len(arm_inputs().columns) - 6)]
    for latent in found:
        posterior = latent.posterior
        wanted = posterior.kernel.initial(np.array(half), SIGNAL)  # type: ignore[attr-defined]
        np.testing.assert_allclose(posterior.theta, wanted)  # type: ignore[attr-defined]
        assert posterior.noise_variance == pytest.approx(NOISE**2)
        np.testing.assert_allclose(posterior.X[0, :6], [-0.1, 0.9, 0.0, 0.0, 0.0, 0.0])  # type: ignore[attr-defined]
    shared = prior_latents(
        arm_inputs(), RANGES, SPEC.command, ModelConfig(sharing="shared", kernel="ard_se"), SPEC.names
    )
    assert shared is not None
    assert [latent.commands for latent in shared] == [(0, 1)]
    # the thesis's inputs are plans, which have the limits of what is planned
    assert prior_latents(replace(arm_inputs(), desired=True), RANGES, SPEC.command, ModelConfig(), SPEC.names)


@pytest.mark.parametrize("lack", ["no limits", "an infinite one", "one joint short", "no width"])
def test_an_input_without_limits_leaves_nothing_to_design_from(lack: str) -> None:
    low, high = RANGES["qdd"]
    other = {
        "no limits": None,
        "an infinite one": (low, np.array([1.0, np.inf])),
        "one joint short": (low[:1], high[:1]),
        "no width": (low, np.array([1.0, -2.0])),
    }[lack]
    ranges = {name: own for name, own in {**RANGES, "qdd": other}.items() if own is not None}
    assert prior_latents(arm_inputs(), ranges, SPEC.command, ModelConfig(), SPEC.names) is None


def segments(count: int):
    family = arm_family()
    return [family.trajectory(arm_point(np.random.default_rng(seed), family, 0.6)) for seed in range(count)]


def approaches(motion, pose):
    return KIND.approaches(SPEC, motion, pose)


class Keep:
    """A limit that refuses what `bad` says of a piece."""

    name = "keep"

    def __init__(self, bad) -> None:
        self.bad = bad

    def prove(self, piece):
        (row,) = arm_limits()[0].prove(piece)[:1]
        return [
            replace(row, quantity="keep", upper=-9.0) if self.bad(piece) else replace(row, quantity="keep")
        ]

    def of_motion(self, motion: Motion):
        return motion.orders[0][:, :1]


def straight(piece) -> bool:
    """A move that neither starts nor ends at home."""
    if piece.form != "moves":
        return False
    return not any(np.allclose(end, arm_home()) for end in (piece.waypoints[0], piece.waypoints[-1]))


def test_links_are_straight_hurried_and_certified() -> None:
    chain, kept = linked_chain(segments(3), approaches, arm_limits(), arm_home())
    assert kept == 3
    assert [label for _, label, _ in chain.pieces()] == ["segment", "link", "segment", "link", "segment"]
    assert all(certify(piece, arm_limits()).ok for _, label, piece in chain.pieces() if label == "link")
    (_, _, first), (_, _, link), (_, _, second) = chain.pieces()[:3]
    unhurried = approaches(second, first.motion(np.array([first.duration]), 1).orders[0, 0])[0]
    assert link.duration < unhurried.duration
    np.testing.assert_allclose(link.waypoints, unhurried.waypoints)  # type: ignore[attr-defined]


def test_where_the_straight_way_is_refused_it_goes_by_home_and_else_ends() -> None:
    own = segments(2)
    by_home, kept = linked_chain(own, approaches, (*arm_limits(), Keep(straight)), arm_home())
    assert kept == 2
    assert [label for _, label, _ in by_home.pieces()] == ["segment", "link", "link", "segment"]
    middle = by_home.pieces()[1][2]
    np.testing.assert_allclose(middle.waypoints[-1], arm_home())  # type: ignore[attr-defined]
    alone, kept = linked_chain(
        own, approaches, (*arm_limits(), Keep(lambda p: p.form == "moves")), arm_home()
    )
    assert kept == 1
    assert alone is own[0]
    assert dropped_sentence(1) == " Segments without a certified motion or approach were dropped: 1."
    assert linked_chain(own, lambda *_: None, arm_limits(), arm_home())[1] == 1


@pytest.mark.parametrize("there_are", [0, 2])
def test_a_segment_that_is_not_found_shortens_the_recording(
    there_are: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    designed, calls = chain_design.design, []

    def scarce(*given, **more):
        calls.append(more["given"])
        if len(calls) > there_are:
            raise UnsafeTrajectoryError("no motion keeps all limits")
        return designed(*given, **more)

    monkeypatch.setattr(chain_design, "design", scarce)
    latents = prior_latents(arm_inputs(), RANGES, SPEC.command, ModelConfig(), SPEC.names)
    place = arm_family(), arm_limits(), arm_home(), arm_inputs(), latents
    config, rng = DesignConfig(candidates=2, refine=0, reference_points=5), np.random.default_rng(0)

    def chain():
        return chain_design.design_chain(*place, config, rng, count=4, approaches=approaches)

    if not there_are:
        with pytest.raises(UnsafeTrajectoryError, match="no motion keeps"):
            chain()
        return
    found = chain()
    assert len(found.segments) == there_are
    assert found.dropped == 2
    assert found.status.endswith("were dropped: 2.")
    assert [len(before) for before in calls] == [0, 1, 2]
