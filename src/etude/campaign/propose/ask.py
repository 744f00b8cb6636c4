"""Next trajectory of a campaign: `ask`, a pure function of the committed facts and the campaign's seed."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from etude.campaign.evaluate.stopping import seen_by_the_rule, stop_verdict
from etude.campaign.propose.constraints import Constraints, constraints_now, constraints_then
from etude.campaign.propose.proposal import Swept, as_facts, proposed, swept, teaches_little
from etude.campaign.record.controls import require_learned, require_same, required
from etude.campaign.record.events import Asked, Exported
from etude.campaign.record.folder import Campaign, Say
from etude.campaign.record.journal import recorded, require_intact
from etude.campaign.record.state import State
from etude.campaign.record.stored_files import (
    FULL,
    changed_since,
    name_of,
    proposal_advice,
    require_description,
    settle,
    speed_folder,
    stored_bytes,
    stored_trajectory,
    take_up,
)
from etude.campaign.record.stored_models import is_learned, newest_model
from etude.deploy.trajectory_files import COEFFICIENTS, TrajectoryFiles, at_speed, render
from etude.errors import StopRuleReached, UnsafeTrajectoryError, UsageError, typed
from etude.limits.commands import require_possible
from etude.protocols import Limit, Trajectory
from etude.storage import write_atomic

if TYPE_CHECKING:
    from etude.campaign.propose.approach import Approached
    from etude.campaign.propose.export import ExportedMotion
    from etude.campaign.training import Learner
    from etude.limits.certificate import Certificate

Beside = Callable[[TrajectoryFiles], Mapping[Path, bytes]]
ASK_STREAM = 1
"""Separates the random numbers of `ask` from those of training and testing."""


@dataclass(frozen=True)
class Proposal:
    """A trajectory that awaits its log.

    Attributes:
        number: of the trajectory.
        folder: with trajectory.json, trajectory.csv and certificate.json.
        certificate: of the bytes in that folder.
        duration: s.
        new: False for a proposal that was already open.
        status: a sentence on how it was found.
        exported: the same motion in the requested formats.
        approach: from the robot's pose to the start, and the return, if requested.
        renewed: sentences on the files that were written anew, with the reason.
        swept: range that each axis covers; empty for kinds that do not know their reachable poses.
    """

    number: int
    folder: Path
    certificate: Certificate
    duration: float
    new: bool
    status: str
    exported: tuple[ExportedMotion, ...] = ()
    approach: Approached | None = None
    renewed: tuple[str, ...] = ()
    swept: tuple[Swept, ...] = ()


def ask(
    campaign: Campaign,
    *,
    new: bool = False,
    go_on: bool = False,
    speed: int = FULL,
    tasks: Path | None = None,
    formats: Sequence[str] = (),
    effort: bool = False,
    start: str = "",
    control: str = "",
    learner: Learner | None = None,
    say: Say = lambda _: None,
) -> Proposal:
    """The open proposal, or else the next trajectory, written and certified.

    Args:
        campaign: the folder.
        new: propose another trajectory although one is open.
        go_on: ignore the stop rule.
        speed: per cent; below 100, a slower copy of the same path is also written, in its own folder.
        tasks: a file of the motions that the model is intended for.
        formats: also write these formats, names among `etude.exporters`.
        effort: include the learned command where the format supports it.
        start: the robot's pose: "home", joint=value for each joint, or a CSV whose last row is the pose.
            Approach and return are then written too; other formats hold approach, motion and return.
        control: control of the run, see `record.controls`; its tracking margins apply. "": learned
            feedforward with `effort`, else feedback alone.
        learner: trains the model; only tests pass their own.
        say: receives one sentence per step.

    Raises:
        StopRuleReached: another trajectory is not worth its robot time.
        UsageError: a file of the open proposal is missing or was changed, the proposal is for another
            control, or a format is unknown or not for this robot.
        UnsafeTrajectoryError: no trajectory is inside the limits; nothing is written.
    """
    motions = _tasks(campaign, tasks)
    _require(campaign, formats, effort)
    under = required(control, effort)
    with campaign.writing():
        require_description(campaign)
        _learn(campaign, learner, say)
        state = campaign.state()
        if state.proposals and not new:
            number, made = state.proposals[-1].number, None
            constraints = constraints_then(campaign.round(number).asked)
            require_same(control, campaign.round(number).asked, number)
        else:
            require_learned(under, state)
            number, constraints = state.next_number, constraints_now(campaign, state, under)
            check = _approach_check(campaign, start, speed)
            made = _propose(campaign, state, number, constraints, motions, tasks, go_on, say, check)
        proposal = presented(campaign, number, constraints, made, speed, start, formats, effort=effort)
        take_up(campaign)
        return proposal


def presented(
    campaign: Campaign,
    number: int,
    constraints: Constraints,
    made: tuple[TrajectoryFiles, str] | None,
    speed: int,
    start: str,
    formats: Sequence[str],
    *,
    effort: bool = False,
) -> Proposal:
    """A trajectory with its files, its approach from the robot's pose, and its exports; see `present`."""
    proposal = present(campaign, number, constraints, made, speed)
    motion = stored_trajectory(campaign, number, speed)
    approach = _approach(campaign, number, motion, proposal, start, constraints, speed) if start else None
    whole = (
        (motion, proposal.folder)
        if approach is None or approach.whole is None
        else (approach.whole, approach.folder)
    )
    return replace(
        proposal, exported=_export_formats(campaign, number, whole, formats, effort), approach=approach
    )


