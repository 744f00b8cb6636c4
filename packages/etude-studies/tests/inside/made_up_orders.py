"""Cells of the study of flights with errors as asked for, nothing flown."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from etude_studies.flight_orders_cell import ARMS
from etude_studies.flight_orders_judge import FIGURES
from etude_studies.flight_orders_rows import TESTS

KINDS = ("gp", "identified", "identified+gp", "nominal", "ladder")


def made_up(
    seed: int,
    mae: Callable[[str, str], float],
    latent: Callable[[str], float] = lambda _: 1.0,
    arms: tuple[str, ...] = ARMS,
    flights: int = 5,
) -> dict[str, Any]:
    """One cell: `mae(arm, test)` for every kind and count, and `latent(arm)` for both deviations."""

    def of(arm: str) -> dict[str, Any]:
        tests = {
            test: {kind: dict.fromkeys(FIGURES, 1.0) | {"mae": mae(arm, test)} for kind in KINDS}
            for test in TESTS
        }
        reference = {"latent": latent(arm), "latent_common": latent(arm)}
        return {"tests": tests, "reference": reference, "chosen": "gp"}

    measured = {arm: {str(n): of(arm) for n in range(1, flights + 1)} for arm in arms}
    return {"seed": seed, "measured": measured, "speed": dict.fromkeys(arms, [1.0] * flights), "cpu_s": 1.0}
