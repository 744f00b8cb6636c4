"""From robot files to models in use without a hand: `etude run` on MuJoCo's own idea of each robot.

    python tests/foreign/measure_runs.py RESULTS [--robots twodof ur3 ...] [--tries 1]
    python tests/foreign/measure_runs.py RESULTS --table

Each robot: `etude init` and `etude run` in simulated time, until the stop rule fires, and nothing else.
Masses are up to 10 % off the file's, set-points come 4 ms late, and joints have Coulomb, viscous and Stribeck
friction. Then the robot makes motions that nobody learned from, inside what it visited: by its feedback
alone, with the model in use fed forward (`etude predict`), and with least squares of the same logs
(pinocchio's regressor, Coulomb and viscous friction, rotor inertia, offsets; see measure_arms.py). Errors are
those beside the set-points as they reach the robot, since no command undoes their delay.

RESULTS is a folder: one campaign and one line of JSON a robot. Robots that have a line are not run again.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import gymnasium
import numpy as np
import pinocchio as pin
import pinocchio_arm as plant
from measure_arms import Array, Log, least_squares, moves_between, predicted, series_inside, share

from etude.drivers import read_recording
from etude_drivers import Machine, MachineSettings

SETTINGS = {"wrong_masses": 0.1, "delay": 0.004, "stiction": 0.3, "friction": 0.05, "viscous": 0.02}
"""Of the table [driver]; see `MachineSettings`."""
TILT = (0.4, 0.9, 0.0)
"""Roll, pitch, yaw of the mounted base, rad."""
LEAD, MOVES = 1.5, 12
"""s in which a test's robot stands and its command fades in; moves of a test."""
ASSETS = Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets"


@dataclass(frozen=True)
class Robot:
    """A robot and what a person types about it.

    Attributes:
        file: its model. joints: patterns for --joints; (): all. words: more words of `etude init`.
        masses: "file", "none" or "placeholders": what the model that Étude gets says of them.
        tilted: the base is mounted askew, a metre above the floor, and robot.toml says so.
    """

    file: Path
    joints: tuple[str, ...] = ()
    words: tuple[str, ...] = ()
    masses: str = "file"
    tilted: bool = False


def of_share(file: str, *joints: str, words: str = "", masses: str = "file", tilted: bool = False) -> Robot:
    return Robot(share() / file, joints, tuple(words.split()), masses, tilted)


FLYING = "--velocity *=3"
ROBOTS = {
    "twodof": of_share("asr_twodof_description/urdf/TwoDofs.urdf"),
    "pendulum": of_share(
        "double_pendulum_description/urdf/double_pendulum_continuous.urdf",
        words="--velocity *=3 --command *=5",
    ),
    "finger": of_share("finger_edu_description/robots/finger_edu.urdf", words="--velocity *=4 --command *=3"),
    "allegro": of_share("allegro_hand_description/urdf/allegro_right_hand.urdf", "joint_[0-3].0"),
    "cart": Robot(
        ASSETS / "inverted_double_pendulum.xml",
        words=("--velocity", "slider=1", "hinge=3", "hinge2=3", "--command", "hinge=150", "hinge2=60"),
    ),
    "pusher": Robot(ASSETS / "pusher_v5.xml", ("r_*",), ("--velocity", "*=2", "--command", "*=20")),
    "so101": of_share("so_arm_description/urdf/so101.urdf"),
    "romeo": of_share("romeo_description/urdf/romeo.urdf", "LShoulder*", "LElbow*"),
    "tiago": of_share("tiago_description/robots/tiago_no_hand.urdf", "torso_lift_joint", "arm_[1-4]_joint"),
    "ur3 tilted": of_share("ur_description/urdf/ur3_joint_limited_robot.urdf", tilted=True),
    "ur5 no masses": of_share("ur_description/urdf/ur5_joint_limited_robot.urdf", masses="none"),
    "talos placeholders": of_share("talos_data/robots/talos_left_arm.urdf", masses="placeholders"),
    "hextilt": of_share("hextilt_description/urdf/hextilt_flying_arm_5.urdf", words=FLYING),
    "kinova on anymal": of_share("anymal_b_simple_description/robots/anymal-kinova.urdf", "j2s6s200*"),
    "pr2": of_share("pr2_description/urdf/pr2.urdf", "r_shoulder*", "r_upper*", "r_elbow*"),
    "g1": of_share("g1_description/urdf/g1_29dof_rev_1_0.urdf", "left_shoulder*", "left_elbow*"),
    "baxter": of_share("baxter_description/urdf/baxter.urdf", "left_[sew][012]"),
}
"""None of these was looked at while constants of learning were chosen."""


