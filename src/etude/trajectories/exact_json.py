"""Exact numbers out: the text that a trajectory is stored as."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np


def to_text(form: str, fields: Mapping[str, Any]) -> str:
    """JSON text of a trajectory; floats are printed so that they read back to the same bits."""
    content = {name: np.asarray(value, dtype=float).tolist() for name, value in fields.items()}
    return json.dumps({"form": form, **content}, indent=1) + "\n"
