"""What a model is held against: physics alone, and where it is no more than these, what there was before."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from etude.models.selection.model_selection import residuals_of

SEGMENTS, ROWS = 4, 50


def selection(own: Any, **held_out: Any) -> Any:
    """Of two commands; errors by structure."""
    group = np.repeat(np.arange(SEGMENTS), ROWS)
    left = SimpleNamespace(error=own, variance=np.ones_like(own), fold=group)
    held = {name: SimpleNamespace(error=error) for name, error in held_out.items()}
    command = np.random.default_rng(7).normal(size=own.shape)
    samples = SimpleNamespace(group=group)
    return SimpleNamespace(held_out=held, left_out=left, score_target=command, samples=samples)


@pytest.fixture
def errors() -> Any:
    rng = np.random.default_rng(0)
    return {name: rng.normal(size=(SEGMENTS * ROWS, 2)) for name in ("identified", "nominal", "gp")}


def test_a_model_with_more_is_held_against_physics(errors: Any) -> None:
    found = residuals_of(selection(errors["gp"], identified=errors["identified"], nominal=errors["nominal"]))
    assert found.structure == "identified"
    assert np.array_equal(found.physics, errors["identified"])


@pytest.mark.parametrize("off", [0.0, 0.01])
def test_one_that_is_physics_is_held_against_the_file(errors: Any, off: float) -> None:
    """Rounding, and a process that hardly adds anything, make no other model of it."""
    own = errors["identified"] * (1.0 + off)
    found = residuals_of(selection(own, identified=errors["identified"], nominal=errors["nominal"]))
    assert found.structure == "nominal"
    assert np.array_equal(found.physics, errors["nominal"])


def test_each_command_by_itself(errors: Any) -> None:
    own = np.column_stack([errors["identified"][:, 0], errors["gp"][:, 1]])
    found = residuals_of(selection(own, identified=errors["identified"], nominal=errors["nominal"]))
    assert found.structure == "identified"
    assert np.array_equal(found.physics[:, 0], errors["nominal"][:, 0])
    assert np.array_equal(found.physics[:, 1], errors["identified"][:, 1])


def test_without_a_file_a_constant_is_what_there_was(errors: Any) -> None:
    found = residuals_of(selection(errors["identified"], identified=errors["identified"]))
    assert found.structure == "constant"
    assert found.physics.std() == pytest.approx(1.0, abs=0.1)
