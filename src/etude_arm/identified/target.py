"""`etude export --to urdf`, `--to mjcf`: a model file with identified inertias and their intervals."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from etude._runtime.options import taken
from etude.errors import UsageError
from etude.logs.readers.cells import text_cell
from etude.models.accuracy import NORMAL_95
from etude.protocols import Kind
from etude.types import Array, Delivered, Samples
from etude_arm.identified.combinations import MEASURED, PARTLY, identifiability
from etude_arm.identified.consistent_parameters import Identified, identified
from etude_arm.identified.model_file_writer import JointTerms, central, mjcf, with_drives, written
from etude_arm.identified.pseudo_inertia import PAIRS, is_possible
from etude_arm.identified.replayed import Replayed, replayed
from etude_arm.physics.geometry import has_masses
from etude_arm.physics.mean import RigidBodyMean
from etude_arm.spec import FORCES, ArmSpec

NAMES = ("mass", "m cx", "m cy", "m cz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
UNITS = ("kg", *["kg m"] * 3, *["kg m^2"] * 6)
SLOW = 0.5
"""Of a joint's velocity limit: friction that was seen at lower speeds alone is extrapolated."""
NOTHING = 0.05
"""Relative change of an error; smaller changes do not count."""


@dataclass(frozen=True)
class FileOptions:
    """Inputs from the campaign."""

    samples: Samples
    config: Any
    model_hash: str = ""


Writer = Callable[[ArmSpec, Mapping[str, Array], Mapping[str, JointTerms]], dict[str, bytes]]


@dataclass(frozen=True)
class ModelFile:
    """A target (`protocols.Target`): the model file in its own format, or as MJCF."""

    name: str
    write: Writer
    needs = ("samples", "config")

    def __call__(self, model: Any, kind: Kind, spec: Any, options: Mapping[str, Any]) -> Delivered:  # noqa: ARG002
        """Raises a UsageError for another kind than arm, without a model file, or if commands are not
        forces.
        """
        _require_forces(spec)
        file_options = taken(options, FileOptions, self.name)
        mean = kind.physics(spec, file_options.config)["identified"](file_options.samples)
        assert isinstance(mean, RigidBodyMean)
        fit = identified(file_options.samples, spec, mean)
        bodies = {name: fit.result.phi[place] for name, place in fit.links.identifiable}
        written = self.write(spec, bodies, fit.joints)
        name, *_ = written
        played = _played(name, written, file_options.samples, spec, fit, mean)
        rows = _rows(fit)
        sentences = [
            *_summary_sentences(fit, spec, rows),
            *_addition_sentences(name, spec, bodies),
            *_lost_motion_sentences(fit, spec),
            *_played_sentences(name, played, fit, spec),
            *extrapolated(fit, spec),
        ]
        facts: dict[str, Any] = {"told": fit.measured, "segments": fit.errors.segments}
        if played is not None:
            names = ("file", "drives", "physics")
            facts["played"] = {
                one: dict(zip(spec.names, getattr(played, one).tolist(), strict=True)) for one in names
            }
        files = {
            **written,
            "identifiability.csv": table(rows).encode(),
            "identifiability.json": (json.dumps(rows, indent=1) + "\n").encode(),
            "README.md": _readme(name, fit, spec, rows, sentences).encode(),
        }
        if played is not None and (waves := _cogging(fit)):
            files["cogging.csv"] = table(waves).encode()
        return Delivered(files, tuple(sentences), {**facts, "parameters": rows})


URDF, MJCF = ModelFile("urdf", written), ModelFile("mjcf", mjcf)


def _played(
    name: str,
    files: Mapping[str, bytes],
    samples: Samples,
    spec: ArmSpec,
    fit: Identified,
    mean: RigidBodyMean,
) -> Replayed | None:
    """Errors on the logs, if MuJoCo can read the file."""
    return None if name.endswith(".urdf") else replayed(files, samples, spec, fit, mean)


