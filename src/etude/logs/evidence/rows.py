"""Rows of all logs of a robot through one zero-phase filter: motion, regressors, and commands to explain.

Positions pass 5 Hz, regressors and commands 2 Hz. The friction column is formed between the two filters: its
step at a reversal has to pass the filter that the command passes. Its speed passes a filter that does not
ring: before a joint breaks away, ringing has the opposite sign. A few hundred rows are kept: a command behind
a filter of 2 Hz says little more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from etude._runtime.friction_memory import dahl
from etude.logs.checks.filtered_motion import goes_far, runs, states_of
from etude.logs.cleaning.filters import looked_at
from etude.logs.cleaning.smoothing import median_rate, quick_length, resample, segments, smooth, uniform_grid
from etude.protocols import Mean
from etude.types import Array, Channel, Index, Log, Mask

MOST_ROWS = 360  # over all logs: the cost of a covariance matrix grows with their cube
MOST_RATE = 10.0  # rows a second: beyond, neighbours say the same
FILTER_RATE = 200.0  # Hz at which logs are filtered, at most
KEPT_RATE = 50.0  # Hz at which regressors are formed
MOTION_HZ, COMMAND_HZ = 5.0, 2.0  # cutoffs of positions, and of commands and their regressors
ORDER = 3  # of the Butterworth filter whose squared gain is applied
EDGE_S = 0.3  # s at either end that hold the filter's own ends
GAUSSIAN = 0  # order of the filter of that speed
STEP_SPEED = 0.03  # of a joint's top speed, over which Coulomb friction changes its sign
# rad (m: a quarter) over which friction turns round, to 1/e (Dahl 1968): gears have 0.001 to 0.02
DISTANCES, OF_SLIDES = tuple(0.0005 * 2.0**i for i in range(7)), 0.25
WIDTHS = (0.01, 0.06, 0.12)  # of a joint's top speed, over which it may turn round as well
FALL = 1.0  # of Coulomb friction, at most, is gone at top speed: with more it would drive the joint
DROP_SPEED = 0.1  # of a joint's top speed, over which static friction drops to Coulomb's
LEAST_S = 1.0  # s of a stretch that is looked at
# parts of its top speed below which a joint stands, and s for which it is slower: gears stick 0.2 to 0.5 s
# before they turn round
STANDS = ((STEP_SPEED, 0.5), (0.02, 0.15))
TURN_SPEED = 0.1  # of top speed, below which a joint turns round
KNOT_S, MOST_KNOTS = 1.0, 60.0  # s between the knots of what it takes then, or more, so that they stay few
# s between the ends of a stand and knots: feedback winds up at once, as fast as the filter of 2 Hz lets it
ENDS = (0.0, 0.25, 0.5, 1.0)
APART, FLOOR = 5.0, 1e-3  # rows that one independent row is worth; of a variance, what nothing explains
APART_S = 1e4  # s between logs: noise has no memory from one to the next
DELAYS = (-0.1, -0.06, -0.04, -0.02, 0.0, 0.02, 0.04, 0.06, 0.1, 0.15)  # s by which commands may be late
AS_LOGGED = DELAYS.index(0.0)


@dataclass(frozen=True, eq=False)
class FilteredRows:
    """n rows of all logs; k joints; d variants of the commands.

    Attributes:
        t: (n,) s, logs far apart. log: (n,) the index of each row's log.
        q, qd, qdd: (n, k) rad or m and their rates, through the filters.
        friction: (n, k) a smooth sign of the velocity less its part of the top speed, through the filter:
            with viscous friction, any that falls or grows in proportion to speed and drives no joint.
        command: (n, k, d) at each of DELAYS, and then with the commands of each group of logs negated.
        gradual: (n, k, e) the same, turned round over each of DISTANCES, and over each of WIDTHS.
        drop: (n, k) its part at low speeds: static friction beyond Coulomb's (Stribeck).
        stands: by joint, (n, m) hat functions of time where it stands: static friction holds any command.
        turning: (n, k) where a joint is slow: there friction may have a memory of more than its way.
        torque, static: (n, k) what the model file says of the commands, whole and at rest; None without one.
        groups: the logs whose commands are negated in each variant after the delays.
        cutoff: Hz of the filter of commands and regressors.
        parts, units: of the positions.
    """

    t: Array
    log: Index
    q: Array
    qd: Array
    qdd: Array
    friction: Array
    gradual: Array
    drop: Array
    stands: tuple[Array, ...]
    turning: Mask
    command: Array
    torque: Array | None
    static: Array | None
    groups: tuple[tuple[int, ...], ...]
    cutoff: float
    parts: tuple[str, ...]
    units: tuple[str, ...]

    @property
    def moving(self) -> Mask:
        """(k,) joints that move far enough to count."""
        return goes_far(self.q)

    def take(self, which: Index) -> FilteredRows:
        """Some of the rows."""
        names = ("t", "log", "q", "qd", "qdd", "friction", "gradual", "drop", "turning", "command")
        some = {name: getattr(self, name)[which] for name in names}
        for name in ("torque", "static"):
            column = getattr(self, name)
            some[name] = None if column is None else column[which]
        return replace(self, stands=tuple(one[which] for one in self.stands), **some)

    def with_joints(self, order: Index, signs: Array) -> FilteredRows:
        """The same with the positions of other joints (k,), with signs (k,), under the same commands."""
        names = ("q", "qd", "qdd", "friction", "drop")
        moved = {name: getattr(self, name)[:, order] * signs for name in names}
        gradual, stands = self.gradual[:, order] * signs[:, None], tuple(self.stands[j] for j in order)
        turning = self.turning[:, order]
        return replace(self, gradual=gradual, stands=stands, turning=turning, **moved)

    def without_turns(self) -> FilteredRows:
        """The rows with a free command around each reversal, within the reach of the commands' filter:
        friction there is no evidence.
        """
        each = _impulse_response(np.subtract.outer(self.t, self.t), self.cutoff)
        return replace(self, stands=tuple(each[:, slow] for slow in self.turning.T))


def rows_of(
    logs: Sequence[Log],
    path: Channel,
    body: Mean | None = None,
    groups: Sequence[tuple[int, ...]] = (),
    late: Sequence[int] | None = None,
) -> FilteredRows | None:
    """The rows of logs with positions `path` and the commands on them; None if all are too short.

    Args:
        body: the model file's prediction of the commands.
        groups: logs whose commands are negated together, one variant each.
        late: logs whose commands are delayed; None: all.
    """
    pieces = _pieces(logs)
    if not pieces:
        return None
    rate, apart = _spacing(pieces)
    both = [_filtered(log, path, body, rate, apart) for _, log in pieces]
    tables, stands = [rows for rows, _ in both], [still for _, still in both]
    which = np.concatenate([np.full(len(one["t"]), i) for (i, _), one in zip(pieces, tables, strict=True)])
    whole = {name: np.concatenate([one[name] for one in tables]) for name in tables[0]}
    return FilteredRows(
        t=whole["t"] + APART_S * which,
        log=which,
        q=whole["q"],
        qd=whole["qd"],
        qdd=whole["qdd"],
        friction=whole["friction"],
        gradual=whole["gradual"].reshape(len(which), len(path.parts), -1),
        drop=whole["drop"],
        stands=tuple(block_diag(*blocks) for blocks in zip(*stands, strict=True)),
        turning=whole["turning"] > 0.0,
        command=commands_of(logs, path, groups, late),
        torque=whole.get("torque"),
        static=whole.get("static"),
        groups=tuple(groups),
        cutoff=_cutoff(rate),
        parts=path.parts,
        units=path.units,
    )


def commands_of(
    logs: Sequence[Log], path: Channel, groups: Sequence[tuple[int, ...]], late: Sequence[int] | None = None
) -> Array:
    """(n, k, d) the commands of the rows of these logs; arguments as in `rows_of`."""
    pieces = _pieces(logs)
    rate, _ = _spacing(pieces)
    commands, which = [], []
    for i, log in pieces:
        delays = DELAYS if late is None or i in late else (0.0,) * len(DELAYS)
        commands.append(_commands(log, path, rate, delays))
        which.append(np.full(len(commands[-1]), i))
    return _with_groups(np.concatenate(commands), np.concatenate(which), groups)


def _pieces(logs: Sequence[Log]) -> list[tuple[int, Log]]:
    """Stretches without pauses, and the index of their log."""
    excerpts = [looked_at(log) for log in logs]
    return [
        (i, log.take(piece))
        for i, log in enumerate(excerpts)
        for piece in segments(log.t)
        if np.ptp(log.t[piece]) >= LEAST_S
    ]


def _spacing(pieces: Sequence[tuple[int, Log]]) -> tuple[float, float]:
    """Rows a second, and s between the knots of the static friction."""
    seconds = sum(float(np.ptp(log.t)) for _, log in pieces)
    return min(MOST_RATE, MOST_ROWS / seconds), max(KNOT_S, seconds / MOST_KNOTS)


def _with_groups(command: Array, which: Index, groups: Sequence[tuple[int, ...]]) -> Array:
    """(n, k, d) with one additional variant for each group, whose commands are negated."""
    turned = [
        np.where(np.isin(which, group)[:, None], -1.0, 1.0) * command[..., AS_LOGGED] for group in groups
    ]
    return np.concatenate([command, *(one[..., None] for one in turned)], axis=2)


def _grid(log: Log) -> tuple[Array, slice]:
    """Uniform times at which a stretch is filtered, and those of them at which regressors are formed."""
    fine = min(FILTER_RATE, median_rate(log.t))
    grid = uniform_grid(log.t, fine)
    return grid[: quick_length(len(grid))], slice(None, None, max(1, int(fine / KEPT_RATE)))


def _cutoff(rate: float) -> float:
    """Hz, of commands and their regressors."""
    return min(COMMAND_HZ, 0.35 * max(rate, 2.0))


def _impulse_response(apart: Array, cutoff: float) -> Array:
    """Impulse response of the commands' filter at `apart` s; 1 at 0."""
    t = np.linspace(-8.0, 8.0, 1601) / cutoff  # beyond, less than 1e-6 is left
    response = smooth(t, (t == 0.0).astype(np.float64)[:, None], cutoff, ORDER).value[:, 0]
    return np.asarray(np.interp(np.abs(apart), t, response / response.max(), right=0.0))


