"""`etude export --to parameters`: base parameters and friction with 95 % intervals, tables and C."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from etude.models.accuracy import NORMAL_95
from etude.protocols import Physics
from etude.types import Array, Delivered, Samples
from etude_arm.config import ArmData
from etude_arm.identified.combinations import (
    MEASURED,
    PARTLY,
    Combination,
    combinations,
    identifiability,
    share_of,
)
from etude_arm.identified.friction_alone import LEAST_TURNS, friction_alone
from etude_arm.identified.parameter_fit import (
    BACKLASH_TERM,
    DEAD_BAND,
    DELAY,
    SHOWN,
    STRIBECK,
    TERMS,
    Friction,
    ParameterFit,
    parameter_fit,
    settled,
)
from etude_arm.identified.target import NAMES, UNITS, armature_units, digits, table
from etude_arm.inputs import friction_speeds
from etude_arm.loading.load import load_arm
from etude_arm.physics.mean import RigidBodyMean
from etude_arm.spec import FORCES, ArmSpec

HARDLY = 0.5
"""Part of the delay's prior deviation that is left."""
TERM_UNITS = ("{u} s^2/{x}", "{u} s/{x}", "{u}", "{u}", "1", "{u} s/{x}", "{u}", "{u}", "{x}")


def report(spec: ArmSpec, physics: Physics | None, samples: Samples, data: ArmData) -> Delivered:
    """Tables, sentences and friction.h; only friction for a robot without masses in a model file."""
    if physics is None:
        v0 = friction_speeds(spec, data.friction_fraction or ArmData.friction_fraction)
        friction = friction_alone(spec, samples, v0, desired=data.desired)
        return _delivered(spec, [], friction, [WITHOUT, *_interval_sentences(friction, spec)])
    mean = physics(samples)
    assert isinstance(mean, RigidBodyMean)
    fit = parameter_fit(settled(samples, spec, mean))
    inertial = _inertial_rows(fit, spec)
    sentences = [
        *_inertial_sentences(fit, spec, inertial),
        *_delay_sentences(fit),
        *_dead_band_sentences(fit.friction, spec),
    ]
    return _delivered(spec, inertial, fit.friction, sentences)


def _delivered(
    spec: ArmSpec, inertial: list[dict[str, Any]], friction: Friction, lines: Sequence[str]
) -> Delivered:
    rows = _friction_rows(friction, spec)
    sentences = [*lines, *_friction_sentences(friction, spec, rows)]
    files = {
        "parameters.csv": table([_flat(row) for row in inertial]) if inertial else "",
        "parameters.json": json.dumps(inertial, indent=1) + "\n",
        "friction.csv": table(rows),
        "friction.json": json.dumps(rows, indent=1) + "\n",
        "friction.h": friction_c(friction, spec),
        "README.md": _readme(spec, sentences, inertial, rows),
    }
    encoded = {name: text.encode() for name, text in files.items() if text}
    return Delivered(encoded, tuple(sentences), {"parameters": inertial, "friction": rows})


def _names(spec: ArmSpec) -> list[tuple[str, str, str]]:
    """Link or joint, parameter and unit of every theta."""
    loaded = load_arm(spec, shapes=False, drives=True)
    model = loaded.model()
    bodies = [str(model.body(b).name) for b in range(1, model.nbody)]
    links = [loaded.links.get(body, body) for body in bodies]
    inertial = [(link, name, unit) for link in links for name, unit in zip(NAMES, UNITS, strict=True)]
    rotors = zip(spec.names, armature_units(spec), strict=True)
    return [*inertial, *((name, "armature", unit) for name, unit in rotors)]


def _inertial_rows(fit: ParameterFit, spec: ArmSpec) -> list[dict[str, Any]]:
    """Base parameters, then parameters that affect no command; empty if no command is a force."""
    if fit.own_scale.all():
        return []
    names = _names(spec)
    bases, silent = combinations(fit)
    rows = [_base_row(fit, one, names) for one in bases]
    for place in silent:
        link, name, unit = names[place]
        empty = dict.fromkeys(("lower", "upper", "deviation"))
        row = {"parameter": f"{link} {name}", "value": float(fit.nominal[place]), **empty, "unit": unit}
        rows.append({**row, "file": float(fit.nominal[place]), "known": "not identifiable", "parts": []})
    return rows