# ---------------------------------------------------------------- what the robot is, and what Étude is told


def model_files(robot: Robot, folder: Path) -> tuple[Path, Path]:
    """The model of the robot, and that of its campaign."""
    if robot.file.suffix != ".urdf":
        return robot.file, robot.file
    root = ElementTree.fromstring(robot.file.read_text())
    told = folder / robot.file.name
    told.write_text(_with_masses(root, robot.masses))
    if not robot.tilted:
        return robot.file, told
    true = folder / f"true_{robot.file.name}"
    true.write_text(_on_a_slope(ElementTree.fromstring(robot.file.read_text())))
    return true, told


def _with_masses(root: ElementTree.Element, masses: str) -> str:
    for link in root.iter("link"):
        for inertial in link.findall("inertial"):
            if masses == "none":
                link.remove(inertial)
            elif masses == "placeholders":
                inertial.find("mass").set("value", "1.0")  # type: ignore[union-attr]
                size = {"ixx": "1", "iyy": "1", "izz": "1", "ixy": "0", "ixz": "0", "iyz": "0"}
                inertial.find("inertia").attrib.update(size)  # type: ignore[union-attr]
    return ElementTree.tostring(root, encoding="unicode")


def _on_a_slope(root: ElementTree.Element) -> str:
    children = {joint.find("child").get("link") for joint in root.findall("joint")}  # type: ignore[union-attr]
    base = next(link.get("name", "") for link in root.iter("link") if link.get("name") not in children)
    ElementTree.SubElement(root, "link", name="slope")
    bolts = ElementTree.SubElement(root, "joint", name="bolts", type="fixed")
    ElementTree.SubElement(bolts, "parent", link="slope")
    ElementTree.SubElement(bolts, "child", link=base)
    ElementTree.SubElement(bolts, "origin", rpy=" ".join(map(str, TILT)), xyz="0 0 0")
    return ElementTree.tostring(root, encoding="unicode")


# ---------------------------------------------------------------- the campaign


def etude(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "etude", *words], capture_output=True, text=True, check=False
    )


def begun(robot: Robot, folder: Path) -> tuple[str, dict[str, Any]]:
    """`etude init`; what it said where it refused, and [driver]."""
    true, told = model_files(robot, folder)
    words = ["--joints", *robot.joints] if robot.joints else []
    meshes = ["--mesh-root", str(share().parent.parent)] if true.suffix == ".urdf" else []
    made = etude("init", str(folder / "lab"), "--robot", str(told), *words, *meshes, *robot.words)
    if made.returncode:
        return made.stderr, {}
    if robot.tilted:
        with (folder / "lab" / "robot.toml").open("a") as file:
            file.write(f"\n[mounting]\nposition = [0.0, 0.0, 1.0]\nrotation = {list(TILT)}\n")
    if robot.masses == "placeholders":  # as `init` says: limits that the file's weight exceeds are no limits
        path = folder / "lab" / "robot.toml"
        lines = path.read_text().splitlines(keepends=True)
        path.write_text("".join(one for one in lines if "No motion is possible with the numbers" not in one))
    settings = {**SETTINGS, "model": str(true)}
    lines = [f"{key} = {json.dumps(value)}" for key, value in settings.items()]
    (folder / "lab" / "run.toml").write_text("\n".join(["[driver]", 'on = "mujoco:virtual"', *lines, ""]))
    return "", settings


def campaign(folder: Path, tries: int) -> dict[str, Any]:
    """`etude run` until it ends otherwise than by a stop of the supervisor, at most `tries` times."""
    count, seconds, code, said, steps = 0, 0.0, 7, {}, ""
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    while code == 7 and count < tries:
        done = etude("run", str(folder / "lab"), "--yes", "--json")
        count, code, steps = count + 1, done.returncode, done.stderr
        (folder / f"run{count}.txt").write_text(done.stdout + done.stderr)
        lines = done.stdout.splitlines()
        said = json.loads(lines[-1]) if lines else {}
        seconds += said.get("robot_seconds") or 0.0
    after = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    confirmed = said.get("confirmed") or {}
    return {
        "exit_code": code,
        "tries": count,
        "rounds": len(said.get("rounds", [])),
        "robot_minutes": seconds / 60.0,
        "cpu_minutes": (after - before) / 60.0,
        "promoted": said.get("promoted", False),
        "confirmed": {k: float(np.nanmean(confirmed[k])) for k in ("without", "with") if k in confirmed},
        "why": said.get("why", ""),
        "why_not": said.get("error")
        or [*said.get("notes", []), *(one.get("sentence", one) for one in said.get("not_promoted", []))],
        "last": steps.splitlines()[-1:],
    }


