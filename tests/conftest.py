"""Marker `thinned`: of the cases of one law some run every day, and all of them with the slow tests at night.

`@pytest.mark.thinned` leaves as many as meet each value of each parameter, `thinned(3)` every third. A log
that many tests tell is judged once. Every day the tests of a file marked `as_logged` take commands to be as
they were logged: there judging takes a quarter of the time, and other files test it. At night it judges.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from judged_once import once
from thinning import daily


@pytest.fixture(scope="session", autouse=True)
def judged_once() -> Iterator[None]:
    """Campaigns look the functions up when they judge a log."""
    from etude.logs.evidence import command_signs, contradictions

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(command_signs, "sign_decision", once(command_signs.sign_decision))
        patch.setattr(contradictions, "change_within", once(contradictions.change_within))
        yield


@pytest.fixture(scope="module", autouse=True)
def as_logged(request: pytest.FixtureRequest, judged_once: None) -> Iterator[None]:
    """In files of this mark, unless other tests are asked for than those of every day."""
    everyday = request.config.getoption("markexpr") == "not slow"
    if not everyday or not request.node.get_closest_marker("as_logged"):
        yield
        return
    from etude.logs import Decision
    from etude.logs.evidence import command_signs, contradictions
    from etude.types import Channel

    def silent(_: object, path: Channel, *rest: object, **named: object) -> Decision:
        """What is said where no row tells anything."""
        none = np.zeros(len(path.parts))
        return Decision("silent", none, none > 0.0, none > 0.0)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(command_signs, "sign_decision", silent)
        patch.setattr(contradictions, "change_within", lambda *_: None)
        yield


@pytest.hookimpl(tryfirst=True)  # before those that deselect
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    laws: dict[str, list[pytest.Item]] = {}
    for item in items:
        if item.get_closest_marker("thinned"):
            laws.setdefault(item.nodeid.partition("[")[0], []).append(item)
    for cases in laws.values():
        (*step,) = cases[0].get_closest_marker("thinned").args  # type: ignore[union-attr]
        kept = daily([_values(case) for case in cases], *step)
        for place, case in enumerate(cases):
            if place not in kept:
                case.add_marker(pytest.mark.slow)


def _values(case: pytest.Item) -> dict[str, tuple[int, ...]]:
    """The objects of a case by parameter; arguments that one list gives together are one parameter."""
    given = {name: id(value) for name, value in case.callspec.params.items()}  # type: ignore[attr-defined]
    found = {}
    for mark in case.iter_markers("parametrize"):
        names = mark.args[0].split(",") if isinstance(mark.args[0], str) else mark.args[0]
        found[",".join(names)] = tuple(given.pop(name.strip()) for name in names)
    return found | {name: (value,) for name, value in given.items()}