def _base_row(fit: ParameterFit, one: Combination, names: Sequence[tuple[str, str, str]]) -> dict[str, Any]:
    weights = one.row(len(fit.theta))
    value, file = float(weights @ fit.theta), float(weights @ fit.nominal)
    parts = [(*names[place][:2], factor) for place, factor in one.parts]
    return {
        "parameter": "".join(_part(*part, first=not k) for k, part in enumerate(parts)),
        "value": value,
        **_interval(value, float(np.sqrt(weights @ fit.after @ weights))),
        "unit": names[one.parts[0][0]][2],
        "file": file,
        "known": identifiability(share_of(fit, one)),
        "parts": [{"of": of, "parameter": name, "factor": factor} for of, name, factor in parts],
    }


def _part(of: str, name: str, factor: float, *, first: bool) -> str:
    """As " + 0.4 fore mass"."""
    size = "" if abs(abs(factor) - 1.0) < 1e-9 else f"{abs(factor):.4g} "
    sign = "" if first else " - " if factor < 0.0 else " + "
    return f"{sign}{size}{of} {name}"


def _flat(row: Mapping[str, Any]) -> dict[str, Any]:
    """The row without its members, which are in the text of the combination."""
    return {key: value for key, value in row.items() if key != "parts"}


def _interval(value: float, deviation: float) -> dict[str, Any]:
    return {
        "lower": value - NORMAL_95 * deviation,
        "upper": value + NORMAL_95 * deviation,
        "deviation": deviation,
    }


def _friction_rows(fit: Friction, spec: ArmSpec) -> list[dict[str, Any]]:
    """The terms of each drive but its armature; one that the logs do not show has no interval."""
    rows = []
    for j, (axis, unit) in enumerate(zip(spec.axes, spec.command_units, strict=True)):
        for k, term in enumerate(TERMS[1:], start=1):
            value, deviation = float(fit.terms[j, k]), float(fit.deviation[j, k])
            shown = deviation > 0.0 and bool(fit.evidence[j, k] > SHOWN)
            # a dip that is not shown goes with v_s and v0, a backlash with those of other joints
            has_interval = shown if k in (STRIBECK, BACKLASH_TERM) else deviation > 0.0
            rows.append(
                {
                    "joint": axis.name,
                    "term": term,
                    "value": value,
                    **(
                        _interval(value, deviation)
                        if has_interval
                        else dict.fromkeys(("lower", "upper", "deviation"))
                    ),
                    "unit": TERM_UNITS[k].format(u=unit, x=axis.unit),
                    "evidence_nats": float(fit.evidence[j, k]),
                    "shown": shown,
                }
            )
    return rows


def friction_c(fit: Friction, spec: ArmSpec) -> str:
    """A C function of the friction."""
    name, J = _plain(spec.name), spec.dof
    name = f"n_{name}" if name[:1].isdigit() else name
    pairs = zip(spec.names, spec.command_units, strict=True)
    units = ", ".join(f"{_plain(joint)} {unit}" for joint, unit in pairs)
    columns = [*fit.terms[:, 1:6].T, fit.stribeck_speed, fit.v0, fit.terms[:, DEAD_BAND]]
    rows = ",\n".join(
        f"        {{{', '.join(repr(float(x)) for x in row)}}}" for row in np.transpose(columns)
    )
    return f"""/* Friction of {name}, identified by Etude, in the units of the commands: {units}.
   qd: of the drives, rad/s (m/s). load: of the rigid body (gravity, inertia), or 0. */
#include <math.h>

static void {name}_friction(const double qd[{J}], const double load[{J}], double friction[{J}])
{{
    /* viscous, coulomb, stribeck, load, asymmetry, speed of stribeck, speed over which friction turns,
       dead band */
    static const double p[{J}][8] = {{
{rows}}};
    for (int j = 0; j < {J}; ++j) {{
        const double v = qd[j], s = tanh(v / p[j][6]), slow = v / p[j][5];
        const double level = p[j][1] + p[j][2] * exp(-slow * slow) + p[j][3] * fabs(load[j]);
        friction[j] = p[j][0] * v + level * s + p[j][4] * fabs(v);
        const double whole = load[j] + friction[j];
        friction[j] += p[j][7] * ((whole > 0.0) - (whole < 0.0));
    }}
}}
"""


def _plain(name: str) -> str:
    """With letters, digits and _ of ASCII alone, which every C compiler takes."""
    return re.sub(r"[^A-Za-z0-9_]", "_", name)


def _inertial_sentences(fit: ParameterFit, spec: ArmSpec, inertial: list[dict[str, Any]]) -> list[str]:
    """Sentences on the inertial parameters."""
    if not inertial:
        return [f"Commands are in {spec.command_unit}, so masses need the motors' constants."]
    counts = [sum(row["known"] == word for row in inertial) for word in KNOWN]
    base = len(inertial) - counts[-1]
    parts = ", ".join(f"{n} {word}" for n, word in zip(counts, KNOWN, strict=True) if n)
    sentences = [f"Motions can identify {base} combinations of {len(fit.theta)} parameters: {parts}."]
    if fit.own_scale.any():
        others = [name for name, is_own in zip(spec.names, fit.own_scale, strict=True) if is_own]
        sentences.append(f"The commands of {', '.join(others)} have another scale, so they identify no mass.")
    return sentences


