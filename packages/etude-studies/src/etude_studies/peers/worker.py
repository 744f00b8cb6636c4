"""A peer in an interpreter of its own: a request a line of JSON in, an answer a line of JSON out.

The file is run by the other environment's interpreter, in which Étude is not installed: it needs the standard
library, numpy, and the peer. Requests and their answers, in this order:

* {"file", "distribution", "X", "y"}: loads the peer's file and data -> {"version", "note"}
* {"parameters"}: evaluates -> {"value", "gradient", "seconds"}, any number of times

What fails is answered {"error"}, in words. The process ends with its input.
"""

from __future__ import annotations

import json
import os
import sys
import time
import warnings
from collections.abc import Callable
from importlib.metadata import version
from importlib.util import module_from_spec, spec_from_file_location
from typing import Any

Objective = Callable[[Any], tuple[float, Any]]


def loaded(file: str) -> Any:
    """The module in that file; what the library in it warns of while it is imported is not shown."""
    spec = spec_from_file_location("peer", file)
    if spec is None or spec.loader is None:
        raise ImportError(f"{file} is no Python file")
    module = module_from_spec(spec)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        spec.loader.exec_module(module)
    return module


def timed(objective: Objective, parameters: Any) -> tuple[float, Any, float]:
    """Value, gradient and the seconds they took."""
    start = time.perf_counter()
    value, gradient = objective(parameters)
    return value, gradient, time.perf_counter() - start


class Served:
    """Answers requests: first the peer and the data, then parameters."""

    objective: Objective

    def answer(self, request: dict[str, Any]) -> dict[str, Any]:
        import numpy as np

        if "file" in request:
            module = loaded(request["file"])
            self.objective = module.objective(np.array(request["X"]), np.array(request["y"]))
            return {"version": version(request["distribution"]), "note": module.NOTE}
        value, gradient, seconds = timed(self.objective, np.array(request["parameters"]))
        return {"value": float(value), "gradient": np.asarray(gradient).tolist(), "seconds": seconds}


def main() -> None:
    """Serves standard input until it ends."""
    # whatever a library prints must not come between two answers
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    served = Served()
    for line in sys.stdin:
        try:
            answer = served.answer(json.loads(line))
        except Exception as error:
            answer = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), file=answers, flush=True)


if __name__ == "__main__":
    sys.path.pop(0)  # this folder: its files are Étude's, not the environment's
    main()
