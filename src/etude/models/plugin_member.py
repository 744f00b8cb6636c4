"""A member of another package: named in every message, and checked once it has learned."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from etude.errors import EtudeError, UsageError
from etude.protocols import FitData, Process
from etude.types import Array

METHODS = ("latents", "predict", "held_out", "arrays", "c")
VALUES = ("noise_variance", "signal_variance")


@dataclass(frozen=True)
class PluginMember:
    """What a plug-in names, as a member of the family."""

    name: str
    own: Any

    @classmethod
    def of(cls, name: str, own: Any) -> PluginMember:
        """The member. UsageError if it cannot learn or be stored."""
        if not callable(own) or not callable(getattr(own, "restore", None)):
            raise UsageError(f"the model {name!r} is no function with an attribute `restore`", next_step=_ASK)
        return cls(name, own)

    def __call__(self, fit: FitData) -> Process:
        """The process of the group. UsageError if it is none."""
        return self._checked(self._tried(lambda: self.own(fit)), fit.X[:3], fit.Y.shape[1])

    def restore(self, arrays: Mapping[str, Array]) -> Process:
        """The process whose arrays these are."""
        return cast("Process", self._tried(lambda: self.own.restore(arrays)))

    def _tried(self, what: Callable[[], Any]) -> Any:
        try:
            return what()
        except EtudeError:
            raise
        except Exception as error:
            raise self._wrong(f"fails ({type(error).__name__}: {error})") from error

    def _checked(self, process: Any, X: Array, commands: int) -> Process:
        missing = [name for name in METHODS if not callable(getattr(process, name, None))]
        missing += [name for name in VALUES if not hasattr(process, name)]
        if missing:
            raise self._wrong(f"makes a process without {', '.join(missing)}")
        mean, variance = self._tried(lambda: process.predict(X))
        values = {"mean": mean, "variance": variance}
        for name, shape in {
            **dict.fromkeys(values, (len(X), commands)),
            **dict.fromkeys(VALUES, (commands,)),
        }.items():
            value = np.asarray(values.get(name, getattr(process, name, None)), dtype=float)
            if value.shape != shape:
                raise self._wrong(f"gives a {name} of shape {value.shape}, not {shape}")
            if not np.isfinite(value).all() or (name != "mean" and bool((value < 0.0).any())):
                raise self._wrong(f"gives a {name} that is no number, or below zero")
        return cast("Process", process)

    def _wrong(self, what: str) -> UsageError:
        return UsageError(f"the model {self.name!r} {what}", next_step=_ASK)


_ASK = "Ask whoever wrote the plug-in; etude.testing.ProcessSuite shows what fails."
