"""Confirmation on the robot: a motion left out of training, without and with feedforward, and its
expected error.

Its logs are not ingested for training.

While a joint is at rest, static friction balances any residual of its command. The required command is then a
range, and the model correctly predicts a large uncertainty within it. None of this becomes a tracking error,
so joints at rest are left out.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from etude.campaign.propose.ask import Proposal, present
from etude.campaign.propose.constraints import Constraints, constraints_now, constraints_then
from etude.campaign.propose.export import export, require_formats
from etude.campaign.propose.typical_motions import from_rest, typical_motions
from etude.campaign.record.confirmation import FEEDFORWARD, left_over, trained_speeds
from etude.campaign.record.controls import FEEDBACK, LEARNED
from etude.campaign.record.deployed_model import model_of_sha256, model_to_command
from etude.campaign.record.events import Asked
from etude.campaign.record.folder import Campaign, Say
from etude.campaign.record.state import State
from etude.campaign.record.stored_files import FULL, require_description, stored_trajectory, take_up
from etude.campaign.training import learn_pending
from etude.deploy.trajectory_files import TrajectoryFiles, column_names, read_table, render
from etude.errors import UnsafeTrajectoryError, UsageError, typed
from etude.limits.commands import require_possible
from etude.logs.readers.cells import header_row
from etude.models.learned_model import LearnedModel
from etude.protocols import Limit, Trajectory
from etude.storage import write_atomic

CONFIRM_STREAM = 6
"""Stream that separates the random numbers of these motions from those of proposals and tests."""
DRAWS, SPEEDS = 3, (FULL, 90, 80)
"""Number of tries, and the speeds of each in per cent, to leave room for tracking errors."""


def ask_to_confirm(
    campaign: Campaign,
    *,
    new: bool = False,
    formats: Sequence[str] = (),
    effort: bool = False,
    say: Say = lambda _: None,
) -> Proposal:
    """The open confirmation motion, or a new one, to be run without and with the learned feedforward.

    Args:
        campaign: the folder.
        new: propose another one although one is open.
        formats: also write it for these receivers, names among `etude.exporters`.
        effort: with the learned command where the format supports it.
        say: receives one sentence per step.

    Raises:
        UsageError: nothing was learned yet, a file was changed, or a format is unknown or not for this robot.
        UnsafeTrajectoryError: no such motion inside the limits.
    """
    require_formats(campaign, formats, effort=effort)
    with campaign.writing():
        require_description(campaign)
        learn_pending(campaign, say=say)
        return _present_motion(campaign, new, formats, effort, say)


def _present_motion(
    campaign: Campaign, new: bool, formats: Sequence[str], effort: bool, say: Say
) -> Proposal:
    state = campaign.state()
    open_ones = [r for r in state.confirmations if len(r.runs) < 2]
    if open_ones and not new:
        number, made = open_ones[-1].number, None
        constraints = constraints_then(campaign.round(number).asked)
    else:
        number, constraints = state.next_number, constraints_now(campaign, state, FEEDBACK, LEARNED)
        made = _propose(campaign, state, number, constraints, say)
    proposal = present(
        campaign, number, constraints, made, FULL, lambda files: _feedforward_file(campaign, number, files)
    )
    motion = stored_trajectory(campaign, number)
    written = [
        export(campaign, number, motion, proposal.folder, name, effort=effort, drag=effort)
        for name in formats
    ]
    take_up(campaign)
    return replace(proposal, exported=tuple(written))


def _feedforward_file(campaign: Campaign, number: int, files: TrajectoryFiles) -> dict[Path, bytes]:
    """trajectory.csv with the commands of the model that the motion was proposed with.

    Raises:
        UsageError: that model no longer exists.
    """
    place, asked = campaign.proposal(number) / FEEDFORWARD, campaign.round(number).asked
    model = None if asked is None else model_of_sha256(campaign, asked.model_sha256)
    if model is None:
        raise UsageError(
            f"the model whose commands are in {FEEDFORWARD} is no longer in use",
            where=str(place),
            next_step=f"Write another motion: etude ask {typed(campaign.path)} --confirm --new.",
        )
    return {place: feedforward_bytes(campaign, files, model)}


def _propose(
    campaign: Campaign, state: State, number: int, constraints: Constraints, say: Say
) -> tuple[TrajectoryFiles, str]:
    """Files of the motion, committed, and a sentence on how it was found."""
    used = model_to_command(campaign, state)
    say(used.sentence)
    seed = [state.seed, number, CONFIRM_STREAM]
    files, status = _select_motion(campaign, np.random.default_rng(seed), constraints)
    folder = campaign.proposal(number)
    table = folder / FEEDFORWARD
    write_atomic(table, feedforward_bytes(campaign, files, used.model))
    asked = Asked(
        confirm=True,
        status=status,
        seed=tuple(seed),
        learned=len(state.trained),
        active_limits=tuple(files.certificate.active()),
        model_sha256=used.sha256,
    )
    asked = _with_forecast(
        constraints.of(files.trajectory).recorded(asked), campaign, used.model, files.trajectory
    )
    campaign.commit(asked, number, [*files.write(folder), table])
    return files, status


def _select_motion(
    campaign: Campaign, rng: np.random.Generator, constraints: Constraints
) -> tuple[TrajectoryFiles, str]:
    """The first certified motion of the tests' distribution; otherwise a random one inside the limits."""
    limits = constraints.limits(campaign)
    require_possible(limits)
    for motion, speed in _candidates(campaign, rng):
        slower = motion if speed == FULL else motion.slowed(FULL / speed)
        try:
            files = _rendered(campaign, from_rest(campaign, slower, limits), limits, constraints)
        except UnsafeTrajectoryError:
            continue
        slow = "" if speed == FULL else f", at {speed} % of its speed"
        return files, f"confirmation: drawn like the test motions{slow}, never used for training"
    motion = from_rest(campaign, typical_motions(campaign, rng, 1, limits, grown=True)[0], limits)
    return _rendered(
        campaign, motion, limits, constraints
    ), "confirmation: random inside the limits, never used for training"