# what a plain `ask` does not need is not loaded: it is the command that is run most


def _tasks(campaign: Campaign, tasks: Path | None) -> Sequence[Trajectory]:
    if tasks is None:
        return ()
    from etude.campaign.propose.typical_motions import load_tasks

    return load_tasks(tasks, campaign.channel(campaign.kind.path))


def _require(campaign: Campaign, formats: Sequence[str], effort: bool) -> None:
    if formats:
        from etude.campaign.propose.export import require_formats

        require_formats(campaign, formats, effort=effort)


def _learn(campaign: Campaign, learner: Learner | None, say: Say) -> None:
    if not is_learned(campaign.state()):
        from etude.campaign.training import learn_pending

        learn_pending(campaign, learner, say)


def _approach(
    campaign: Campaign,
    number: int,
    motion: Trajectory,
    proposal: Proposal,
    start: str,
    constraints: Constraints,
    speed: int,
) -> Approached:
    from etude.campaign.propose.approach import approached

    return approached(campaign, number, motion, proposal.folder, start, constraints, speed)


def _approach_check(campaign: Campaign, start: str, speed: int) -> Callable[[Trajectory, Constraints], None]:
    """A check that refuses a motion without an approach before it is proposed. It reads the pose now."""
    if not start:
        return lambda _, __: None
    from etude.campaign.propose.approach import pose_inside, prepared

    pose_inside(campaign, start)

    def check(motion: Trajectory, constraints: Constraints) -> None:
        try:
            run = motion if speed == FULL else at_speed(motion, speed)
            prepared(campaign, run, start, constraints, speed)
        except UnsafeTrajectoryError as problem:
            raise UnsafeTrajectoryError(
                f"no certified approach from there to the proposed motion: {problem.fact}",
                where=problem.where,
                next_step="No trajectory was written. Name another pose, or leave out --from and move "
                "the robot to the start with its own controller.",
            ) from None

    return check


def _export_formats(
    campaign: Campaign, number: int, whole: tuple[Trajectory, Path], formats: Sequence[str], effort: bool
) -> tuple[ExportedMotion, ...]:
    if not formats:
        return ()
    from etude.campaign.propose.export import export

    return tuple(export(campaign, number, *whole, name, effort=effort) for name in formats)


def _open(campaign: Campaign, state: State) -> list[Trajectory]:
    """Proposals that await their logs; one with a damaged file is left out."""
    motions = []
    for waiting in state.proposals:
        with contextlib.suppress(UsageError):
            motions.append(stored_trajectory(campaign, waiting.number))
    return motions


def _propose(
    campaign: Campaign,
    state: State,
    number: int,
    constraints: Constraints,
    motions: Sequence[Trajectory],
    tasks: Path | None,
    go_on: bool,
    say: Say,
    check: Callable[[Trajectory, Constraints], None] = lambda _, __: None,
) -> tuple[TrajectoryFiles, str]:
    """Files of the next trajectory that `check` accepts, committed, and a sentence on how it was found."""
    if not go_on:
        _check_stop(campaign, state, None)
    seed = [state.seed, number, ASK_STREAM]
    rng = np.random.default_rng(seed)
    constraints = constraints.using(newest_model(campaign, state)) if state.trained else constraints
    limits = constraints.limits(campaign)
    require_possible(limits)
    trajectory, fact = proposed(
        campaign, constraints.model(campaign), rng, motions, _open(campaign, state), limits, say
    )
    if not go_on:
        _check_stop(campaign, state, fact.gain)
    constraints = constraints.of(trajectory)
    files = _files(campaign, trajectory, limits, constraints)
    check(files.trajectory, constraints)
    written = files.write(campaign.proposal(number))
    if tasks is not None:
        copy = campaign.proposal(number) / f"tasks{tasks.suffix}"
        write_atomic(copy, tasks.read_bytes())
        written.append(copy)
    at_limit = tuple(files.certificate.active())
    asked = replace(fact, active_limits=at_limit, seed=tuple(seed), learned=len(state.trained))
    campaign.commit(constraints.recorded(asked), number, written)
    return files, asked.status


