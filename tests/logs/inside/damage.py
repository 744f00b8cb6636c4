"""Damaged logs of every format: python damage.py FIRST COUNT FORMAT ... reads so many of each format.

It is a program of its own, so that its memory is that of these reads alone and a crash is seen as one.
"""

# ruff: noqa: E402
from __future__ import annotations

import json
import random
import re
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from scipy.io import savemat

sys.path[:0] = [str(Path(__file__).parents[1])]

from log_examples import CHANNELS, FLIGHT_RATE, JOINTS, LIMITS, RATE, Sines, make_log, vector

from etude.errors import EtudeError
from etude.logs import read_log
from etude.types import Channel

TOKENS = (b",", b"\n", b'"', b"nan", b"1e308", b"[", b"\0", b"\xff", b"#", b"9" * 400, b"\t", b"t", b"")
LOG = make_log(Sines((0.4, 0.6, 0.7), (0.4, 0.35, 0.45), 3.0), rate=40.0)
FLYING = (
    Channel("command", tuple(f"m{i}" for i in range(1, 5)), ("1",) * 4, "command", required=True),
    vector("specific_force", "m/s^2", required=True),
    vector("rates", "rad/s", required=True),
    vector("position", "m", "aside"),
    Channel("orientation", ("w", "x", "y", "z"), ("1",) * 4, "aside"),
)


def damaged(data: bytes, rng: random.Random) -> bytes:
    """One to sixteen changes: bytes, bits, pieces cut, doubled, exchanged, put in; often near an end."""
    out = bytearray(data)
    for _ in range(rng.choice([1, 1, 2, 4, 16])):
        near = rng.choice([rng.randrange(300), len(out) - 1 - rng.randrange(300)])
        place = min(max(rng.choice([near, rng.randrange(len(out))]), 0), len(out) - 1)
        length = rng.choice([1, 4, 50, 1000])
        other = rng.randrange(len(out))
        match rng.randrange(7):
            case 0:
                out[place] = rng.randrange(256)
            case 1:
                out[place] ^= 1 << rng.randrange(8)
            case 2:
                del out[place : place + length]
            case 3:
                out[place:place] = rng.choice(TOKENS)
            case 4:
                out[place:place] = out[place : place + length]
            case 5:
                out[place : place + length], out[other : other + length] = (
                    out[other : other + length],
                    out[place : place + length],
                )
            case _:
                del out[place:]
        out = out or bytearray(b" ")
    return bytes(out)


def _plain() -> dict[str, Any]:
    return {
        "t": LOG.t,
        **{
            f"{w}_{j}": LOG[c][:, k]
            for w, c in (("q", "q"), ("tau", "command"))
            for k, j in enumerate(JOINTS)
        },
    }


def _csv(folder: Path) -> Path:
    pl.DataFrame(_plain()).write_csv(folder / "run.csv")
    return folder / "run.csv"


def _utf16(folder: Path) -> Path:
    text = pl.DataFrame(_plain()).write_csv(separator=";").replace(".", ",")
    (folder / "run.txt").write_text(text, encoding="utf-16")
    return folder / "run.txt"


def _echo(folder: Path) -> Path:
    rows = []
    for i, t in enumerate(LOG.t):
        values = [*LOG["q"][i], *(0.0 * LOG["q"][i]), *LOG["command"][i]]
        rows.append(",".join(map(str, [int(t), round(1e9 * (t % 1.0)), "base", *JOINTS, *values])))
    (folder / "run.csv").write_text("\n".join(rows) + "\n")
    return folder / "run.csv"


def _parquet(folder: Path) -> Path:
    pl.DataFrame(_plain()).write_parquet(folder / "run.parquet")
    return folder / "run.parquet"


def _lists(folder: Path) -> Path:
    own = {
        "name": [list(JOINTS)] * len(LOG),
        "position": LOG["q"].tolist(),
        "effort": LOG["command"].tolist(),
    }
    pl.DataFrame({"t": LOG.t, **own}).write_parquet(folder / "run.parquet")
    return folder / "run.parquet"


def _unnamed(folder: Path) -> Path:
    """Lists in text without names, and dates with a comma."""
    own = {
        word: [str(row) for row in LOG[c].tolist()] for word, c in (("position", "q"), ("effort", "command"))
    }
    times = [f"2024-05-06 12:30:{t:09.6f}".replace(".", ",") for t in LOG.t]
    pl.DataFrame({"t": times, **own}).write_csv(folder / "run.csv")
    return folder / "run.csv"


def _controller(folder: Path) -> Path:
    topic = "/arm_controller/controller_state"
    own = {"__time": 1.7e9 + LOG.t}
    for i in range(len(JOINTS)):
        own[f"{topic}/feedback/positions[{i}]"] = own[f"{topic}/actual/positions[{i}]"] = LOG["q"][:, i]
        own[f"{topic}/output/effort[{i}]"] = LOG["command"][:, i]
    pl.DataFrame(own).write_csv(folder / "run.csv")
    return folder / "run.csv"


def _mat4(folder: Path) -> Path:
    savemat(folder / "run.mat", {"t": LOG.t, "q": LOG["q"], "tau": LOG["command"]}, format="4")
    return folder / "run.mat"


