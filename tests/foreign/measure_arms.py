"""Accuracy on arms that nobody tuned for, in a plant of others, beside least squares with friction.

    python tests/foreign/measure_arms.py RESULTS [--robots z1 xarm7 kinova] [--seeds 0 1 2] [--logs 3]
    python tests/foreign/measure_arms.py RESULTS --learn [...]
    python tests/foreign/measure_arms.py RESULTS --table

Each robot and seed: `etude init`, then `ask`, the plant, `tell`, as often as there are logs; after the first
and the last log three motions that nobody learned from. What is there is not computed again. RESULTS gets a
folder for each robot and seed. After an update `--learn` learns the logs that are there anew, with today's
settings, and judges that: the motions are then those that the version before asked for.

The target is fixed: the logged torque after a zero-phase low-pass of 10 Hz, at the samples while any joint
moves. Least squares has pinocchio's regressor, Coulomb and viscous friction, rotor inertia and an offset of
each joint; its cut-off and rank are chosen on blocks of the training logs. `exact` is the plant's own law and
parameters. All see the same filtered motion: what `exact` misses is noise, counts and the filter.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pinocchio_arm as plant
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

Array = NDArray[np.float64]
ROBOTS = {
    "z1": ("z1_description/urdf/z1.urdf", tuple(f"joint{i}" for i in range(1, 7))),
    "xarm7": ("xarm_description/urdf/xarm7.urdf", ()),
    "kinova": ("kinova_description/robots/kinova.urdf", ()),
    "ur10": ("ur_description/urdf/ur10_robot.urdf", ()),
    "panda": ("panda_description/urdf/panda.urdf", tuple(f"panda_joint{i}" for i in range(1, 8))),
    "tiago": ("tiago_description/robots/tiago_no_hand.urdf", tuple(f"arm_{i}_joint" for i in range(1, 8))),
}
"""Of example-robot-data. Constants of identification were chosen while looking at the first three; never at
the last three with these plants."""
TARGET_HZ = 10.0
CUTOFFS, RANKS = (2.0, 3.0, 5.0, 8.0, 12.0), (1e-2, 1e-3, 1e-4, 1e-5)
"""Hz, and the smallest singular value kept as a part of the largest: what least squares chooses from."""
RATE = 250.0
MOVES, MOVES_S, SERIES_S = 12, 45.0, 30.0
BLOCKS = 10
SLOW = 0.03
"""Part of its top speed below which a joint is told of apart: friction turns over there."""
TESTS = ("moves inside", "Fourier inside", "moves, whole range")


# ---------------------------------------------------------------- robots, logs, motions


def share() -> Path:
    """Where example-robot-data keeps its files."""
    return Path(pin.__file__).resolve().parents[4] / "share" / "example-robot-data" / "robots"


def arm_of(name: str, seed: int) -> plant.Arm:
    """The plant of a robot; its drives and masses differ from seed to seed."""
    file, joints = ROBOTS[name]
    return plant.arm_of_urdf((share() / file).read_text(), joints, seed=seed)


def etude(*words: str) -> str:
    """The command in a process of its own. RuntimeError: it refuses."""
    words = (sys.executable, "-m", "etude", *words)
    found = subprocess.run(words, capture_output=True, text=True, check=False)
    if found.returncode:
        raise RuntimeError(f"{' '.join(words)}: {found.returncode}\n{found.stdout}{found.stderr}")
    return found.stdout


@dataclass(frozen=True)
class Log:
    """What was logged, at RATE: t (T,), q (T, J) read, tau (T, J) read; `moving` (T,)."""

    t: Array
    q: Array
    tau: Array
    moving: NDArray[np.bool_]

    @property
    def target(self) -> Array:
        """(T, J) the torque as it is to be predicted."""
        return low_pass(self.tau, TARGET_HZ)

    def motion(self, hz: float) -> tuple[Array, Array, Array]:
        """q, qd, qdd (T, J) of the smoothed angles."""
        q = low_pass(self.q, hz)
        qd = np.gradient(q, 1.0 / RATE, axis=0)
        return q, qd, np.gradient(qd, 1.0 / RATE, axis=0)


def low_pass(rows: Array, hz: float) -> Array:
    """Zero-phase Butterworth filter of order 4 along the first axis."""
    return np.asarray(sosfiltfilt(butter(2, hz, fs=RATE, output="sos"), rows, axis=0))


def logged(run: plant.Run) -> Log:
    step = round(plant.RATE / RATE)
    rows = [run.reference.t, run.q_read, run.tau_read, run.reference.moving]
    return Log(*(row[::step] for row in rows))


def moves_between(poses: Array, arm: plant.Arm) -> plant.Reference:
    """Minimum-jerk moves from pose to pose with a rest of 0.3 s, at half the speed limits, for 45 s."""
    parts, dt = [], 1.0 / plant.RATE
    for a, b in pairwise(poses):
        way = b - a
        seconds = max(0.5, float((np.abs(way) * 1.875 / (0.5 * arm.speed)).max()))
        seconds = max(seconds, math.sqrt(float((np.abs(way) * 5.774 / arm.speed).max())))
        u = (np.arange(round(seconds / dt)) * dt / seconds)[:, None]
        s = u**3 * (10 - 15 * u + 6 * u**2)
        ds, dds = 30 * u**2 * (1 - u) ** 2, 60 * u * (1 - 3 * u + 2 * u**2)
        parts.append(np.stack([a + s * way, ds * way / seconds, dds * way / seconds**2]))
        still = np.zeros((3, round(0.3 / dt), len(a)))
        still[0] = b
        parts.append(still)
        if sum(part.shape[1] for part in parts) > MOVES_S / dt:
            break
    q, qd, qdd = np.concatenate(parts, axis=1)
    return plant.Reference(np.arange(len(q)) * dt, q, qd, qdd)


def series_inside(lower: Array, upper: Array, speed: Array, rng: np.random.Generator) -> plant.Reference:
    """Three harmonics of each joint inside a box, at most 90 % of these speeds, with ramps of 2 s."""
    t = np.arange(round(SERIES_S * plant.RATE) + 1) / plant.RATE
    n, w = len(lower), 2.0 * np.pi * np.array([0.1, 0.2, 0.3])
    phases, sizes = (
        rng.uniform(0, 2 * np.pi, (3, n)),
        rng.uniform(0.3, 1.0, (3, n)) / np.array([[1], [2], [3]]),
    )
    u = np.clip(np.minimum(t, t[-1] - t) / 2.0, 0.0, 1.0)
    window = (u**3 * (10 - 15 * u + 6 * u**2))[:, None]
    path = sum(sizes[k] * np.sin(np.outer(t, [w[k]]) + phases[k]) for k in range(3))
    path = window * (path - path.mean(axis=0))
    rate = np.gradient(path, t, axis=0)
    size = np.abs(path).max(axis=0) / (0.45 * (upper - lower))
    factor = np.maximum(size, np.abs(rate).max(axis=0) / (0.9 * speed))
    q = 0.5 * (lower + upper) + path / factor
    qd = np.gradient(q, t, axis=0)
    return plant.Reference(t, q, qd, np.gradient(qd, t, axis=0))


class Shapes:
    """Collision shapes of a description, by pinocchio and coal; neighbours are left out, and
    pairs that touch in half of all poses."""

    def __init__(self, name: str, arm: plant.Arm, rng: np.random.Generator) -> None:
        file, joints = ROBOTS[name]
        text = plant.one_turn((share() / file).read_text())
        whole = pin.buildModelFromXML(text)
        shapes = pin.buildGeomFromUrdfString(
            whole, text, pin.GeometryType.COLLISION, None, [str(share().parent.parent), str(share())]
        )
        keep = joints or tuple(whole.names)[1:]
        locked = [whole.getJointId(n) for n in whole.names[1:] if n not in keep]
        self.model, self.shapes = (
            pin.buildReducedModel(whole, shapes, locked, pin.neutral(whole)) if locked else (whole, shapes)
        )
        for shape in self.shapes.geometryObjects:
            if hasattr(shape.geometry, "buildConvexHull"):
                shape.geometry.buildConvexHull(True, "Qt")
                shape.geometry = shape.geometry.convex
        self.shapes.addAllCollisionPairs()
        self.data = self.model.createData()
        self._leave_out(arm, rng)

    def _leave_out(self, arm: plant.Arm, rng: np.random.Generator) -> None:
        found = pin.GeometryData(self.shapes)
        hits = np.zeros(len(self.shapes.collisionPairs))
        for _ in range(60):
            q = rng.uniform(arm.lower, arm.upper)
            pin.computeCollisions(self.model, self.data, self.shapes, found, q, False)
            hits += [r.isCollision() for r in found.collisionResults]
        pairs = [
            pin.CollisionPair(p.first, p.second) for p in self.shapes.collisionPairs
        ]  # these move otherwise
        for pair, count in zip(pairs, hits, strict=True):
            one, other = (self.shapes.geometryObjects[i].parentJoint for i in (pair.first, pair.second))
            if abs(one - other) <= 1 or count > 30:
                self.shapes.removeCollisionPair(pair)
        self.found = pin.GeometryData(self.shapes)

    def clear(self, q: Array) -> bool:
        return not pin.computeCollisions(self.model, self.data, self.shapes, self.found, q, True)


def clear_poses(shapes: Shapes, arm: plant.Arm, rng: np.random.Generator, count: int) -> Array:
    """(count, J) poses of the whole legal range, 5 % off its ends, whose straight moves touch nothing."""
    room = 0.05 * (arm.upper - arm.lower)
    found: list[Array] = []
    for _ in range(20000):
        q = rng.uniform(arm.lower + room, arm.upper - room)
        way = [q] if not found else [found[-1] + s * (q - found[-1]) for s in np.linspace(1.0, 0.05, 20)]
        if all(shapes.clear(pose) for pose in way):
            found.append(q)
        if len(found) == count:
            return np.stack(found)
    raise RuntimeError("no clear moves were found")


def tests_of(name: str, arm: plant.Arm, seed: int, log: Log) -> dict[str, plant.Reference]:
    """Motions that nobody learns from: two inside what the first log visited, one of all poses."""
    rng = np.random.default_rng([seed, 77])
    q, qd, _ = log.motion(TARGET_HZ)
    lower, upper = np.quantile(q[log.moving], [0.02, 0.98], axis=0)
    inside = rng.uniform(lower, upper, (MOVES + 1, len(lower)))
    whole = clear_poses(Shapes(name, arm, rng), arm, rng, MOVES + 1)
    speed = np.quantile(np.abs(qd[log.moving]), 0.98, axis=0)
    return {
        TESTS[0]: moves_between(inside, arm),
        TESTS[1]: series_inside(lower, upper, speed, rng),
        TESTS[2]: moves_between(whole, arm),
    }


# ---------------------------------------------------------------- least squares


@dataclass(frozen=True)
class LeastSquares:
    """Base parameters, friction, rotor inertia, offsets; `smooth` (J,) rad/s of the sign."""

    arm: plant.Arm
    smooth: Array
    weights: Array
    cutoff: float

    def predict(self, q: Array, qd: Array, qdd: Array) -> Array:
        """(T, J)."""
        return regressor(self.arm, q, qd, qdd, self.smooth) @ self.weights


def regressor(arm: plant.Arm, q: Array, qd: Array, qdd: Array, smooth: Array) -> Array:
    """(T, J, P) of the links' ten parameters each, then of each joint's friction, rotor and offset."""
    n, data = q.shape[1], arm.believed.createData()
    links = np.stack(
        [pin.computeJointTorqueRegressor(arm.believed, data, *row) for row in zip(q, qd, qdd, strict=True)]
    )
    own = np.zeros((len(q), n, 4 * n))
    for k, column in enumerate((np.tanh(qd / smooth), qd, qdd, np.ones_like(q))):
        own[:, np.arange(n), k * n + np.arange(n)] = column
    return np.concatenate([links, own], axis=2)


def least_squares(arm: plant.Arm, logs: Sequence[Log]) -> LeastSquares:
    """Cut-off and rank are those with the least error on blocks of the logs held out."""
    smooth, best = 0.005 * arm.speed, (math.inf, 0.0, 0.0)
    tables = {}
    for hz in CUTOFFS:
        rows = [(log.motion(hz), low_pass(log.tau, hz), log) for log in logs]
        step = 10  # 25 rows a second
        A = np.concatenate([regressor(arm, *(x[::step] for x in m), smooth) for m, _, _ in rows])
        y = np.concatenate([tau[::step] for _, tau, _ in rows])
        wanted = np.concatenate([log.target[::step] for log in logs])
        use = np.concatenate([log.moving[::step] for log in logs])
        tables[hz] = A[use], y[use], wanted[use]
    for hz, (A, y, wanted) in tables.items():
        block = np.arange(len(y)) * BLOCKS // len(y) % 5
        for rank in RANKS:
            error = 0.0
            for k in range(5):
                w = solved(A[block != k], y[block != k], arm.torque, rank)
                error += float((((A[block == k] @ w - wanted[block == k]) / arm.torque) ** 2).sum())
            best = min(best, (error, hz, rank))
    _, hz, rank = best
    A, y, _ = tables[hz]
    return LeastSquares(arm, smooth, solved(A, y, arm.torque, rank), hz)


def solved(A: Array, y: Array, unit: Array, rank: float) -> Array:
    """(P,) by singular values, columns of equal length, joints in parts of their limits."""
    rows, right = (A / unit[:, None]).reshape(-1, A.shape[2]), (y / unit).ravel()
    size = np.linalg.norm(rows, axis=0)
    size[size < 1e-9 * size.max()] = np.inf
    return np.asarray(np.linalg.lstsq(rows / size, right, rcond=rank)[0] / size)


# ---------------------------------------------------------------- one robot and seed


def predicted(folder: Path, arm: plant.Arm, t: Array, q: Array, qd: Array, qdd: Array) -> Array:
    """(T, J) what `etude predict` says along a table of states."""
    names = arm.names
    header = ["time", *(f"{word}_{name}" for word in ("q", "qd", "qdd") for name in names)]
    place = folder / "states.csv"
    rows = np.column_stack([t - t[0], q, qd, qdd])
    np.savetxt(place, rows, delimiter=",", header=",".join(header), comments="", fmt="%.12g")
    out = folder / "predicted.csv"
    etude("predict", str(folder / "lab"), str(place), "--output", str(out))
    with out.open() as file:
        columns = file.readline().strip().split(",")
    table = np.loadtxt(out, delimiter=",", skiprows=1)
    place_of = [
        next(i for i, c in enumerate(columns) if c.startswith("command_") and c.endswith(n)) for n in names
    ]
    own = table[:, columns.index("time")]
    return np.stack([np.interp(t - t[0], own, table[:, i]) for i in place_of], axis=1)


def cell(results: Path, name: str, seed: int, count: int) -> None:
    """All of one robot and seed; each finished stage is a line of its file."""
    folder = results / f"{name}_{seed}"
    folder.mkdir(parents=True, exist_ok=True)
    record = folder / "rows.jsonl"
    done = (
        {json.loads(line)["logs"] for line in record.read_text().splitlines()} if record.exists() else set()
    )
    arm, lab = arm_of(name, seed), folder / "lab"
    if not lab.exists():
        begun(folder, lab, name, seed)
    logs: list[Log] = []
    for number in range(1, count + 1):
        kept = folder / f"log{number}.npz"
        if not kept.exists():
            etude("ask", str(lab), "--continue")
            table = (lab / "proposals" / f"{number:04d}" / "trajectory.csv").read_bytes()
            run = plant.run(arm, plant.reference_of_table(table, arm.names), seed=100 * seed + number)
            (folder / f"log{number}.csv").write_bytes(run.log())
            print(name, seed, etude("tell", str(lab), str(folder / f"log{number}.csv")), flush=True)
            log = logged(run)
            np.savez(kept, t=log.t, q=log.q, tau=log.tau, moving=log.moving)
        logs.append(log_of(kept))
        if number in (1, count) and number not in done:
            keep_row(folder, name, arm, seed, logs)


def learned_anew(results: Path, name: str, seed: int, count: int) -> None:
    """The logs that are there, under the settings of a new campaign, in the place of what they taught before.

    A cell that was learned anew already has a campaign `new`, and is left.
    """
    folder, arm = results / f"{name}_{seed}", arm_of(name, seed)
    lab, new = folder / "lab", folder / "new"
    if new.exists():
        return
    begun(folder, new, name, seed)
    (lab / "campaign.toml").write_bytes((new / "campaign.toml").read_bytes())
    etude("learn", str(lab))
    keep_row(folder, name, arm, seed, [log_of(folder / f"log{i}.npz") for i in range(1, count + 1)])


def begun(folder: Path, lab: Path, name: str, seed: int) -> None:
    """`etude init` of the robot's URDF."""
    urdf = folder / f"{name}.urdf"
    urdf.write_text(plant.one_turn((share() / ROBOTS[name][0]).read_text()))
    words = ["--joints", *ROBOTS[name][1]] if ROBOTS[name][1] else []
    meshes = ["--mesh-root", str(share().parent.parent)]
    etude("init", str(lab), "--robot", str(urdf), *meshes, "--seed", str(seed), *words)