# ---------------------------------------------------------------- motions that nobody learned from


@dataclass(frozen=True)
class Visited:
    """What `least_squares` and the tests ask of an arm: pinocchio's model of the file, top speeds, units."""

    believed: Any
    names: tuple[str, ...]
    speed: Array
    torque: Array


def logs_of(lab: Path) -> list[Log]:
    """The whole motions that taught."""
    out = []
    for path in sorted((lab / "recordings").glob("*.motion.*.parquet")):
        own = read_recording(path)
        if own.command is None or own.motion.part != "motion":
            continue
        inside = (own.t >= own.began) & (own.t - own.began <= own.reached)
        rate = np.gradient(own.asked, own.t, axis=0)
        out.append(
            Log(own.t[inside], own.q[inside], own.command[inside], np.abs(rate[inside]).max(axis=1) > 1e-3)
        )
    return out


def arm_of(robot: Robot, folder: Path, names: tuple[str, ...], logs: Sequence[Log]) -> Visited:
    text = robot.file.read_text()
    if robot.file.suffix == ".urdf":
        whole = pin.buildModelFromXML(plant.one_turn(text))
    else:
        whole = pin.buildModelFromMJCF(str(robot.file))
    locked = [whole.getJointId(name) for name in whole.names[1:] if name not in names]
    model = pin.buildReducedModel(whole, locked, pin.neutral(whole)) if locked else whole
    assert tuple(model.names)[1:] == names, (tuple(model.names), names)
    if robot.tilted:
        model.gravity.linear = pin.rpy.rpyToMatrix(*TILT).T @ model.gravity.linear
    speed = np.max(
        [np.quantile(np.abs(log.motion(10.0)[1][log.moving]), 0.98, axis=0) for log in logs], axis=0
    )
    torque = np.max([np.std(log.tau, axis=0) for log in logs], axis=0)
    return Visited(model, names, 2.0 * speed, torque)


def tests_of(arm: Visited, logs: Sequence[Log], seed: int) -> dict[str, plant.Reference]:
    """Two motions inside what the first log visited: moves between poses, and a Fourier series."""
    rng = np.random.default_rng([seed, 77])
    q = logs[0].q[logs[0].moving]
    lower, upper = np.quantile(q, [0.02, 0.98], axis=0)
    poses = rng.uniform(lower, upper, (MOVES + 1, len(lower)))
    return {"moves": moves_between(poses, arm), "series": series_inside(lower, upper, 0.5 * arm.speed, rng)}  # type: ignore[arg-type]


def errors(
    settings: dict[str, Any], names: tuple[str, ...], motion: plant.Reference, effort: Array | None
) -> Array:
    """(J,) mean |q - set-point| while it moves, rad or m."""
    start = dict(zip(names, motion.q[0].tolist(), strict=True))
    machine = Machine(names, MachineSettings.of({**settings, "start": start}))
    machine.settle()
    step = round(plant.RATE * machine.period)
    rows = [x[::step] for x in (motion.q, motion.qd, motion.qdd)]
    wait = round(LEAD / machine.period)
    for i in range(wait):
        fade = None if effort is None else effort[0] * min(1.0, 2.0 * i / wait)
        machine.ask(rows[0][0], 0.0 * rows[0][0], 0.0 * rows[0][0], fade)
        machine.cycle()
    found = []
    for i, (q, qd, qdd) in enumerate(zip(*rows, strict=True)):
        machine.ask(q, qd, qdd, None if effort is None else effort[min(i * step, len(effort) - 1)])
        machine.cycle()
        found.append(np.abs(machine.q - machine.asked))
    return np.asarray(np.mean(np.array(found)[motion.moving[::step]], axis=0))


