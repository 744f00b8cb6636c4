"""What models say of recorded motions that they had not learned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from etude.protocols import Model
from etude.report.curves import tests
from etude.report.record import Record
from etude.report.words import test_name
from etude.types import Array, Log, Samples


@dataclass(frozen=True, eq=False)
class Forecast:
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


def forecast(record: Record, model: Model, log: Log) -> Forecast:
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
    return Forecast(samples, mean, np.sqrt(np.maximum(variance, 0.0)), path)


def newest_forecast(record: Record) -> tuple[str, Forecast] | None:
    """Of the newest run of the first test, by the model in it; else of the newest log, by the one before.

    Raises:
        EtudeError: as `forecast`.
    """
    return _tested(record) or _told(record)


def _tested(record: Record) -> tuple[str, Forecast] | None:
    for test in tests(record)[:1]:
        run = record.test_run(None, test.name)
        model = record.model(run[0].number or 0) if run else None
        if run is not None and model is not None:
            sentence = (
                f"The newest run of {test_name(test.name)}, after round {run[0].number}, by the model "
                "in use then, which never learned from it."
            )
            return sentence, forecast(record, model, run[1])
    return None


def _told(record: Record) -> tuple[str, Forecast] | None:
    trained = record.state.trained
    if len(trained) < 2:
        return None
    model, log = record.model(trained[-2].number), record.log(trained[-1].number)
    if model is None or log is None:
        return None
    sentence = f"Log {trained[-1].number}, predicted by the model learned from the logs before it."
    return sentence, forecast(record, model, log)
