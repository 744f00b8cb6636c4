"""The closed loop with a model that learns in it: one feedforward and one measurement a control tick."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from etude.control.closed_loop import control_times
from etude.control.feedforward import model_feedforward
from etude.errors import UsageError
from etude.logs.log import RobotLog
from etude.models.inverse_dynamics import InverseDynamicsModel
from etude.models.online.model import OnlineModel
from etude.plants.robot import SimulatedRobot
from etude.plants.trace import LoopInputs, Running
from etude.threads import threads_for
from etude.trajectories.samples import Trajectory, TrajectorySamples

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class OnlineRun:
    """What happened.

    Attributes:
        log: as of any run; t starts at 0 with the first pass, the lead-in lies before.
        weights: (T, dof) part of each command that came from the updated model.
        predict_s, update_s: (T,) processor seconds that each tick spent on its feedforward and on learning.
        learned: (T,) whether an output learned a sample in that tick.
        passes: how often the trajectory was run.
    """

    log: RobotLog
    weights: Array
    predict_s: Array
    update_s: Array
    learned: NDArray[np.bool_]
    passes: int

    def pass_errors(self) -> Array:
        """Mean |desired - true| position (passes, dof) in rad."""
        moving = self.log.t >= 0.0
        assert self.log.q_des is not None
        assert self.log.q_true is not None
        error = np.abs(self.log.q_des - self.log.q_true)[moving]
        return np.stack([part.mean(axis=0) for part in np.array_split(error, self.passes)])


def run_online(
    robot: SimulatedRobot,
    trajectory: Trajectory,
    model: InverseDynamicsModel,
    online: OnlineModel | None,
    rng: np.random.Generator | None,
    passes: int = 1,
    lead_in: float = 2.0,
    changes: Mapping[float, Any] | None = None,
) -> OnlineRun:
    """Runs a trajectory that ends where it starts several times over, learning all the while.

    Args:
        robot: simulated, of an engine that can be advanced tick by tick ("compiled").
        model: its feedforward is what drives where the learners have no weight.
        online: made from `model`; None for the same loop without updates.
        rng: of the encoder noise; None for none.
        changes: time in s -> the robot's physical parameters from then on.

    Raises:
        UsageError: an engine that cannot be advanced, or joints that do not fit.
    """
    if robot.begin is None:
        raise UsageError(
            "this engine runs a trajectory as a whole only", where=robot.name, next_step='Use "compiled".'
        )
    if not trajectory.dof == robot.spec.dof == model.dof or passes < 1:
        raise UsageError(
            f"{passes} passes of {trajectory.dof} joints with a model of {model.dof}",
            where=f"{robot.name}, {robot.spec.dof} joints",
            next_step="Give one pass or more, of the robot's own joints.",
        )
    held = round(lead_in * robot.spec.rate)
    motion = _repeated(trajectory, robot.spec.rate, passes)
    plan, samples = _plan(motion, model, robot, held), _led_in(motion, held, robot.spec.rate)
    noise = np.zeros_like(samples.q) if rng is None else rng.normal(0.0, robot.encoder_noise, samples.q.shape)
    running = robot.begin(samples.q[0])
    due = sorted((changes or {}).items(), key=lambda change: change[0])
    with threads_for(0):
        return _run(robot, running, samples, plan, online, noise, due, passes)


@dataclass(frozen=True, eq=False)
class _Plan:
    """Along the desired motion: features (T, D), mean function and frozen feedforward (T, dof).

    During the lead-in the first row holds, as in every run.
    """

    X: Array
    base: Array
    frozen: Array


def _plan(samples: TrajectorySamples, model: InverseDynamicsModel, robot: SimulatedRobot, held: int) -> _Plan:
    motion = samples.q, samples.qd, samples.qdd
    frozen = model_feedforward(model, robot.spec)(samples)
    rows = (model.features.transform(*motion), model.mean_function(*motion), frozen)
    return _Plan(*(np.concatenate([np.repeat(x[:1], held, axis=0), x]) for x in rows))


def _run(
    robot: SimulatedRobot,
    running: Running,
    samples: TrajectorySamples,
    plan: _Plan,
    online: OnlineModel | None,
    noise: Array,
    due: list[tuple[float, Any]],
    passes: int,
) -> OnlineRun:
    T, dof = samples.q.shape
    rows = {name: np.empty((T, dof)) for name in ("q", "q_true", "tau", "tau_fb", "tau_ff")}
    weights, spent, learned = np.zeros((T, dof)), np.zeros((T, 2)), np.zeros(T, dtype=np.bool_)
    limit = robot.spec.command
    for k in range(T):
        while due and samples.t[k] >= due[0][0]:
            running.change(due.pop(0)[1])
        start = time.thread_time()
        ff = plan.frozen[k]
        if online is not None:
            ff = np.clip(online.command(plan.X[k], plan.base[k], ff), -limit, limit)
            weights[k] = online.weights()
        spent[k, 0] = time.thread_time() - start
        one = slice(k, k + 1)
        trace = running.advance(
            LoopInputs(samples.q[one], samples.qd[one], ff[None], noise[one], robot.substeps)
        )
        rows["tau_ff"][k] = ff
        for name in ("q", "q_true", "tau", "tau_fb"):
            rows[name][k] = getattr(trace, name)[0]
        if online is not None:
            start = time.thread_time()
            learned[k] = online.observe(float(samples.t[k]), trace.q[0], trace.tau[0]) > 0
            spent[k, 1] = time.thread_time() - start
    log = RobotLog(
        names=robot.spec.names,
        command_unit=robot.spec.command_unit,
        t=samples.t,
        q_des=samples.q,
        qd_des=samples.qd,
        qdd_des=samples.qdd,
        source=f"simulated {robot.name}",
        q=rows["q"],
        q_true=rows["q_true"],
        tau=rows["tau"],
        tau_fb=rows["tau_fb"],
        tau_ff=rows["tau_ff"],
    )
    return OnlineRun(log, weights, spent[:, 0], spent[:, 1], learned, passes)


def _repeated(trajectory: Trajectory, rate: float, passes: int) -> TrajectorySamples:
    once = trajectory.sample(control_times(trajectory.duration, rate))
    count = len(once.t)
    many = [np.tile(x, (passes, 1)) for x in (once.q, once.qd, once.qdd, once.qddd)]
    return TrajectorySamples(np.arange(passes * count) / rate, *many)


def _led_in(samples: TrajectorySamples, held: int, rate: float) -> TrajectorySamples:
    """With `held` ticks at rest in the first position before it."""
    rest = [np.repeat(samples.q[:1], held, axis=0), *(np.zeros((held, samples.q.shape[1])) for _ in range(3))]
    rows = (samples.q, samples.qd, samples.qdd, samples.qddd)
    t = np.concatenate([samples.t[0] - np.arange(held, 0, -1) / rate, samples.t])
    return TrajectorySamples(t, *(np.concatenate(pair) for pair in zip(rest, rows, strict=True)))
