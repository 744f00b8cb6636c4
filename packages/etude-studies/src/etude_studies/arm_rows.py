"""The rows of `etude study arm`: means over paired seeds with 95 % intervals, read from campaign folders."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from etude.campaign import Campaign, open_campaign, stored_model
from etude.logs import read_log_file
from etude.models import prediction_score
from etude_studies.rows import Row, mean_rows

TESTS = ("fourier", "moves")
ROUNDS_SHOWN = (1, 2, 3, 4, 6)
CALIBRATED_FROM = 3


class Named(Protocol):
    """A cell of the study."""

    @property
    def robot(self) -> str: ...
    @property
    def rung(self) -> str: ...
    @property
    def name(self) -> str: ...


def arm_rows(folder: Path, cells: Iterable[Named]) -> list[Row]:
    """Tracking errors beside the perfect model's, the baselines, held-out calibration; a block per arm."""
    arms: dict[tuple[str, str], list[Campaign]] = {}
    for cell in cells:
        arms.setdefault((cell.robot, cell.rung), []).append(open_campaign(folder / cell.name))
    rows = []
    for (robot, rung), campaigns in arms.items():
        name = f"{robot}_{rung}"
        rows += _tracking_rows(name, campaigns)
        rows += _calibration_rows(name, campaigns)
    return rows


def _tracking_rows(name: str, campaigns: Sequence[Campaign]) -> list[Row]:
    rows = []
    for test in TESTS:
        perfect = tracking_errors(campaigns, test, "perfect", None)
        for baseline in ("pd", "rigid_body"):
            errors = tracking_errors(campaigns, test, baseline, None)
            rows += mean_rows(f"{name}_{test}_{baseline}", errors, "deg", "perfect model", perfect)
        for number in ROUNDS_SHOWN:
            errors = tracking_errors(campaigns, test, "", number)
            rows += mean_rows(f"{name}_{test}_k{number}", errors, "deg", "perfect model", perfect)
    return rows


def tracking_errors(
    campaigns: Sequence[Campaign], test: str, baseline: str, number: int | None
) -> list[float]:
    """Mean over joints, one value per campaign; the newest evaluation where several fit."""
    errors = []
    for campaign in campaigns:
        fitting = [
            run.errors
            for round_number, run in campaign.state().evaluated
            if (run.test, run.baseline) == (test, baseline) and number in (None, round_number)
        ]
        errors += [float(np.mean(fitting[-1]))] if fitting else []
    return errors


def _calibration_rows(name: str, campaigns: Sequence[Campaign]) -> list[Row]:
    """z^2 and coverage per round, on the next trajectory before it was learned and on a test motion."""
    rows = []
    last = max(len(campaign.state().trained) for campaign in campaigns)
    sources: dict[str, tuple[int, Callable[[Campaign, int], Any]]] = {
        "next": (last - 1, _next_score),
        "test": (last, _test_score),
    }
    for source, (until, scores) in sources.items():
        for number in range(CALIBRATED_FROM, until + 1):
            z2, coverage = np.array([scores(campaign, number) for campaign in campaigns]).T
            target = "target 0.5 to 2.5"
            rows += mean_rows(f"{name}_z2_{source}_k{number}", list(z2), "1", target, [])
            rows += mean_rows(f"{name}_coverage_{source}_k{number}", list(coverage), "1", "nominal", [0.95])
    return rows


def _next_score(campaign: Campaign, number: int) -> tuple[float, float]:
    """Of the model in use after round `number`, on the trajectory of the next round."""
    before = campaign.state().rounds[number].trained
    after = campaign.state().rounds[number + 1].trained
    assert before is not None
    assert after is not None
    score = after.models[before.chosen]
    return _mean(score.z2), _mean(score.coverage)


def _test_score(campaign: Campaign, number: int) -> tuple[float, float]:
    """Of the model in use after round `number`, on the test motion as feedback alone ran it."""
    log = read_log_file(campaign.path / "tests" / f"0000.pd.{TESTS[0]}.parquet")
    groups = [np.zeros(len(log), dtype=np.int64)]
    new = campaign.kind.samples(campaign.spec, campaign.config, [log], groups)
    score = prediction_score(new, *stored_model(campaign, number).posterior(new.log))
    return float(np.nanmean(score.z2)), float(np.nanmean(score.coverage))


def _mean(values: Sequence[float | None]) -> float:
    return float(np.mean([value for value in values if value is not None]))
