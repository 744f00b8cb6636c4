"""Logs that many tests tell: what is found in one is found once in a process.

Campaigns of tests log the same motions of the same robots, and judging a log is half of telling it. What is
found is a function of the arguments alone; `tests/logs` calls the functions themselves.
"""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable
from functools import wraps
from typing import Any

from etude.types import Log


def once(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function with a memory; arguments that cannot be pickled are not remembered."""
    known: dict[bytes, Any] = {}

    @wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        try:
            words = pickle.dumps([_contents(one) for one in (*arguments, *sorted(named.items()))])
        except (pickle.PicklingError, AttributeError, TypeError):
            return function(*arguments, **named)
        key = hashlib.blake2b(words).digest()
        if key not in known:
            known[key] = function(*arguments, **named)
        return known[key]

    return call


def _contents(argument: Any) -> Any:
    """Of a log its columns: the name of its file is no matter."""
    if isinstance(argument, Log):
        return argument.t, argument.values, argument.channels
    return [_contents(one) for one in argument] if isinstance(argument, list) else argument