def _candidates(campaign: Campaign, rng: np.random.Generator) -> Iterator[tuple[Trajectory, int]]:
    for _ in range(DRAWS):
        for motion in campaign.kind.tests(campaign.spec, campaign.config, rng).values():
            yield from ((motion, speed) for speed in SPEEDS)


def _rendered(
    campaign: Campaign, motion: Trajectory, limits: Sequence[Limit], constraints: Constraints
) -> TrajectoryFiles:
    motion_constraints = constraints.of(motion)
    return render(
        motion,
        campaign.kind,
        campaign.spec,
        campaign.config,
        limits,
        motion_constraints.unenforced,
        control=motion_constraints.control,
    )


def feedforward_bytes(campaign: Campaign, files: TrajectoryFiles, model: LearnedModel) -> bytes:
    """trajectory.csv with the model's command beside each set-point, in the robot's command unit."""
    names, rows = read_table(files.table)
    motion = files.trajectory.motion(rows[:, 0], model.inputs.orders)
    command, _ = model.predict(model.inputs.states(motion))
    text = io.StringIO()
    text.write(header_row([*names, *column_names(campaign.command)]))
    text.writelines(",".join(map(repr, row)) + "\n" for row in np.hstack([rows, command]).tolist())
    return text.getvalue().encode()


def _with_forecast(asked: Asked, campaign: Campaign, model: LearnedModel, trajectory: Trajectory) -> Asked:
    """The fact with the expected error; unchanged unless each axis has one command."""
    channel, path = campaign.command, campaign.kind.path
    if channel.acts_on != path or len(channel.parts) != len(campaign.axes):
        return asked
    rates = next((c for c in campaign.channels if c.derivative_of == path), None)
    trained = trained_speeds(model, rates) if rates is not None else np.zeros(len(campaign.axes))
    left = tuple(left_over(model, trajectory, trained))
    return replace(asked, left_over=left, trained_speeds=tuple(trained.tolist()))
