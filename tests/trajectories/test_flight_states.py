"""Joining and taking samples of flights."""

import numpy as np

from etude.trajectories.flight.states import FlightStates, join_states


def states(count, altitude=True):
    rows = np.arange(3.0 * count).reshape(count, 3)
    return FlightStates(np.arange(float(count)) if altitude else None, rows, rows + 1, rows + 2, rows + 3)


def test_joined_parts_can_be_taken_apart():
    whole = join_states([states(4), states(3)])
    assert len(whole) == 7
    back = whole.take(slice(4, None))
    np.testing.assert_array_equal(back.rates, states(3).rates)
    np.testing.assert_array_equal(back.altitude, states(3).altitude)
    assert whole.acceleration is None


def test_what_one_part_lacks_the_whole_lacks():
    assert join_states([states(4), states(3, altitude=False)]).altitude is None
