"""Measured commands and their predictions before they were learned, with the 95 % band."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from etude.errors import EtudeError
from etude.protocols import Model
from etude.report.markup import Html, grid, missing_data, number, paragraph, section, test_name
from etude.report.record import Record, tests
from etude.report.scales import Axis
from etude.report.svg import Area, Level, Line, Mark, panel, thinned
from etude.types import Array, Log, Samples

Z95 = 1.96
"""Half width of a normal distribution's 95 % interval, in deviations."""
TITLE = "Predicted against measured command"
SIZE = (560, 260)  # px


@dataclass(frozen=True, eq=False)
class ExpectedError:
    """A log at the model's rate, beside what a model says of it.

    Attributes:
        samples: of the log.
        mean, deviation: (n, J) predicted.
        path: (n, k) where the robot was, or None where the log does not say.
    """

    samples: Samples
    mean: Array
    deviation: Array
    path: Array | None

    @property
    def t(self) -> Array:
        return self.samples.t

    @property
    def command(self) -> Array:
        return self.samples.command

    @property
    def spread(self) -> Array:
        """(n,) mean deviation over the commands."""
        return np.asarray(self.deviation.mean(axis=1))


def expected_error(record: Record, model: Model, log: Log) -> ExpectedError:
    """What `model` predicts for a log.

    Raises:
        EtudeError: nothing is left of the log, or it does not fit the model.
    """
    campaign = record.campaign
    assert campaign is not None  # no model is read without it
    group = np.zeros(len(log), dtype=np.int64)
    samples = campaign.kind.samples(campaign.spec, campaign.config, [log], [group])
    mean, variance = model.posterior(samples.log)
    places = log.get(campaign.kind.path)
    path = None
    if places is not None:
        path = np.stack([np.interp(samples.t, log.t, column) for column in places.T], axis=1)
    return ExpectedError(samples, mean, np.sqrt(np.maximum(variance, 0.0)), path)


def newest_expected_error(record: Record) -> tuple[str, ExpectedError] | None:
    """Of the newest run of the first test, by the model in it; else of the newest log, by the one before.

    Raises:
        EtudeError: as `expected_error`.
    """
    return _newest_test_run(record) or _newest_predicted_log(record)


def _newest_test_run(record: Record) -> tuple[str, ExpectedError] | None:
    for test in tests(record)[:1]:
        run = record.test_run("", test.name)
        model = record.model(run[0].number or 0) if run else None
        if run is not None and model is not None:
            sentence = (
                f"The newest run of {test_name(test.name)}, after round {run[0].number}, by the model in "
                "use at that time, which was never trained on it."
            )
            return sentence, expected_error(record, model, run[1])
    return None


def _newest_predicted_log(record: Record) -> tuple[str, ExpectedError] | None:
    trained = record.state.trained
    if len(trained) < 2:
        return None
    model, log = record.model(trained[-2].number), record.log(trained[-1].number)
    if model is None or log is None:
        return None
    sentence = f"Log {trained[-1].number}, predicted by the model trained on the earlier logs."
    return sentence, expected_error(record, model, log)


def prediction(record: Record) -> Html:
    """Two panels per command: measured and predicted with the 95 % band, and their difference in it."""
    try:
        newest = newest_expected_error(record)
    except EtudeError as error:
        return section("prediction", TITLE, missing_data(f"The prediction could not be made: {error}"))
    if newest is None:
        nothing = missing_data("This needs two logs: one for training, one to predict.")
        return section("prediction", TITLE, nothing)
    which, predicted = newest
    moving = predicted.samples.moving
    inside = (np.abs(predicted.command - predicted.mean) <= Z95 * predicted.deviation)[moving]
    share = 100.0 * float(inside.mean()) if len(inside) else float("nan")
    text = paragraph(
        f"{which} The band should hold 95 % of the measured commands; here it holds {number(share)} %. "
        "Right: the same minus the prediction. While a joint is at rest, friction makes its command "
        "arbitrary, so nothing is predicted."
    )
    panels = [
        drawn
        for j, (name, unit) in enumerate(zip(record.outputs, record.units, strict=True))
        for drawn in command_panels(predicted, j, name.replace("_", " "), unit)
    ]
    return section("prediction", TITLE, text, grid(panels))


def command_panels(predicted: ExpectedError, j: int, name: str, unit: str) -> tuple[Html, Html]:
    """One command over time: measured, predicted and the band; and the error of the prediction."""
    stretches = _moving(predicted.samples.moving[:, j])
    measured, expected, half = predicted.command[:, j], predicted.mean[:, j], Z95 * predicted.deviation[:, j]
    label = "predicted" if predicted.samples.moving[:, j].all() else "predicted while moving"
    left = _bands(predicted.t, expected, half, stretches, label)
    lines = [Line(*thinned(predicted.t, measured, 600), "measured", "c8"), *left[1]]
    time = Axis("time (s)", limits=(float(predicted.t[0]), float(predicted.t[-1])))
    right = _bands(predicted.t, np.zeros_like(half), half, stretches, "")
    errors: list[Mark] = [*right[0], Level(0.0, style="axis-line")]
    for place, piece in enumerate(stretches):
        line = thinned(predicted.t[piece], (measured - expected)[piece], 400)
        errors.append(Line(*line, "" if place else "measured − predicted", "c8"))
    return (
        panel(name, time, Axis(f"command ({unit})"), [*left[0], *lines], size=SIZE),
        panel(f"{name}: error of the prediction", time, Axis(f"error ({unit})"), errors, size=SIZE),
    )


def _bands(
    t: Array, middle: Array, half: Array, stretches: Sequence[slice], label: str
) -> tuple[list[Mark], list[Mark]]:
    """Bands and middle lines in each stretch; the first of each carries its name."""
    areas: list[Mark] = []
    lines: list[Mark] = []
    for piece in stretches:
        low, high = (thinned(t[piece], (middle + sign * half)[piece], 300) for sign in (-1.0, 1.0))
        areas.append(Area(*low, *high, "" if areas else "95 % interval"))
        lines.append(Line(*thinned(t[piece], middle[piece], 400), "" if lines else label, "c2 dash"))
    return areas, lines


def _moving(moving: NDArray[np.bool_]) -> list[slice]:
    """Stretches of at least three samples that count."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], moving, [False]]).astype(int)))
    pairs = zip(edges[::2], edges[1::2], strict=True)
    return [slice(int(start), int(stop)) for start, stop in pairs if stop - start >= 3]