def judged(robot: Robot, folder: Path, settings: dict[str, Any], promoted: bool) -> dict[str, Any]:
    """For each test the errors by joint of feedback, of the model in use and of least squares."""
    described = tomllib.loads((folder / "lab" / "robot.toml").read_text())
    names = tuple(axis["name"] for axis in described["axis"])
    logs = logs_of(folder / "lab")
    arm = arm_of(robot, folder, names, logs)
    squares = least_squares(arm, logs)  # type: ignore[arg-type]
    out = {}
    for title, motion in tests_of(arm, logs, 0).items():
        coarse = [x[::10] for x in (motion.t, motion.q, motion.qd, motion.qdd)]
        ahead = {"feedback": None, "least squares": squares.predict(*coarse[1:])}
        if promoted:
            ahead["etude"] = predicted(folder, arm, *coarse)  # type: ignore[arg-type]
        found = {}
        for key, rows in ahead.items():
            effort = (
                None
                if rows is None
                else np.stack([np.interp(motion.t, coarse[0], c) for c in rows.T], axis=1)
            )
            found[key] = errors(settings, names, motion, effort).tolist()
        out[title] = found
    slides = [arm.believed.joints[i + 1].shortname().startswith("JointModelP") for i in range(len(names))]
    return {"joints": names, "slides": slides, "errors": out}


def measured(robot: Robot, folder: Path, tries: int) -> dict[str, Any]:
    """All of one robot."""
    folder.mkdir(parents=True)
    refused, settings = begun(robot, folder)
    if refused:
        return {"exit_code": 2, "why_not": refused}
    began = time.monotonic()
    row = campaign(folder, tries)
    row["wall_minutes"] = (time.monotonic() - began) / 60.0
    if row["rounds"]:
        row |= judged(robot, folder, settings, row["promoted"])
    return row


# ---------------------------------------------------------------- table


def mean_error(row: dict[str, Any], test: str, key: str) -> float:
    """Mean over the turning joints, deg; of a robot without them over its slides, mm."""
    own = np.array(row["errors"][test][key])
    slides = np.array(row["slides"])
    return float(1e3 * own.mean()) if slides.all() else float(np.degrees(own[~slides]).mean())


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Markdown: each robot; both tests as moves / series."""
    head = [
        "robot",
        "joints",
        "robot time, min",
        "motions",
        "feedback, deg",
        "with model, deg",
        "error / feedback error",
    ]
    head += ["error / least-squares error", "CPU, min", "exit code"]
    lines = [f"| {' | '.join(head)} |", "|" + "---|" * len(head)]
    for row in rows:
        cells = [row["robot"], str(len(row.get("joints", ())) or "")]
        # a run that was stopped counts neither time nor motions: its cells are empty
        rounds = row.get("rounds") or ""
        cells += [f"{row['robot_minutes']:.1f}" if rounds else "", str(rounds)]
        tests = list(row.get("errors", {}))
        feedback = [mean_error(row, one, "feedback") for one in tests]
        cells.append(" / ".join(f"{x:.3f}" for x in feedback))
        if row.get("promoted"):
            own = [mean_error(row, one, "etude") for one in tests]
            squares = [mean_error(row, one, "least squares") for one in tests]
            pairs = [own, np.divide(own, feedback), np.divide(own, squares)]
            cells += [
                " / ".join(f"{x:.3f}" if k == 0 else f"{x:.2f}" for x in p) for k, p in enumerate(pairs)
            ]
            ended = "model promoted"
        else:
            cells += ["", "", ""]
            ended = _fact(row.get("why_not", ""))
        cells += [f"{row.get('cpu_minutes', 0):.1f}", f"{row['exit_code']}, {ended}"]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _fact(why: Any) -> str:
    """The beginning of an error, or of what was said."""
    said = why.get("fact", "") if isinstance(why, dict) else why if isinstance(why, str) else "; ".join(why)
    return str(said).partition(":")[0]


def main() -> None:
    """See the module's text."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("results", type=Path)
    parser.add_argument("--robots", nargs="+", default=list(ROBOTS), choices=ROBOTS)
    parser.add_argument("--tries", type=int, default=1)
    parser.add_argument("--table", action="store_true")
    given = parser.parse_args()
    given.results.mkdir(exist_ok=True)
    record = given.results / "rows.jsonl"
    rows = [json.loads(line) for line in record.read_text().splitlines()] if record.exists() else []
    for name in given.robots if not given.table else ():
        if name in [row["robot"] for row in rows]:
            continue
        row = {"robot": name} | measured(ROBOTS[name], given.results / name.replace(" ", "_"), given.tries)
        rows.append(row)
        with record.open("a") as file:
            file.write(json.dumps(row) + "\n")
        print(json.dumps(row), flush=True)
    print(table(rows))


if __name__ == "__main__":
    main()
