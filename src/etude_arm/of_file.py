"""What was made of a robot and its model file: used again while neither has changed."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from etude.limits.certificate import memoized
from etude_arm.spec import ArmSpec

T = TypeVar("T")
MOST = 8
"""Robots."""


def of_file(store: dict[str, T], spec: ArmSpec, make: Callable[[], T]) -> T:
    """The value for a robot that has a model file, made anew when the robot or the file is another."""
    assert spec.model_file is not None
    stamp = spec.model_file.stat()
    return memoized(store, repr((spec, stamp.st_mtime_ns, stamp.st_size)), make, MOST)