def _commands(log: Log, path: Channel, rate: float, delays: Sequence[float]) -> Array:
    """(n, k, d) the rows' commands in one stretch, at each of the delays."""
    grid, thin = _grid(log)
    command = next(c for c in log.channels.values() if c.role == "command" and c.acts_on == path.name)
    smoothed = smooth(grid, resample(log.t, log[command.name], grid), _cutoff(rate), ORDER).value
    t = grid[thin]
    t = t[_thinned_rows(t, rate)]
    each = {delay: resample(grid, smoothed, t + delay) for delay in set(delays)}
    return np.stack([each[delay] for delay in delays], axis=2)


def _filtered(
    log: Log, path: Channel, body: Mean | None, rate: float, apart: float
) -> tuple[dict[str, Array], list[Array]]:
    """Motion and regressors of one stretch by name, `rate` a second, without the filter's edges; and the
    columns `stands`.
    """
    grid, thin = _grid(log)
    cutoff = _cutoff(rate)
    positions = resample(log.t, log[path.name], grid)
    moved = smooth(grid, positions, MOTION_HZ, ORDER)
    q, qd, qdd = moved.value[thin], moved.first[thin], moved.second[thin]
    speed = smooth(grid, positions, MOTION_HZ, GAUSSIAN).first[thin]
    t = grid[thin]
    top = np.abs(qd).max(axis=0) + np.finfo(float).tiny
    still = _stands(t, speed, top)
    step = np.where(still, 0.0, np.tanh(speed / (STEP_SPEED * top)))
    friction = step - FALL * qd / top
    drop = step * np.exp(-np.abs(speed) / (DROP_SPEED * top))
    slides = np.array([unit != "rad" for unit in path.units])
    steps = np.diff(q, axis=0, prepend=q[:1])[:, :, None]
    gradual = dahl(steps, np.outer(np.where(slides, OF_SLIDES, 1.0), DISTANCES))
    soft = np.stack([np.tanh(speed / (part * top)) for part in WIDTHS], axis=2)
    gradual = np.concatenate([gradual, soft], axis=2) - (FALL * qd / top)[:, :, None]
    parts = {"qd": qd, "qdd": qdd, "friction": friction, "drop": drop}
    parts["gradual"] = gradual.reshape(len(q), -1)
    if body is not None:
        states = states_of(t, path, q, qd, qdd)
        parts |= {"torque": body.predict(states), "static": body.static(states)}
    keep = _thinned_rows(t, rate)
    rows = {name: smooth(t, values, cutoff, ORDER).value[keep] for name, values in parts.items()}
    rows |= {
        "t": t[keep],
        "q": q[keep],
        "turning": (np.abs(qd) < TURN_SPEED * top)[keep].astype(np.float64),
    }
    hats = (_hats(t, column, apart) for column in still.T)
    return rows, [smooth(t, hat, cutoff, ORDER).value[keep] if hat.size else hat[keep] for hat in hats]