def log_of(kept: Path) -> Log:
    with np.load(kept) as found:
        return Log(found["t"], found["q"], found["tau"], found["moving"])


def keep_row(folder: Path, name: str, arm: plant.Arm, seed: int, logs: Sequence[Log]) -> None:
    """Judges the folder's model; of rows of as many logs the newest counts."""
    row = {"robot": name, "seed": seed, "logs": len(logs), "tests": judged(folder, name, arm, seed, logs)}
    with (folder / "rows.jsonl").open("a") as file:
        file.write(json.dumps(row) + "\n")


def judged(folder: Path, name: str, arm: plant.Arm, seed: int, logs: Sequence[Log]) -> dict[str, Any]:
    """For each test and joint: rms torque error and tracking error of both models, and what was visited."""
    squares = least_squares(arm, logs)
    lower = np.min([log.q[log.moving].min(axis=0) for log in logs], axis=0)
    upper = np.max([log.q[log.moving].max(axis=0) for log in logs], axis=0)
    out = {}
    for title, reference in tests_of(name, arm, seed, logs[0]).items():
        log = logged(plant.run(arm, reference, seed=1000 + seed))
        motion, use = log.motion(TARGET_HZ), log.moving
        said = {
            "etude": predicted(folder, arm, log.t, *motion),
            "least squares": squares.predict(*motion),
            "exact": exact(arm, *motion),
        }
        torque = {k: rms((v - log.target)[use]).tolist() for k, v in said.items()}
        slow = use[:, None] & (np.abs(motion[1]) < SLOW * arm.speed)
        fast = {k: each_rms(v - log.target, use[:, None] & ~slow) for k, v in said.items()}
        still = {k: each_rms(v - log.target, slow) for k, v in said.items()}
        step = round(plant.RATE / RATE)
        plan = [x[::step] for x in (reference.q, reference.qd, reference.qdd)]
        ahead = {
            "etude": predicted(folder, arm, reference.t[::step], *plan),
            "least squares": squares.predict(*plan),
        }
        tracking = {}
        for key, rows in ahead.items():
            effort = np.stack([np.interp(reference.t, reference.t[::step], row) for row in rows.T], axis=1)
            sent = plant.Reference(reference.t, reference.q, reference.qd, reference.qdd, effort)
            tracking[key] = plant.run(arm, sent, "pd", seed=1000 + seed).tracking.tolist()
        outside = ((reference.q < lower) | (reference.q > upper)).mean(axis=0)
        out[title] = {
            "torque": torque,
            "fast": fast,
            "slow": still,
            "tracking": tracking,
            "spread": np.std(log.target[use], axis=0).tolist(),
            "limit": arm.torque.tolist(),
            "outside": outside.tolist(),
            "cutoff": squares.cutoff,
        }
        print(
            name, seed, len(logs), title, {k: np.round(v, 3).tolist() for k, v in torque.items()}, flush=True
        )
    return out


