"""watch: comparison of incoming logs of any motion with the model in use, without ingest or learning."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from etude.campaign.ingest.ingest_result import read
from etude.campaign.ingest.questions import Answers, answers_of, body_of, questions_of
from etude.campaign.ingest.robot_changed import CAUSES, KINDS
from etude.campaign.propose.ask import Proposal, ask
from etude.campaign.record.deployed_model import DeployedModel, deployed_model
from etude.campaign.record.folder import Campaign, Say
from etude.errors import DataError, UnsafeTrajectoryError, UsageError
from etude.logs.columns.units import start_at_zero
from etude.models.change.diagnosis import Cause
from etude.models.change.evidence import ChangeTest, DriftOnset, change_test, drift_onset
from etude.types import Samples

Verdict = Literal["unchanged", "changed", "refused"]
DRIFT_ONSETS: dict[DriftOnset, str] = {
    "at once": "The change is abrupt.",
    "little by little": "The change is a drift: the errors grow from log to log.",
    "cannot tell": "",
}


@dataclass(frozen=True, eq=False)
class WatchedLog:
    """Result for one log.

    Attributes:
        path: of the file.
        verdict: "refused": the log cannot be used, or lacks inputs of the model; `sentence` says why.
        seconds: s of motion until the change was certain; None without a change.
        kind: "payload", "friction", "sensor" or "unknown", "" without a change; cause: in more detail.
        evidence: nats, the maximum over the log. z2: mean squared error over the predicted variance.
        command: the command with nearly all of the errors; "" if there is none.
        sentence: summary for users.
    """

    path: Path
    verdict: Verdict
    sentence: str
    seconds: float | None = None
    kind: str = ""
    cause: Cause = "unknown"
    evidence: float = 0.0
    z2: float = 0.0
    command: str = ""
    test: ChangeTest | None = None


@dataclass(frozen=True, eq=False)
class Watched:
    """Result for several logs, oldest first.

    Attributes:
        used: the model that they were compared with.
        logs: result for each log.
        kind: of the change, as for a log; "" without one. manner: how the change developed.
        sentence: summary of all logs.
        proposal: a training motion for the changed robot; None without a change.
        no_proposal: why there is none although the robot has changed.
    """

    used: DeployedModel
    logs: tuple[WatchedLog, ...]
    kind: str
    drift_onset: DriftOnset
    sentence: str
    proposal: Proposal | None = None
    no_proposal: str = ""

    @property
    def changed(self) -> bool:
        return bool(self.kind)


def watch(
    campaign: Campaign,
    logs: Sequence[str | Path],
    *,
    degrees: bool = False,
    accept: Sequence[str] = (),
    repair: Sequence[str] = (),
    propose: bool = True,
    say: Say = lambda _: None,
) -> Watched:
    """Compare logs of any motion with the model in use, and report what has changed.

    Each log is judged by the same test as in `tell` (docs/changed_robot.md), and is not stored. If the robot
    has changed, a motion is proposed as by `ask`.

    Args:
        campaign: the folder.
        logs: files, oldest first.
        degrees: their angles are degrees.
        accept: checks whose findings are accepted: the log is used unchanged.
        repair: checks whose findings are repaired.
        propose: propose a motion if the robot has changed.
        say: receives one sentence per step.

    Raises:
        UsageError: no log, nothing was learned yet, or the model's file was changed.
    """
    paths = [Path(one) for one in logs]
    if not paths:
        raise UsageError("there is no log to watch", next_step="Name one or more files.")
    answers = answers_of(campaign.state(), accept, repair)
    used = deployed_model(campaign)
    say(used.sentence)
    results = tuple(_watch_log(campaign, used, path, degrees, answers) for path in paths)
    changed = [one for one in results if one.verdict == "changed"]
    if not changed:
        return Watched(used, results, "", "cannot tell", _no_change_sentence(results))
    kind, how = _kind(changed), drift_onset([one.test.sizes for one in results if one.test is not None])
    worst = next(one for one in changed if one.kind == kind) if kind != "unknown" else changed[0]
    cause = worst.cause if kind != "unknown" else "unknown"
    sentence = f"The robot has changed: {CAUSES[cause]}. {DRIFT_ONSETS[how]}".rstrip()
    watched = Watched(used, results, kind, how, sentence)
    return _with_proposal(campaign, watched, say) if propose else watched


def _watch_log(
    campaign: Campaign, used: DeployedModel, path: Path, degrees: bool, answers: Answers
) -> WatchedLog:
    try:
        questions = questions_of(campaign, campaign.state(), answers)
        log = start_at_zero(read(campaign, path, degrees=degrees, questions=questions))
        group = np.zeros(len(log), dtype=np.int64)
        samples = campaign.kind.samples(campaign.spec, campaign.config, [log], [group])
        return of_samples(
            path, change_test(used.model, samples, body_of(campaign.kind, campaign.spec)), samples
        )
    except KeyError as error:
        return WatchedLog(path, "refused", f"the log lacks an input of the model ({error.args[0]})")
    except DataError as error:
        return WatchedLog(path, "refused", error.fact)


def of_samples(path: Path, test: ChangeTest, samples: Samples) -> WatchedLog:
    """The result of the test of a log's samples, in words."""
    most, z2 = float(test.evidence.max(initial=0.0)), test.z2
    if test.alarm is None:
        sentence = f"no change of the robot (squared errors {test.z2:.3g} times their variance)"
        return WatchedLog(path, "unchanged", sentence, evidence=most, z2=z2, test=test)
    seconds = float(samples.t[test.alarm] - samples.t[0])
    command = "" if test.output is None else samples.log.channels["command"].parts[test.output]
    where = f", nearly all in {command}" if command else ""
    kind = KINDS.get(test.cause, "unknown")
    named = "changed, cause unknown" if kind == "unknown" else kind
    squares = f"squared errors {z2:.3g} times their variance{where}"
    sentence = f"{named}, certain after {seconds:.0f} s ({squares})"
    return WatchedLog(path, "changed", sentence, seconds, kind, test.cause, most, z2, command, test)


def _kind(changed: Sequence[WatchedLog]) -> str:
    """The kind of change on which all logs with a known kind agree; "unknown" otherwise."""
    named = {one.kind for one in changed} - {"unknown"}
    return named.pop() if len(named) == 1 else "unknown"


def _no_change_sentence(logs: Sequence[WatchedLog]) -> str:
    unchanged = [one for one in logs if one.verdict == "unchanged"]
    if not unchanged:
        return "No log could be compared with the model."
    return f"No change of the robot in {len(unchanged)} log{'s'[: len(unchanged) > 1]}."


def _with_proposal(campaign: Campaign, watched: Watched, say: Say) -> Watched:
    """The result with a motion of the campaign's usual length, if possible; an open one is shown again.

    A third of that length left twice the error in simulation; see docs/results/monitoring.md.
    """
    try:
        return replace(watched, proposal=ask(campaign, go_on=True, say=say))
    except (UsageError, UnsafeTrajectoryError) as error:
        return replace(watched, no_proposal=error.fact)
