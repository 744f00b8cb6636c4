"""Optional libraries of formats and drivers: imported late; an error names the command that installs them.

Messages name the library itself, not an extra of Étude: on the package index the name belongs to another
project, so `pip install` with that name would fetch a stranger's package.
See docs/decisions/0048-name-on-the-index.md.
"""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

from etude.errors import UsageError

READING = "reading this log"
REQUIREMENTS = {
    "rosbags": "rosbags>=0.10.9",
    "pyulog": "pyulog>=1.1",
    "h5py": "h5py>=3.10",
    "onnx": "onnx>=1.16",
    "onnxruntime": "onnxruntime>=1.19",
    "cflib": "cflib>=0.1.34",
    "cyclonedds": "cyclonedds>=11",
    "pylibfranka": "pylibfranka>=0.21",
    "pymavlink": "pymavlink>=2.4.40",
    "rtde_control": "ur_rtde>=1.6",
}
"""What pip gets, by the name that is imported; bounds as in pyproject.toml's extras (a test compares). The
libraries of drivers are in no extra.
"""
ROSBAGS_BRINGS = ("lz4", "backports", "compression")
"""Packages that rosbags depends on and that bags are unpacked with."""


def needed(module: str, doing: str, path: Path | None = None, otherwise: str = "") -> Any:
    """The module.

    Args:
        module: its full name, as imported.
        doing: what needs it, as the subject of the message: "reading this log", "writing --format ros2".
        path: the file or folder that is read or written.
        otherwise: what to do instead of installing it.

    Raises:
        UsageError: it is not installed; the next step is the command that installs it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as problem:
        package = requirement(module.split(".")[0])
        raise UsageError(
            f"{doing} needs {package.partition('>')[0]}, which is not installed ({problem})",
            where="" if path is None else str(path),
            next_step=f"Install it: pip install '{package}'" + (f", {otherwise}" if otherwise else ""),
        ) from None


def requirement(library: str) -> str:
    """What to hand to pip for an imported package: "rosbags>=0.10.9"."""
    return REQUIREMENTS.get("rosbags" if library in ROSBAGS_BRINGS else library, library)