def _files(
    campaign: Campaign, trajectory: Trajectory, limits: Sequence[Limit], constraints: Constraints
) -> TrajectoryFiles:
    kind, spec, config = campaign.kind, campaign.spec, campaign.config
    rows = swept(campaign, trajectory, limits)
    return render(
        trajectory,
        kind,
        spec,
        config,
        limits,
        constraints.unenforced,
        control=constraints.control,
        swept=as_facts(rows),
        warned=teaches_little(rows),
    )


def _proved_files(campaign: Campaign, trajectory: Trajectory, constraints: Constraints) -> TrajectoryFiles:
    """Files of an open proposal, proved under the description alone if campaign.toml now allows less."""
    try:
        return _files(campaign, trajectory, constraints.limits(campaign), constraints)
    except UnsafeTrajectoryError:
        return _files(campaign, trajectory, constraints.limits(campaign, described=True), constraints)


def _outside_now(campaign: Campaign, number: int, problem: UnsafeTrajectoryError) -> UnsafeTrajectoryError:
    """The reason why an open proposal can no longer run, and how to get another one."""
    events = [e for e in campaign.events() if isinstance(e.fact, Asked) and e.number == number]
    why = " and ".join(changed_since(campaign, events, [name for e in events for name in e.files]))
    proposal = campaign.round(number)
    confirm = "--confirm " * proposal.confirms + "--payload " * proposal.weighs
    since = f" since {why} changed" if why else ""
    return UnsafeTrajectoryError(
        f"the open trajectory {number} is not certified{since}: {problem.fact}",
        where=problem.where,
        next_step=f"Do not run it. Write another motion: etude ask {typed(campaign.path)} {confirm}--new."
        + (f" Or restore {why}." if why else ""),
    )


def _check_stop(campaign: Campaign, state: State, gain: float | None) -> None:
    if not state.trained:
        return
    verdict = stop_verdict(seen_by_the_rule(campaign, state, gain), campaign.config.stop)
    use = f"Use the model (etude promote {typed(campaign.path)})"
    first = use if verdict.usable else "Do not use the model yet: etude status shows why"
    if verdict.stop:
        raise StopRuleReached(
            f"the stop rule fired ({verdict.rule}): {verdict.reason.rstrip('.')}",
            where=str(campaign.path),
            next_step=f"{first}, change [stop] in campaign.toml, or ask with --continue.",
        )


def present(
    campaign: Campaign,
    number: int,
    constraints: Constraints,
    made: tuple[TrajectoryFiles, str] | None,
    speed: int,
    beside: Beside = lambda _: {},
) -> Proposal:
    """A proposed trajectory as stored in its folder, compared with the journal; slower if requested.

    Its stored bytes are proved under the present robot.toml and campaign.toml. Tables and certificates that
    differ from these are written anew.

    Args:
        campaign: the folder. number: of the proposal. constraints: those of the proposal.
        made: its files and status, if it is new. speed: per cent.
        beside: gives the contents of further files in the folder.
    """
    folder = speed_folder(campaign, number, speed)
    advice = proposal_advice(campaign, number)
    renewed: tuple[str, ...] = ()
    if made is not None and speed == FULL:
        files = made[0]
    else:
        _check(campaign, [name_of(campaign, campaign.proposal(number) / COEFFICIENTS)], advice)
        full = stored_trajectory(campaign, number)
        motion = at_speed(full, speed) if speed != FULL else full
        if made is None:
            try:
                files = _proved_files(campaign, motion, constraints)
            except UnsafeTrajectoryError as problem:
                raise _outside_now(campaign, number, problem) from None
        else:
            files = _files(campaign, motion, constraints.limits(campaign), constraints.of(full))
        if speed == FULL:  # what waits for its log stays what it is, to the byte
            stored = stored_bytes(campaign, folder / COEFFICIENTS, advice)
            files = replace(files, coefficients=stored)
        contents = {**files.contents(folder), **(beside(files) if speed == FULL else {})}
        event = next(e for e in campaign.events() if isinstance(e.fact, Asked) and e.number == number)
        settled = {name_of(campaign, path) for path in contents}
        _check(campaign, [name for name in event.files if name not in settled], advice)
        renewed = settle(campaign, number, contents, Exported(speed=speed), advice)
    status = "written before, still open" if made is None else made[1]
    rows = swept(campaign, files.trajectory, constraints.limits(campaign))
    return Proposal(
        number,
        folder,
        files.certificate,
        files.trajectory.duration,
        made is not None,
        status,
        renewed=renewed,
        swept=rows,
    )


def _check(campaign: Campaign, names: Sequence[str], advice: str) -> None:
    """Raises UsageError if a proposal's file is missing or was changed."""
    last = recorded(campaign.events())
    hashes = {name: last[name] for name in names if name in last}
    require_intact(campaign.path, hashes, advice)
