"""The quadrotor keeps the laws of a kind."""

from __future__ import annotations

from typing import ClassVar

from etude.robots.quadrotor.kind import KIND
from etude.testing.kind import KindSuite


class TestQuadrotor(KindSuite):
    kind = KIND
    robot = "quadrotor"
    loose: ClassVar[frozenset[str]] = frozenset({"tilt", "thrust"})