def _played_sentences(name: str, played: Replayed | None, fit: Identified, spec: ArmSpec) -> list[str]:
    if played is None:
        return []
    errors = played.file, played.drives, played.physics
    pairs = zip(spec.names, spec.command_units, *errors, strict=True)
    parts = ", ".join(
        f"{joint} {digits(file)}, {digits(full)} ({digits(by_physics)}) {unit}"
        for joint, unit, file, full, by_physics in pairs
    )
    waves = zip(spec.names, spec.command_units, fit.ripple.tolist(), strict=True)
    cogs = [name for name, terms in fit.joints.items() if terms.cogging]
    ripple = ", ".join(f"{joint} {digits(size)} {unit}" for joint, unit, size in waves if joint in cogs)
    dips = ", ".join(name for name, terms in fit.joints.items() if terms.dip is not None)
    second = [f"cogging, separated from gravity (rms: {ripple})"] * bool(ripple)
    second += [f"Stribeck's dip ({dips})"] * bool(dips)
    return [
        "Errors on the logs of MuJoCo's inverse dynamics of the file, with the drives' terms (and of the "
        f"model's physics): {parts}.",
        f"{with_drives(name)}, for MuJoCo 4, has these terms: {' and '.join(second)}."
        if second
        else "The logs show no cogging and no Stribeck's dip.",
        *(["cogging.csv has the waves of cogging, for other simulators."] * bool(ripple)),
        "frictionloss and damping are the nearest c sign(v) + d v: neither file has friction that depends "
        "on the path or differs by direction, or an offset.",
    ]


def extrapolated(fit: Identified, spec: ArmSpec) -> list[str]:
    """A sentence on joints whose friction was seen at slow speeds only; [] without one."""
    slow = [
        f"{axis.name} {digits(fit.joints[axis.name].fastest)} of {digits(float(limit))} {axis.unit}/s"
        for axis, limit in zip(spec.axes, spec.velocity, strict=True)
        if axis.name in fit.joints and fit.joints[axis.name].fastest < SLOW * limit
    ]
    if not slow:
        return []
    return [
        f"Friction and damping fit the speeds of the logs ({', '.join(slow)}), and are extrapolated beyond."
    ]


def _cogging(fit: Identified) -> list[dict[str, Any]]:
    """A row for each wave of cogging, as a force on the joint."""
    return [
        {"joint": name, "periods": periods, "amplitude": size, "phase": phase, "unit": "N m"}
        for name, terms in fit.joints.items()
        for periods, size, phase in terms.cogging
    ]


def _require_forces(spec: Any) -> None:
    if not isinstance(spec, ArmSpec) or not has_masses(spec):
        raise UsageError(
            f"robot '{spec.name}' has no model file with inertias to write back",
            next_step="Export its friction alone: --to parameters; or the model itself: --to c.",
        )
    if spec.command_unit not in FORCES:
        raise UsageError(
            f"commands of '{spec.name}' are in {spec.command_unit}: inertias in kg m^2 need the motors' "
            "constants",
            next_step="Record torques (N m) instead, or export the model itself: --to c.",
        )


def _rows(fit: Identified) -> list[dict[str, Any]]:
    result, rows = fit.result, []
    for body, place in fit.links.identifiable:
        after, before = (np.sqrt(np.diag(C)[place]) for C in (result.covariance, result.prior))
        for k, name in enumerate(NAMES):
            share = max(0.0, float(1.0 - (after[k] / before[k]) ** 2))
            rows.append(
                {
                    "link": body,
                    "parameter": name,
                    "unit": UNITS[k],
                    "file": float(fit.links.nominal[place][k]),
                    "found": float(result.phi[place][k]),
                    "deviation": float(after[k]),
                    "share": share,
                    "known": identifiability(share),
                }
            )
    return rows


def table(rows: list[dict[str, Any]]) -> str:
    """CSV text; None is an empty cell."""
    lines = [",".join(rows[0])]
    lines += [",".join(map(_cell, row.values())) for row in rows]
    return "\n".join(lines) + "\n"


def _cell(value: Any) -> str:
    return "" if value is None else text_cell(value) if isinstance(value, str) else repr(value)


def _count(rows: list[dict[str, Any]], source: str) -> int:
    return sum(row["known"] == source for row in rows)


