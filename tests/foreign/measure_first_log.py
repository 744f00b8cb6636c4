"""What a user's own slow log of 15 s teaches, on arms that nobody tuned for, beside the file as it came.

    python tests/foreign/measure_first_log.py [--robots ur5 human z1 ...] [--seeds 7]

Each arm moves a tenth of its ranges about the middle. Then gravity (half of the states, at rest) and the
whole command (the others, at up to half the top speed) are judged over the whole legal range, in parts of
each joint's limit. The plant is `pinocchio_arm`: masses up to 15 % off, friction, cogging, delay, noise.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import measure_arms as arms
import numpy as np
import pinocchio_arm as plant
from pinocchio_arm import pin

import etude

RANGE, SECONDS, STATES = 0.05, 15.0, 1000
HZ = (0.1, 0.23, 0.37)
ROBOTS = arms.ROBOTS | {
    "ur5": ("ur_description/urdf/ur5_robot.urdf", ()),
    "human": (
        "human_description/robots/human.urdf",
        tuple(f"right_{part}" for part in ("shoulder_Z", "shoulder_X", "shoulder_Y", "elbow_Z", "elbow_Y")),
    ),
}


def slow_motion(arm: plant.Arm) -> plant.Reference:
    """Three sines of each joint about the middle of its range."""
    t = np.arange(round(SECONDS * plant.RATE) + 1) / plant.RATE
    rng = np.random.default_rng(2)
    window = np.clip(np.minimum(t, t[-1] - t) / 2.0, 0.0, 1.0)
    window = (window**3 * (10 - 15 * window + 6 * window**2))[:, None]
    waves = [np.sin(2 * np.pi * hz * t[:, None] + rng.uniform(0, 2 * np.pi, len(arm.names))) for hz in HZ]
    q = 0.5 * (arm.lower + arm.upper) + RANGE * (arm.upper - arm.lower) * window * sum(waves)
    qd = np.gradient(q, t, axis=0)
    return plant.Reference(t, q, qd, np.gradient(qd, t, axis=0))


def bodies(model: object, states: plant.Array) -> plant.Array:
    """(T, J) torques of rigid bodies alone at q, qd, qdd (3, T, J)."""
    data = model.createData()  # type: ignore[attr-defined]
    return np.stack([pin.rnea(model, data, *row) for row in np.swapaxes(states, 0, 1)])


def measured(name: str, seed: int, folder: Path) -> dict[str, float]:
    """Rms errors of the file and of the model, in parts of the limit, over states and joints."""
    urdf, joints = ROBOTS[name]
    text = plant.one_turn((arms.share() / urdf).read_text())
    arm, lab = plant.arm_of_urdf(text, joints, seed=seed), folder / f"{name}_{seed}"
    (folder / f"{name}.urdf").write_text(text)
    (folder / "log.csv").write_bytes(plant.run(arm, slow_motion(arm), "pd_gravity", seed=1).log())
    words = ["--joints", *joints] if joints else []
    meshes = ["--mesh-root", str(arms.share().parent.parent)]
    arms.etude("init", str(lab), "--robot", str(folder / f"{name}.urdf"), *meshes, *words)
    arms.etude("tell", str(lab), str(folder / "log.csv"))
    rng, shape = np.random.default_rng(11), (STATES, len(arm.names))
    q, qd = rng.uniform(arm.lower, arm.upper, shape), 0.5 * rng.uniform(-arm.speed, arm.speed, shape)
    states = np.stack([q, qd, rng.uniform(-2.0, 2.0, shape)])
    states[1:, ::2] = 0.0
    model, still, rest = etude.load_model(lab), np.arange(STATES) % 2 == 0, np.stack([q, 0 * q, 0 * q])
    true = (
        bodies(arm.true, states) + arm.drives.ripple(q) + np.where(still[:, None], 0, arm.drives.friction(qd))
    )
    said = model.predict(dict(zip(("q", "qd", "qdd"), states, strict=True)))
    parts = {
        "gravity, file": (bodies(arm.believed, rest) - true)[still],
        "gravity, model": (model.gravity(q) - true)[still],
        "moving, file": (bodies(arm.believed, states) - true)[~still],
        "moving, model": (said.mean - true)[~still],
        "moving, stated": np.sqrt(said.variance)[~still],
    }
    return {key: float(np.sqrt(np.mean((rows / arm.torque) ** 2))) for key, rows in parts.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--robots", nargs="+", default=list(ROBOTS), choices=list(ROBOTS))
    parser.add_argument("--seeds", nargs="+", type=int, default=[7])
    given = parser.parse_args()
    rows = []
    for name in given.robots:
        for seed in given.seeds:
            with tempfile.TemporaryDirectory() as folder:
                rows.append(measured(name, seed, Path(folder)))
            print(f"| {name} | {seed} |", " | ".join(f"{v:.4f}" for v in rows[-1].values()), "|", flush=True)
    mean = {key: np.sqrt(np.mean([row[key] ** 2 for row in rows])) for key in rows[0]}
    print("| all | |", " | ".join(f"{v:.4f}" for v in mean.values()), "|", " | ".join(mean))


if __name__ == "__main__":
    main()