def _mat(compressed: bool) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        own = {"t": LOG.t, "q": LOG["q"], "state": {"tau": LOG["command"]}}
        savemat(folder / "run.mat", own, do_compression=compressed)
        return folder / "run.mat"

    return write


def _mat73(folder: Path) -> Path:
    from mat_examples import write73

    return write73(folder / "run.mat", {"t": LOG.t, "q": LOG["q"], "state": {"tau": LOG["command"]}})


def _lerobot(folder: Path) -> Path:
    import test_mat_and_lerobot

    test_mat_and_lerobot.LOG = LOG
    return test_mat_and_lerobot.dataset(folder / "set", list(JOINTS))


def _bag(**how: Any) -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        import bag_examples as bags

        bags.LOG = LOG
        messages = sorted([*bags.joint_states(), *bags.controller_states()[::8]], key=lambda m: m[2])
        return bags.write_bag(folder / "bag", messages, **how)

    return write


def _storage(write: Callable[[Path], Path]) -> Callable[[Path], Path]:
    """The file in a bag's folder alone."""

    def moved(folder: Path) -> Path:
        own = next(one for one in write(folder).iterdir() if one.name != "metadata.yaml")
        return own.rename(folder / own.name)

    return moved


def _ulog(folder: Path) -> Path:
    import ulog_examples as ulogs

    own = {name: {f: values[:200] for f, values in data.items()} for name, data in ulogs.topics().items()}
    return ulogs.write_ulog(folder / "flight.ulg", own)


def _usd(folder: Path) -> Path:
    import test_usd_card

    return test_usd_card.written(folder / "log07")


FORMATS: dict[str, tuple[str, Callable[[Path], Path]]] = {
    "csv": ("csv", _csv),
    "utf-16": ("csv", _utf16),
    "echo": ("csv", _echo),
    "parquet": ("parquet", _parquet),
    "lists": ("parquet", _lists),
    "unnamed": ("csv", _unnamed),
    "controller": ("csv", _controller),
    "mat4": ("mat", _mat4),
    "mat": ("mat", _mat(False)),
    "mat-zlib": ("mat", _mat(True)),
    **({"mat-7.3": ("mat", _mat73)} if find_spec("h5py") else {}),
    "lerobot": ("lerobot", _lerobot),
    "bag": ("rosbag2", _bag()),
    "bag-zstd": ("rosbag2", _bag(compression="FILE")),
    "db3": ("rosbag2", _storage(_bag(compression="MESSAGE"))),
    "mcap": ("rosbag2", _storage(_bag(plugin="MCAP"))),
    "mcap-zstd": ("rosbag2", _storage(_bag(plugin="MCAP", compression="STORAGE"))),
    "ulog": ("ulog", _ulog),
    "crazyflie": ("crazyflie", _usd),
}
"""Name -> its reader, and what writes a whole one into a folder."""


def read(path: Path, number: int) -> bool:
    """Whether a log was read; False if it was refused. AssertionError: neither as it should be."""
    flying = path.suffix in ("", ".ulg") and path.is_file()
    topics = ("/joint_states",) if number % 4 == 3 else ()
    try:
        if flying:
            log = read_log(path, FLYING, rate=FLIGHT_RATE)
        else:
            log = read_log(path, CHANNELS, rate=RATE, limits=LIMITS, topics=topics)
    except EtudeError as refused:
        if _own_mistake(refused.__cause__):
            raise
        return False
    for name, values in log.values.items():
        assert np.isfinite(values).all(), f"{number}: {name}"
    assert (np.diff(log.t) > 0).all(), f"{number}: time"
    return True


def _own_mistake(problem: BaseException | None) -> bool:
    """Whether what was told as a refusal is a mistake in Étude's own lines, not in a library's.

    ValueErrors are raised there on purpose.
    """
    if isinstance(problem, ValueError):
        return False
    trace = problem.__traceback__ if problem is not None else None
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return trace is not None and f"{Path('etude', 'logs')}" in trace.tb_frame.f_code.co_filename


def run(name: str, first: int, count: int) -> dict[str, Any]:
    """Reads damaged logs number `first` to `first + count - 1` of a format."""
    slowest = (0.0, -1)
    whole = 0
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        path = FORMATS[name][1](folder)
        assert read(path, 0), "the whole log is refused"
        files = sorted(one for one in folder.rglob("*") if one.is_file())
        kept = {one: one.read_bytes() for one in files}
        for number in range(first, first + count):
            rng = random.Random(number)
            hurt = rng.choice(files)
            hurt.write_bytes(damaged(kept[hurt], rng))
            began = time.perf_counter()
            whole += read(path, number)
            slowest = max(slowest, (time.perf_counter() - began, number))
            hurt.write_bytes(kept[hurt])
    return {"format": name, "count": count, "read": whole, "slowest_s": slowest, "peak_mb": peak_mb()}


def peak_mb() -> float:
    """Of this program alone: what `getrusage` says may be of the process that started it."""
    status = Path("/proc/self/status")
    if status.exists():
        return int(re.search(r"VmHWM:\s+(\d+)", status.read_text())[1]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


if __name__ == "__main__":
    for format_ in sys.argv[3:]:
        print(json.dumps(run(format_, int(sys.argv[1]), int(sys.argv[2]))), flush=True)
