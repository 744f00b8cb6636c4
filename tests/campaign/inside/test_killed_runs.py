"""`etude run` as a process: Ctrl-C comes to rest, and a kill at any instant surprises nobody."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from robot_runs import lab

from etude.campaign import Campaign, open_campaign
from etude.campaign.record.events import Ingested, MotionEnded, MotionSent, RunEnded

DRIVER = """\
from etude.testing import FakeRobot
def virtual(joints, address, settings):
    return FakeRobot(joints, rate=50.0, stiffness=400.0)
def real_time(joints, address, settings):
    return FakeRobot(joints, rate=50.0, stiffness=400.0, virtual=False)
"""


@pytest.fixture
def campaign(tmp_path: Path) -> Campaign:
    made = lab(tmp_path)
    (tmp_path / "bot.py").write_text(DRIVER)
    (made.path / "run.toml").write_text("[run]\nconfirm = false\npromote = false\n")
    return made


def started(campaign: Campaign, robot: str, *words: str) -> subprocess.Popen[str]:
    own = ["run", str(campaign.path), "--on", f"{campaign.path.parent / 'bot.py'}:{robot}", "--yes", "--json"]
    return subprocess.Popen(
        [sys.executable, "-m", "etude", *own, "--rounds", "1", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )


@pytest.mark.slow
@pytest.mark.parametrize("part", ["approach", "motion"])
def test_ctrl_c_comes_to_rest_and_the_same_command_goes_on(campaign: Campaign, part: str) -> None:
    process = started(campaign, "real_time")
    assert process.stdout is not None
    for line in process.stdout:
        event = json.loads(line)
        if event.get("event") == "motion_sent" and event["part"] == part:
            break
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=60)
    assert process.returncode == 130
    assert json.loads(out.splitlines()[-1])["error"]["exit_code"] == 130
    facts = [e.fact for e in campaign.events()]
    ended = [fact for fact in facts if isinstance(fact, MotionEnded)]
    assert (ended[-1].part, ended[-1].ended) == (part, "interrupted")
    assert ended[-1].reached < 5.0
    assert isinstance(facts[-1], RunEnded)
    assert facts[-1].exit_code == 130
    again = started(campaign, "virtual")
    again.communicate(timeout=120)
    assert again.returncode == 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_a_kill_at_any_instant_surprises_nobody(campaign: Campaign, seed: int) -> None:
    process = started(campaign, "virtual")
    time.sleep(random.Random(seed).uniform(0.5, 6.0))
    process.kill()
    process.communicate()
    left = campaign.state().sent
    before = len(campaign.events())
    plain = started(campaign, "virtual")
    out, _ = plain.communicate(timeout=120)
    if left is not None:
        assert plain.returncode == 2
        assert "the robot may have moved" in json.loads(out.splitlines()[-1])["error"]["fact"]
        assert len(campaign.events()) == before, "nothing was sent, nothing asked"
        resumed = started(campaign, "virtual", "--resume")
        out, _ = resumed.communicate(timeout=120)
        assert resumed.returncode == 0, out
    else:
        assert plain.returncode == 0, out
    facts = [e.fact for e in open_campaign(campaign.path).events()]
    sent = [fact for fact in facts if isinstance(fact, MotionSent)]
    ended = [fact for fact in facts if isinstance(fact, MotionEnded)]
    assert len(sent) - len(ended) == (left is not None)
    whole = [fact for fact in facts if isinstance(fact, Ingested)]
    assert whole
    assert not any(fact.foreign for fact in whole)
    assert len({fact.sha256 for fact in whole}) == len(whole)
