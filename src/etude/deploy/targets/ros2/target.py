"""`etude export --to ros2`: a chainable feedforward controller of ros2_control, as a package of source."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from typing import Any

from etude._runtime.options import taken
from etude.deploy.feedforward import require_forces
from etude.deploy.model_states import outside_training_sentence
from etude.deploy.targets.c99.header import CForm
from etude.deploy.targets.c99.plan import Plan
from etude.deploy.targets.c99.target import Files, Timing, checked_files
from etude.errors import UsageError
from etude.protocols import Kind
from etude.types import Channel, Delivered

ORDERS = ("position", "velocity", "acceleration")
PLANNED = "_des"
EFFORT = "effort"
OTHER = "Name the hardware's command interface: --set interface=NAME."
PLACES = {
    "package.xml": "package.xml",
    "CMakeLists.txt": "CMakeLists.txt",
    "plugin.xml": "plugin.xml",
    "README.md": "README.md",
    "controllers.yaml": "config/controllers.yaml",
    "feedforward.hpp": "include/@PACKAGE@/feedforward.hpp",
    "feedforward.cpp": "src/feedforward.cpp",
}
"""Templates, and where they stand in the package."""


@dataclass(frozen=True)
class Ros2Options:
    """See `commands.export`; interface: of the hardware that takes commands."""

    fade: bool = True
    single: bool = False
    rate: float | None = None
    name: str = ""
    interface: str = EFFORT
    model_hash: str = ""


def ROS2(model: Any, kind: Kind, spec: Any, options: Mapping[str, Any]) -> Delivered:
    """The target (`protocols.Target`).

    Raises:
        UsageError: unknown options, a robot that is not one of joints, commands that are no efforts, or what
            has no C.
    """
    settings = taken(options, Ros2Options, "ros2")
    form = CForm(False, fade=settings.fade, digest=settings.model_hash)
    timing = Timing(settings.rate, spec.rate)
    made, sentences, facts = checked_files(model, kind, spec, form, settings.name, settings.single, timing)
    sources = _sources(made.plan, kind, spec)
    if settings.interface == EFFORT:
        for unit in made.plan.units:
            require_forces(unit, spec.name, OTHER)
    substitutions = _substitutions(made, spec, sources, settings)
    package = substitutions["PACKAGE"]
    files = {
        place.replace("@PACKAGE@", package): _filled(name, substitutions) for name, place in PLACES.items()
    }
    files |= {_place(name, package): data for name, data in made.files.items() if name != "CMakeLists.txt"}
    named = f"Package {package}, for ROS 2 Jazzy and later; not for Humble. Its README.md describes its use."
    return Delivered(files, (named, *sentences), {**facts, "package": package})


def _place(name: str, package: str) -> str:
    if name.endswith(".h"):
        return f"include/{package}/{name}"
    return f"test/{name}" if name.endswith("_test.c") else f"src/{name}"


def _sources(plan: Plan, kind: Kind, spec: Any) -> list[int]:
    """Of each number that the model reads, which of the references it is: positions of all joints first."""
    channels = {channel.name: channel for channel in kind.channels(spec)}
    joints = channels[kind.path].parts
    if joints != tuple(plan.model.commands):
        raise UsageError(
            f"ros2_control commands joints by name, and {spec.name!r} is commanded by "
            f"{', '.join(plan.model.commands)}, moved along {', '.join(joints)}",
            next_step="Export --to c, and call it where you command these.",
        )
    return [_order(channel, channels, kind.path) * len(joints) + part for channel, part in plan.parts]


def _order(channel: Channel, channels: Mapping[str, Channel], path: str) -> int:
    """How often the path was derived to give that channel, planned or measured."""
    name, order = channel.name.removesuffix(PLANNED), 0
    while name != path:
        if not name or order == len(ORDERS) - 1:
            raise UsageError(
                f"the model reads {channel.name}, which ros2_control references do not contain",
                next_step="Train it on position, velocity and acceleration alone, or export --to c.",
            )
        name, order = channels[name].derivative_of, order + 1
    return order


def _filled(template: str, substitutions: Mapping[str, str]) -> bytes:
    place = resources.files("etude.deploy.targets.ros2").joinpath("package", template)
    return re.sub(
        r"@(\w+)@", lambda match: substitutions[match[1]], place.read_text(encoding="utf-8")
    ).encode()


def _substitutions(made: Files, spec: Any, sources: list[int], settings: Ros2Options) -> dict[str, str]:
    plan, joints = made.plan, list(made.plan.model.commands)
    package = f"{plan.name.lower()}_feedforward"
    unit = " or ".join(dict.fromkeys(unit or "1" for unit in plan.units))
    operations = plan.operations(made.form.deviations, made.form.fade)
    rate, remembered = float(settings.rate or spec.rate), plan.rate
    return {
        "PACKAGE": package,
        "GUARD": f"{package.upper()}__FEEDFORWARD_HPP_",
        "NAME": plan.name,
        "UPPER": plan.name.upper(),
        "ROBOT": re.sub(r"[<>&]", " ", spec.name),
        "HASH": settings.model_hash[:12] or "without a file",
        "INTERFACE": settings.interface,
        "UNIT": unit,
        "JOINTS": ", ".join(_quoted(name) for name in joints),
        "YAML_JOINTS": ", ".join(_quoted(name) for name in joints),
        "CHAINED": ", ".join(_quoted(f"learned_feedforward/{name}") for name in joints),
        "ZEROS": ", ".join("0.0" for _ in joints),
        "SOURCES": ", ".join(map(str, sources)),
        "RATE": f"{max(rate, remembered):.0f}",
        "OPERATIONS": f"{operations:,}",
        "TIME": f", some {operations / 1e3:,.0f} us where a core does 1e9 a second",
        "MEMORY": _memory(remembered),
        "FADED": _sentence(outside_training_sentence(plan.model)) if made.form.fade else _BARE,
        "TABLE": _table(plan),
    }


_BARE = "Commands are the posterior mean everywhere: exported with --no-fade."


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}"


def _memory(rate: float) -> str:
    if not rate:
        return " It has no memory, so any rate is possible."
    return f" It has a memory of the motion for friction: update it at least {rate:g} times a second."


def _quoted(name: str) -> str:
    return '"' + name.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _table(plan: Plan) -> str:
    lines = ["| joint | least | most | unit |", "|---|---|---|---|"]
    for j, name in enumerate(plan.model.commands):
        lines.append(f"| {name} | {plan.least[j]:.6g} | {plan.most[j]:.6g} | {plan.units[j] or '1'} |")
    return "\n".join(lines)