def _stands(t: Array, qd: Array, top: Array) -> Mask:
    """(n, k) where joints of top speeds (k,) stand, by STANDS."""
    still = np.zeros(qd.shape, dtype=np.bool_)
    for part, seconds in STANDS:
        width = max(1, round(seconds * (len(t) - 1) / float(t[-1] - t[0])))
        beside = np.pad(qd, ((width // 2 + 1, width - 1 - width // 2), (0, 0)), "symmetric")
        total = np.cumsum(beside, axis=0)
        slow = np.asarray(np.abs(total[width:] - total[:-width]) < width * part * top)
        for column in slow.T:
            for a, b in runs(column):
                column[a:b] = b - a >= width
        still |= slow
    return still


def _hats(t: Array, still: Mask, apart: float) -> Array:
    """(n, m) hat functions over each stand, with knots at ENDS from either end, and `apart` s between."""
    columns = [np.zeros((len(t), 0))]
    for a, b in runs(still):
        half = 0.5 * (t[b - 1] - t[a])
        near = [one for one in ENDS if one == 0.0 or one < half - 0.5 * ENDS[1]]
        far = np.linspace(near[-1], 2.0 * half - near[-1], 2 + int(2.0 * (half - near[-1]) / apart))
        knots = t[a] + np.concatenate([near[:-1], far, 2.0 * half - np.array(near[:-1])[::-1]])
        hats = np.zeros((len(t), len(knots)))
        hats[a:b] = np.column_stack([np.interp(t[a:b], knots, one) for one in np.eye(len(knots))])
        columns.append(hats)
    return np.hstack(columns)


def _thinned_rows(t: Array, rate: float) -> slice:
    step = float(t[-1] - t[0]) / (len(t) - 1)
    edge = int(EDGE_S / step)
    return slice(edge, len(t) - max(1, edge), max(1, round(1.0 / (rate * step))))