def _summary_sentences(fit: Identified, spec: ArmSpec, rows: list[dict[str, Any]]) -> list[str]:
    errors = fit.errors
    sentences = [
        f"Motions can identify {fit.shown} combinations of inertial parameters and armatures; the logs "
        f"measured {fit.measured} of them.",
        f"Of {len(rows)} single inertial parameters {_count(rows, 'measured')} are measured, "
        f"{_count(rows, 'partly')} partly, {_count(rows, 'from the file')} are from the file.",
    ]
    if errors.segments:
        pairs = zip(spec.names, spec.command_units, errors.file, errors.identified, strict=True)
        parts = ", ".join(
            f"{name} {digits(before)} -> {digits(after)} {unit}" for name, unit, before, after in pairs
        )
        sentences.append(f"Error on held-out segments: {parts}.")
        ratios = dict(zip(spec.names, errors.identified / errors.file, strict=True))
        worse = [name for name, ratio in ratios.items() if ratio > 1.0 + NOTHING]
        if worse:
            sentences.append(
                f"On {', '.join(worse)} the file's original inertias predict better: do not use these."
            )
        elif all(ratio > 1.0 - NOTHING for ratio in ratios.values()):
            sentences.append("The file's original inertias predict equally well.")
    else:
        sentences.append(
            "There is only one segment: it is unknown whether these inertias are better than the file's."
        )
    return sentences


def _addition_sentences(name: str, spec: ArmSpec, bodies: Mapping[str, Array]) -> list[str]:
    added = {"tool": spec.tool, "payload": spec.payload, "mounting": spec.mounting}
    carried = [what for what, one in added.items() if one is not None]
    if not carried:
        return []
    if not name.endswith(".urdf"):
        return [f"The additions of robot.toml, {' and '.join(carried)}, are in the file."]
    tables = [f"[{what}] {_attached_text(bodies[what])}" for what in carried if what in bodies]
    beside = f" Its errors are relative to the identified values: {'; '.join(tables)}." if tables else ""
    return [f"The additions of robot.toml, {' and '.join(carried)}, are not in the file, as before.{beside}"]


def _attached_text(phi: Array) -> str:
    """A tool or a payload, as robot.toml states it."""
    mass, centre, inertia = central(phi)
    six = [inertia[i, j] for i, j in PAIRS]
    values = (", ".join(f"{value:.4g}" for value in one) for one in (centre, six))
    return "mass = {:.4g}, centre = [{}], inertia = [{}]".format(mass, *values)


def _lost_motion_sentences(fit: Identified, spec: ArmSpec) -> list[str]:
    """What no model file has."""
    parts = [
        f"{name} {what} {digits(size)} {unit}"
        for name, command_unit, sizes in zip(spec.names, spec.command_units, fit.lost.tolist(), strict=True)
        for what, size, unit in zip(("dead band", "backlash"), sizes, (command_unit, "rad"), strict=True)
        if size
    ]
    return [f"The file has no dead band and no backlash, and the logs show {', '.join(parts)}."] * bool(parts)


def digits(value: float) -> str:
    """A number with three significant digits."""
    return f"{value:#.3g}".removesuffix(".")


def _readme(
    name: str, fit: Identified, spec: ArmSpec, rows: list[dict[str, Any]], conclusions: list[str]
) -> str:
    sentences = "\n".join(f"- {sentence}" for sentence in conclusions)
    possible = all(is_possible(fit.result.phi[place]) for _, place in fit.links.identifiable)
    head = "| link | parameter | unit | file | found | +- (95 %) | known |\n|---|---|---|---|---|---|---|\n"
    lines = "".join(
        f"| {r['link']} | {r['parameter']} | {r['unit']} | {r['file']:.4g} | {r['found']:.4g} "
        f"| {NORMAL_95 * r['deviation']:.2g} | {r['known']} |\n"
        for r in rows
    )
    return f"""# {name}: {spec.name} with identified inertias

{sentences}
- Every link's inertia is physically possible{"" if possible else ": NO, do not use this file"}.
- Only combinations of parameters show in the joints' forces. The other combinations stay as near as possible
  to the model file; `share` in identifiability.csv is the part of a parameter's variance that the logs
  removed (measured: above {MEASURED:g}, partly: above {PARTLY:g}).
- Friction and damping of the joints are written too. Armature, which a URDF has no place for:
  {_armature(fit, spec)}.

m c and I are about the link's own origin, along its axes.

{head}{lines}"""


def _armature(fit: Identified, spec: ArmSpec) -> str:
    pairs = zip(spec.names, armature_units(spec), strict=True)
    parts = [
        f"{name} {digits(fit.joints[name].armature)} {unit}" for name, unit in pairs if name in fit.joints
    ]
    return ", ".join(parts) or "none was found"


def armature_units(spec: ArmSpec) -> list[str]:
    """Of each joint: a slide's rotor moves as a mass."""
    return ["kg" if axis.unit == "m" else "kg m^2" for axis in spec.axes]