def exact(arm: plant.Arm, q: Array, qd: Array, qdd: Array) -> Array:
    """(T, J) what the plant itself needs for this motion: its true bodies, friction and cogging."""
    data = arm.true.createData()
    bodies = np.stack([pin.rnea(arm.true, data, *row) for row in zip(q, qd, qdd, strict=True)])
    return np.asarray(bodies + arm.drives.friction(qd) + arm.drives.ripple(q))


def each_rms(rows: Array, use: NDArray[np.bool_]) -> list[float]:
    """(J,) of the samples that each joint uses."""
    return [float(np.sqrt(np.mean(rows[use[:, j], j] ** 2))) for j in range(rows.shape[1])]


def rms(rows: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(rows**2, axis=0)))


# ---------------------------------------------------------------- table


def rows_of(results: Path) -> Iterator[dict[str, Any]]:
    """Of each robot and seed the newest row of as many logs. What the plant itself needs for the tests does
    not depend on logs, so rows that are older than that column have it too."""
    for file in sorted(results.glob("*/rows.jsonl")):
        rows = {row["logs"]: row for row in map(json.loads, file.read_text().splitlines())}
        for title in TESTS:
            torques = [row["tests"][title]["torque"] for row in rows.values()]
            known = next((t["exact"] for t in torques if "exact" in t), [math.nan])
            for torque in torques:
                torque.setdefault("exact", known)
        yield from rows.values()


