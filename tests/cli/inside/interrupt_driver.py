"""Presses Ctrl-C in the middle of compiled code, again and again. Run by test_interrupts.py.

A process of its own, so that forking is cheap and safe: no threads, everything imported and compiled once.
The signal is sent while a simulated robot runs, in compiled code, a random time after it began.
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from etude import cli
from etude.campaign import (
    Asked,
    Campaign,
    create_campaign,
    open_campaign,
    read_events,
    replay,
    typical_motions,
)
from etude.trajectories import random_moves

CONFIG = """\
kind = "arm"
seed = 4
[trajectory]
duration = 8.0
[model]
rung = "gp"
points = 50
fit_points = 30
steps = 2
candidates = ["default"]
[design]
candidates = 2
refine = 1
steps = 1
points = 10
reference_points = 10
"""
ROUNDS = 2
DELAYS = (0.005, 0.05, 0.3)
"""s: how long after a run began Ctrl-C comes, at most. A loop takes 10 to 100 ms, so that the
last one often falls into learning or designing."""
INTERRUPTED = 130
"""What a shell expects of a command that Ctrl-C ended."""
KEPT = "All stored data is kept"


def brief(campaign: Campaign) -> None:
    """Tests of its kind of robot are one move, so that a round takes seconds."""

    def tests(_: Any, spec: Any, __: Any, rng: np.random.Generator) -> Any:
        return {"moves": random_moves(rng, spec.lower, spec.upper, spec.velocity, spec.acceleration, 1)}

    type(campaign.kind).tests = tests


def cue_at(campaign: Campaign, call: int, cue: int) -> None:
    """Writes a byte to `cue` when a simulated robot runs for the `call`-th time from now: its closed loop is
    compiled code.
    """
    robot: Any = type(campaign.kind.robot(campaign.spec, campaign.config))
    seen, real = 0, robot.run

    def entered(*arguments: Any) -> Any:
        nonlocal seen
        seen += 1
        if seen == call:
            os.write(cue, b".")
        return real(*arguments)

    robot.run = entered


def session(folder: Path, said: Path, call: int = 0, delay: float = 0.0) -> int:
    """`etude simulate` in a child, with Ctrl-C `delay` seconds after a run began; its code."""
    read_end, write_end = os.pipe()
    child = os.fork()
    if child == 0:
        output = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        os.dup2(output, 1)
        os.dup2(output, 2)
        cue_at(open_campaign(folder), call, write_end)
        sys.argv = ["etude", *finishing(folder)]
        os._exit(cli.main())
    os.close(write_end)
    if os.read(read_end, 1):
        time.sleep(delay)
        os.kill(child, signal.SIGINT)
    os.close(read_end)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def compile_once(campaign: Campaign) -> None:
    """Loads what every child needs; nothing that starts threads, which a fork would lose."""
    from etude.campaign import simulate  # noqa: F401
    from etude.design import design  # noqa: F401

    brief(campaign)
    robot = campaign.kind.robot(campaign.spec, campaign.config)
    rng = np.random.default_rng(0)
    robot.run(typical_motions(campaign, rng, 1)[0], None, rng)


def finishing(folder: Path) -> list[str]:
    """The command that does what is left of the rounds."""
    missing = ROUNDS - len(replay(read_events(folder)).ingested)
    return ["simulate", str(folder), "--rounds", str(missing)]


def facts(folder: Path) -> list[Any]:
    """What was committed, but for times of the clock and the name of the folder."""
    return [
        (
            event.event,
            event.number,
            {name: digest for name, digest in event.files.items() if not name.endswith(".source.toml")},
            replace(event.fact, seconds=0.0) if isinstance(event.fact, Asked) else event.fact,
        )
        for event in read_events(folder)
    ]


def main(folder: Path, presses: int, seed: int) -> None:
    random.seed(seed)
    lab, whole, said = folder / "lab", folder / "whole", folder / "said"
    compile_once(create_campaign(lab, "arm4", seed=4)[0])
    (lab / "campaign.toml").write_text(CONFIG)
    shutil.copytree(lab, whole)
    codes = []
    for press in range(presses):
        delay = random.uniform(0.0, DELAYS[press % len(DELAYS)])
        codes.append(session(lab, said, random.randint(1, 2), delay))
    words = said.read_text()
    assert set(codes) <= {0, INTERRUPTED}, f"{codes}: {words}"
    assert "Traceback" not in words, words
    assert "ignored" not in words, words
    assert words.count(KEPT) == codes.count(INTERRUPTED), words
    assert session(lab, said) == session(whole, said) == 0
    assert facts(lab) == facts(whole)
    sys.stdout.write(f"interrupted {codes.count(INTERRUPTED)} of {presses}\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]))