def _delay_sentences(fit: ParameterFit) -> list[str]:
    """A sentence on the delay of commands, if the logs determine it."""
    value, deviation = 1e3 * np.array(fit.delay)
    is_known = deviation < 1e3 * HARDLY * DELAY
    return [f"Commands act {value:.1f} +- {NORMAL_95 * deviation:.1f} ms after they are logged."] * bool(
        is_known
    )


def _dead_band_sentences(friction: Friction, spec: ArmSpec) -> list[str]:
    """A sentence on joints with an undecided dead band, for commands that are not forces."""
    nats = np.abs(friction.evidence[:, DEAD_BAND])
    names = [name for name, size in zip(spec.names, nats.tolist(), strict=True) if size < SHOWN]
    sentence = (
        f"The logs do not determine the dead band of {', '.join(names)}: Coulomb friction contains one."
    )
    return [sentence] * bool(names and spec.command_unit not in FORCES)


def _friction_sentences(fit: Friction, spec: ArmSpec, rows: list[dict[str, Any]]) -> list[str]:
    shown = {(row["joint"], row["term"]) for row in rows if row["shown"]}
    return [
        f"Friction of {name}: {_friction_text(fit.terms[j], fit.deviation[j], unit, name, shown)}."
        for j, (name, unit) in enumerate(zip(spec.names, spec.command_units, strict=True))
    ]


WITHOUT = (
    "No model file states masses, so only friction is identified, as the part that changes its sign with "
    "the speed. Armature, friction by load and by direction, offset, dead band and backlash are not "
    "reported."
)


def _interval_sentences(friction: Friction, spec: ArmSpec) -> list[str]:
    """A sentence on joints whose terms have no interval."""
    without_interval = np.any(friction.terms, axis=1) & ~np.any(friction.deviation, axis=1)
    names = [name for name, one in zip(spec.names, without_interval.tolist(), strict=True) if one]
    few = f"fewer than {LEAST_TURNS} reversals in the logs do not separate friction from gravity"
    return [f"No interval is stated for {', '.join(names)}: {few}. Ingest a log with more."] * bool(names)


KNOWN = ("measured", "partly", "from the file", "not identifiable")


def _friction_text(terms: Array, deviation: Array, unit: str, joint: str, shown: set[tuple[str, str]]) -> str:
    named = [
        f"{term} {digits(terms[k])} +- {NORMAL_95 * deviation[k]:.2g}"
        for k, term in enumerate(TERMS)
        if (joint, term) in shown
    ]
    return f"{', '.join(named)} ({unit}, s)" if named else "the logs show no term"


def _readme(
    spec: ArmSpec, lines: list[str], inertial: list[dict[str, Any]], friction: list[dict[str, Any]]
) -> str:
    sentences = "\n".join(f"- {sentence}" for sentence in lines)
    bases = "".join(
        f"| {row['parameter']} | {row['value']:.4g} | {_range(row)} | {row['unit']} | {row['file']:.4g} "
        f"| {row['known']} |\n"
        for row in inertial
    )
    terms = "".join(
        f"| {row['joint']} | {row['term']} | {row['value']:.4g} | {_range(row)} | {row['unit']} "
        f"| {row['evidence_nats']:.1f} | {'yes' if row['shown'] else 'no'} |\n"
        for row in friction
    )
    return f"""# Parameters of {spec.name}, with 95 % intervals

{sentences}
- measured: the logs removed {MEASURED:.0%} of the variance of the file's value, partly: {PARTLY:.0%}.
- m c and I are about the link's own origin, along its axes. Armature and friction are those at the drives.
- friction.h is the friction as a C function, with the speeds of Stribeck's dip and the dead band.
- Dead band: the largest command that makes no torque. Backlash: between encoder and link. Logs cannot show
  one between motor and encoder.
- Evidence: nats for the term against none; a term is shown above {SHOWN:g}.

| parameter | value | 95 % | unit | file | known |
|---|---|---|---|---|---|
{bases}
| joint | term | value | 95 % | unit | evidence | shown |
|---|---|---|---|---|---|---|
{terms}"""


def _range(row: Mapping[str, Any]) -> str:
    return "" if row["lower"] is None else f"{row['lower']:.4g} to {row['upper']:.4g}"