def ratio(test: dict[str, Any], what: str, model: str = "etude") -> float:
    """A model's error over that of least squares: joints in parts of their torque limits, or as they are."""
    unit = np.ones(len(test["limit"])) if what == "tracking" else np.array(test["limit"])
    size = {k: float(np.linalg.norm(np.array(v) / unit)) for k, v in test[what].items()}
    return size[model] / size["least squares"]


def table(results: Path) -> str:
    """Markdown: each robot, test and number of logs; over seeds the geometric mean and its range."""
    rows = list(rows_of(results))
    head = [
        "arm",
        "test",
        "logs",
        "seeds",
        "torque",
        "exact",
        "joint moves",
        "joint slow",
        "tracking",
        "torque by joint",
    ]
    lines = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    for name in dict.fromkeys(r["robot"] for r in rows):
        for title in TESTS:
            for count in sorted({r["logs"] for r in rows if r["robot"] == name}):
                own = [r["tests"][title] for r in rows if r["robot"] == name and r["logs"] == count]
                joints = np.array(
                    [np.array(t["torque"]["etude"]) / t["torque"]["least squares"] for t in own]
                )
                each = " ".join(f"{x:.2f}" for x in np.exp(np.log(joints).mean(axis=0)))
                what = (
                    ("torque", "etude"),
                    ("torque", "exact"),
                    *((k, "etude") for k in ("fast", "slow", "tracking")),
                )
                cells = [_spread([ratio(t, *key) for t in own]) for key in what]
                lines.append(f"| {name} | {title} | {count} | {len(own)} | {' | '.join(cells)} | {each} |")
    return "\n".join(lines)


def _spread(values: list[float]) -> str:
    values = [value for value in values if math.isfinite(value)]
    if not values:
        return ""
    return f"{math.exp(float(np.mean(np.log(values)))):.2f} ({min(values):.2f} to {max(values):.2f})"


def main() -> None:
    """See the module's text."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path)
    parser.add_argument("--robots", nargs="+", default=list(ROBOTS))
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--logs", type=int, default=3)
    parser.add_argument("--learn", action="store_true")
    parser.add_argument("--table", action="store_true")
    given = parser.parse_args()
    if not given.table:
        for seed in given.seeds:
            for name in given.robots:
                (learned_anew if given.learn else cell)(given.results, name, seed, given.logs)
    print(table(given.results))


if __name__ == "__main__":
    main()
