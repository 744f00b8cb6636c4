"""What a message tells to install is what the extras ask for."""

from __future__ import annotations

import tomllib
from pathlib import Path

from etude.logs.readers.extras import REQUIREMENTS

ROOT = Path(__file__).parents[3]
DRIVERS = ("cflib", "cyclonedds", "pylibfranka", "pymavlink", "rtde_control")


def test_messages_ask_for_what_the_extras_ask_for() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
        "optional-dependencies"
    ]
    stated = {own for name in ("ros", "px4", "matlab", "onnx") for own in extras[name]}
    drivers = {own for name, own in REQUIREMENTS.items() if name in DRIVERS}
    assert len(drivers) == len(DRIVERS)
    assert set(REQUIREMENTS.values()) == stated | drivers
    assert {REQUIREMENTS["pymavlink"], REQUIREMENTS["cflib"]} <= set(extras["test"])
