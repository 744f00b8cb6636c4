"""Recordings as Parquet files that any tool opens; a header holds the other fields."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from etude.drivers.contract import Ended, Recording
from etude.drivers.plans import planned
from etude.errors import DataError, EtudeError, reason
from etude.storage import DAMAGE, write_atomic
from etude.types import Array

HEADER = "etude_recording"
FORMAT = 1
"""Of the header: it grows when what is in it does not read as before."""
MOTION = ("number", "part", "speed", "sha256", "joints", "names", "rate", "trajectory_json")
FACTS = ("reason", "began", "reached", "late", "identity", "command_unit", "held")
"""Of the header, beside ended, until (the motion's end) and format."""
CHANNELS = ("q", "qd", "command", "asked")


def write_recording(path: Path, recording: Recording) -> None:
    """Write a recording completely or not at all.

    Columns: t, at, q_JOINT, qd_JOINT, command_JOINT, asked_JOINT, and the samples' other measurements.
    Times are doubles; the rest is single precision, finer than encoders are.

    Raises:
        EtudeError: the disk is full or refuses.
    """
    import polars

    columns: dict[str, Any] = {"t": recording.t, "at": recording.at}
    for channel in CHANNELS:
        values = getattr(recording, channel)
        for j, joint in enumerate(recording.motion.joints if values is not None else ()):
            columns[f"{channel}_{joint}"] = values[:, j].astype(np.float32)
    columns |= {name: values.astype(np.float32) for name, values in recording.extra.items()}
    buffer = io.BytesIO()
    polars.DataFrame(columns).write_parquet(
        buffer,
        compression="zstd",
        compression_level=9,
        statistics=False,
        metadata={HEADER: json.dumps(_header(recording))},
    )
    write_atomic(path, buffer.getvalue())


def read_recording(path: Path) -> Recording:
    """The recording. Its motion is evaluated again from the trajectory in it, and has no effort.

    Raises:
        DataError: no such file, a damaged one, or one that is no recording.
    """
    import polars

    try:
        data = Path(path).read_bytes()
        header = json.loads(polars.read_parquet_metadata(io.BytesIO(data))[HEADER])
        return _recording(header, polars.read_parquet(io.BytesIO(data)))
    except (*DAMAGE, EtudeError, polars.exceptions.PolarsError) as error:
        raise DataError(
            f"it is not a recording of etude run: {reason(error)}",
            where=str(path),
            next_step="Name a file of etude run; ingest other logs with etude tell.",
        ) from error


def _header(recording: Recording) -> dict[str, Any]:
    motion = {name: getattr(recording.motion, name) for name in MOTION}
    facts = {name: getattr(recording, name) for name in FACTS}
    return {
        "format": FORMAT,
        **motion,
        "until": recording.motion.duration,
        **facts,
        "ended": recording.ended.value,
    }


def _recording(header: dict[str, Any], frame: Any) -> Recording:
    text, joints = header["trajectory_json"].encode(), header["joints"]
    motion = planned(
        text,
        number=header["number"],
        part=header["part"],
        speed=header["speed"],
        names=header["names"],
        joints=joints,
        rate=header["rate"],
        until=header["until"],
    )
    if motion.sha256 != header["sha256"]:
        raise ValueError("its trajectory differs from the one in its header")

    def table(channel: str) -> Array:
        names = [f"{channel}_{joint}" for joint in joints]
        values: Array = frame.select(names).to_numpy().astype(float).reshape(len(frame), len(joints))
        return values

    facts = {name: header[name] for name in FACTS}
    rows = {"t", "at", *(f"{channel}_{joint}" for channel in CHANNELS for joint in joints)}
    return Recording(
        **{**facts, "held": tuple(tuple(span) for span in facts["held"])},
        motion=motion,
        ended=Ended(header["ended"]),
        t=frame["t"].to_numpy(),
        at=frame["at"].to_numpy(),
        q=table("q"),
        qd=table("qd") if f"qd_{joints[0]}" in frame.columns else None,
        command=table("command"),
        asked=table("asked"),
        extra={name: frame[name].to_numpy().astype(float) for name in frame.columns if name not in rows},
    )
