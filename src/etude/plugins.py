"""Plug-ins by name: built-ins first, then entry points of other packages.

A plug-in has a group and a name, or a full name "module:attribute". A plug-in is imported when it is first
named. So a source tree needs no installation, and a broken plug-in affects only its users. A full name may be
typed or passed in Python. If it comes from a file, the file's folder has to be trusted (`trusted_folders`).
Every object is checked against the protocol of its group before it is called.
"""

from __future__ import annotations

import contextlib
import importlib
import inspect
import os
import sys
import traceback
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from etude._runtime.trusted_folders import FULL_NAME as FULL_NAME
from etude._runtime.trusted_folders import OWN, is_trusted, outside_error, require_trusted
from etude.errors import UsageError, did_you_mean

_MEMBERS = ("exact", "fitc", "vfe")
_SPARSE = (
    "dictionary_variance",
    "dictionary_error",
    "thesis_dictionary_variance",
    "thesis_dictionary_error",
    "ssgp_fixed",
    "ssgp_learned",
    "sogp",
    "local_gp",
    "lwpr",
)
_CRITERIA = ("mean_variance", "ivr", "log_ivr", "sum_log", "info_gain", "mi_region", "d_opt")

BUILT_IN: Mapping[str, Mapping[str, str]] = {
    "etude.robots": {
        "arm": "etude_arm.kind:KIND",
        "quadrotor": "etude_quadrotor.kind:KIND",
    },
    "etude.models": {
        **{name: f"etude.models.members:{name}" for name in _MEMBERS},
        **{name: f"etude_sparse.members:{name}" for name in _SPARSE},
        "all_lin": "etude_lagrangian.member:all_lin",
    },
    "etude.kernels": {
        "structured": "etude.models.gp.kernels:structured",
        "ard_se": "etude.models.gp.kernels:ard_se",
        "standing": "etude.models.gp.kernels:standing",
        "gip_lin": "etude_lagrangian.kernel:gip_lin",
    },
    # how posteriors and kernels are stored in a model's file
    "etude.forms": {
        "exact": "etude.models.forms:EXACT",
        "basis": "etude.models.forms:BASIS",
        "spectrum": "etude_sparse.members:SPECTRUM",
        "local": "etude_sparse.members:LOCAL",
        "lwpr": "etude_sparse.members:LWPR",
        "Lagrangian": "etude_lagrangian.kernel:FORM",
    },
    # limits of one's own: `[[limit]]` in a robot file
    "etude.limits": {},
    "etude.criteria": {name: f"etude.design.criteria:{name}" for name in _CRITERIA},
    "etude.readers": {
        "csv": "etude.logs.readers.registry:read_csv",
        "parquet": "etude.logs.readers.registry:read_parquet",
        "rosbag2": "etude.logs.readers.bags:read_bag",
        "ulog": "etude_quadrotor.logs.ulog:read_ulog",
        "mat": "etude.logs.readers.registry:read_mat",
        "lerobot": "etude.logs.readers.lerobot:read_lerobot",
        "crazyflie": "etude_quadrotor.logs.usd_card:read_usd_card",
    },
    "etude.exporters": {
        "ros2": "etude.deploy.exporters.joint_trajectory:MCAP",
        "ros2_sqlite": "etude.deploy.exporters.joint_trajectory:SQLITE",
        "ros2_yaml": "etude.deploy.exporters.joint_trajectory:YAML",
        "ros2_csv": "etude.deploy.exporters.joint_trajectory:PLAYED",
        "px4": "etude_quadrotor.export.offboard:OFFBOARD",
        "crazyflie": "etude_quadrotor.export.poly4d:POLY4D",
        "lerobot": "etude.deploy.exporters.lerobot:LEROBOT",
        "urscript": "etude.deploy.exporters.urscript:E_SERIES",
        "urscript_cb": "etude.deploy.exporters.urscript:CB_SERIES",
    },
    # a model that leaves: `etude export --to`
    "etude.targets": {
        "online": "etude_online.online_folder:ONLINE",
        "urdf": "etude_arm.identified.target:URDF",
        "mjcf": "etude_arm.identified.target:MJCF",
        "joint_limits": "etude_arm.joint_limits:JOINT_LIMITS",
        "c": "etude.deploy.targets.c99.target:C99",
        "ros2": "etude.deploy.targets.ros2.target:ROS2",
        "trajectory": "etude.deploy.targets.trajectory:ALONG",
        "parameters": "etude.deploy.targets.parameters:PARAMETERS",
        "onnx": "etude.deploy.targets.onnx.target:ONNX",
        "px4": "etude_quadrotor.export.autopilot:PX4",
        "crazyflie": "etude_quadrotor.export.autopilot:CRAZYFLIE",
    },
    # robots that `etude run` moves: (joints, address, settings) -> a Stream or a Player of `etude.drivers`
    "etude.drivers": {
        "crazyflie": "etude_drivers.crazyflie:driver",
        "franka": "etude_drivers.franka:driver",
        "lerobot": "etude_drivers.lerobot:driver",
        "mujoco": "etude_drivers.mujoco:driver",
        "px4": "etude_drivers.px4:driver",
        "ros2": "etude_drivers.ros2:driver",
        "ur": "etude_drivers.ur:driver",
    },
    # how a model goes on learning in simulated tests: `etude simulate --online`
    "etude.adaptations": {"online": "etude_online.simulated:online_learning"},
    # the package etude-studies brings them; a bench is a study of the machine: its name begins with "bench_"
    "etude.studies": {},
    # where `etude learn` learns: (workers, cluster, limit in s, say) -> a concurrent.futures.Executor
    "etude.engines": {},
}
"""GROUP -> name -> "module:attribute" of what comes with Étude."""
GROUPS = tuple(BUILT_IN)


NOUNS: Mapping[str, str] = {
    "etude.robots": "kind of robot",
    "etude.models": "member of the model family",
    "etude.kernels": "kernel",
    "etude.forms": "form of stored posteriors or kernels",
    "etude.limits": "limit",
    "etude.criteria": "criterion",
    "etude.readers": "reader of logs",
    "etude.exporters": "format of motions",
    "etude.targets": "target of models",
    "etude.drivers": "driver",
    "etude.adaptations": "method of adaptation",
    "etude.studies": "study",
    "etude.engines": "engine",
}
"""What people call an object of a group."""


@dataclass(frozen=True)
class Shape:
    """Requirements on the objects of a group, as far as they can be checked without a call.

    Attributes:
        words: name for people. arguments: names of its arguments; None: it is not called.
        attributes: required attributes.
        keywords: whether it may need keyword arguments, from its table in a file.
        part: the protocol of its results, in `protocols` with `abilities`; "": none.
    """

    words: str
    arguments: tuple[str, ...] | None = None
    attributes: tuple[str, ...] = ()
    keywords: bool = False
    part: str = ""


SHAPES: Mapping[str, Shape] = {
    "etude.robots": Shape(
        "a kind of robot",
        None,
        ("name", "path", "tables", "presets", "recognises", "described", "spec"),
        part="Kind",
    ),
    "etude.models": Shape("a member of the model family", ("fit",), ("restore",)),
    "etude.kernels": Shape("a kernel's factory", ("columns", "commands")),
    "etude.forms": Shape("a form of stored posteriors or kernels", None, ("arrays", "words", "make")),
    "etude.limits": Shape("a limit's factory", ("spec", "model", "margins"), keywords=True),
    "etude.criteria": Shape("a criterion", ("output", "batch", "gain")),
    "etude.readers": Shape("a reader of logs", ("path", "topics"), ("recognises",), part="Reader"),
    "etude.exporters": Shape("an exporter", ("trajectory", "kind", "spec"), ("back",), part="Exporter"),
    "etude.drivers": Shape("a driver's factory", ("joints", "address", "settings")),
    "etude.adaptations": Shape("a method of adaptation", ("method",)),
    "etude.targets": Shape("a target of models", ("model", "kind", "spec", "options")),
}
"""Requirements by group. Groups without a row (studies) are checked when they are used."""


@dataclass(frozen=True)
class _Reading:
    """The file whose names are looked up at present, and its folder."""

    path: Path
    folder: Path
    identity: str
    command: str


_reading: ContextVar[_Reading | None] = ContextVar("reading", default=None)
_typed_names: set[str] = set()
"""Full names that were typed or passed in Python since the program began: a file may repeat them."""


@contextlib.contextmanager
def named_in(path: Path, folder: Path, identity: str, command: str) -> Iterator[None]:
    """Context in which full names come from a file: `load` raises UsageError if its folder is not trusted.

    path: the file. folder, identity: of its campaign. command: the command that trusts the folder.
    """
    token = _reading.set(_Reading(path, folder, identity, command))
    try:
        yield
    finally:
        _reading.reset(token)


@dataclass(frozen=True)
class Plugin:
    """One row of `etude plugins`.

    Attributes:
        group, name: its key.
        target: "module:attribute".
        source: "etude", or the distribution that brings it and its version.
        problem: why it cannot be used; "" if there is no known problem.
    """

    group: str
    name: str
    target: str
    source: str
    problem: str = ""


def names(group: str) -> tuple[str, ...]:
    """The names in a group, built-ins first. KeyError for a group that does not exist."""
    return tuple(dict.fromkeys(plugin.name for plugin in _plugins_of(group)))


def load(group: str, name: str) -> Any:
    """The object of that name, or of a full "module:attribute".

    Raises:
        UsageError: no such plug-in (with the nearest name), two of one name (with both distributions), one
            that cannot be imported (with the reason), that is no thing of this group, or that a file names
            whose folder is not trusted.
    """
    if FULL_NAME.fullmatch(name):
        return of_group(group, name, named_in_full(name, group))
    require_known(group, name)
    matches = [plugin for plugin in _plugins_of(group) if plugin.name == name]
    if len(matches) > 1:
        raise UsageError(
            f"two plug-ins are named {name!r} ({NOUNS[group]}): of {_sources(matches)}",
            next_step="Uninstall one, or name the one that you want as module:attribute.",
        )
    return of_group(group, name, _imported(matches[0]))


def require_known(group: str, name: str, where: str = "") -> None:
    """UsageError: neither a name in the group nor a "module:attribute". Nothing is imported."""
    if name in BUILT_IN[group] or FULL_NAME.fullmatch(name) or name in names(group):
        return
    known = ", ".join(names(group)) or "none"
    raise UsageError(
        f"there is no {NOUNS[group]} {name!r}",
        where=where,
        next_step=f"{did_you_mean(name, names(group))}Known: {known}; or name it as module:attribute.",
    )


def named_in_full(name: str, group: str = "etude.models") -> Any:
    """The object of "module:attribute", without a check of its type. Errors as `load`."""
    require_word(name, group)
    return _imported(Plugin(group, name, name, "named in full"))


def require_word(name: str, group: str) -> None:
    """UsageError: a file in a folder that is not trusted names this code. Typed names are trusted."""
    reading = _reading.get()
    if reading is None:
        _typed_names.add(name)
    elif name not in _typed_names:
        named = {name: group}
        require_trusted(named, reading.path, reading.folder, reading.identity, reading.command)


def require_inside(paths: Iterable[Path]) -> None:
    """Refuses files outside the folder of the file being read (`named_in`), unless that folder is trusted.

    A robot's file outside of campaigns has no folder of its own: its paths are the word of who typed it.

    Args:
        paths: that the file names; not looked at if the folder is trusted.

    Raises:
        UsageError: names the path and the command that trusts the folder.
    """
    reading = _reading.get()
    if reading is None or not reading.folder.is_dir() or is_trusted(reading.folder, reading.identity):
        return
    for path in paths:
        if not path.resolve().is_relative_to(reading.folder.resolve()):
            raise outside_error(path, reading.path, reading.command)


def of_group(group: str, name: str, value: Any) -> Any:
    """The object itself, if it meets the group's requirements. UsageError: it does not; nothing is called."""
    shape = SHAPES.get(group)
    if shape is None or name in BUILT_IN[group]:
        return value
    missing = [attribute for attribute in shape.attributes if not hasattr(value, attribute)]
    fault = f"it has no {', '.join(missing)}" if missing else ""
    if not missing and shape.arguments is not None and not _takes(value, shape):
        fault = f"it is not called with ({', '.join(shape.arguments)})"
    if fault and inspect.isclass(value) and any("__call__" in vars(kind) for kind in value.__mro__):
        raise UsageError(
            f"{name} is a class; name an instance: {name.split(':')[-1]} = {value.__name__}()",
            where=f"{group}, {value.__module__}",
            next_step="Write that line into its module, and name that object.",
        )
    if fault:
        raise UsageError(
            f"{name} is not {shape.words}: {fault}",
            where=f"{group}; it is of type {type(value).__name__}",
            next_step="docs/plugins.md describes the plug-ins of this group; etude plugins lists them.",
        )
    require_whole(value, shape.part, f"{group} {name}")
    return _guarded(value, shape.part, name) if shape.part else value


def _guarded(value: Any, part: str, name: str) -> Any:
    """An object of another package, wrapped: a result of a wrong type raises an error."""
    from etude.plugin_values import guarded, is_own, sizes_of  # built-ins are loaded without it

    if is_own(value):
        return value
    return guarded(value, part, name, sizes_of(value) if part == "Kind" else None)


def _takes(value: Any, shape: Shape) -> bool:
    try:
        signature = inspect.signature(value)
        bind = signature.bind_partial if shape.keywords else signature.bind
        bind(*[None] * len(shape.arguments or ()))
    except (TypeError, ValueError):  # not a function, other arguments, or no known signature
        return False
    return True


def required(value: Any, protocol: type, where: str) -> Any:
    """The object itself. UsageError: it lacks members of a protocol. where: its place."""
    if value is None:
        raise UsageError(
            f"it returned nothing instead of a {protocol.__name__}",
            where=where,
            next_step=f"Return what etude.protocols.{protocol.__name__} declares; perhaps a return is "
            "missing.",
        )
    from etude.protocols import members  # few commands need the protocols

    missing = [name for name in members(protocol) if not hasattr(value, name)]
    if missing:
        raise UsageError(
            f"{type(value).__name__} lacks {', '.join(missing)} of the protocol {protocol.__name__}",
            where=where,
            next_step=f"Add what etude.protocols.{protocol.__name__} declares.",
        )
    require_whole(value, protocol.__name__, where)
    return value


def require_whole(value: Any, part: str, where: str) -> None:
    """UsageError: it has some members of an optional ability of that part (`abilities`) and lacks others."""
    from etude.abilities import ABILITIES  # few commands need the protocols
    from etude.protocols import members

    for ability in ABILITIES.get(part, ()):
        declared = members(ability)
        missing = [name for name in declared if not hasattr(value, name)]
        if 0 < len(missing) < len(declared):
            has = [name for name in declared if name not in missing]
            raise UsageError(
                f"{type(value).__name__} has {', '.join(has)} and lacks {', '.join(missing)}",
                where=where,
                next_step=f"Add all members that etude.abilities.{ability.__name__} declares, or none of "
                "them.",
            )


def listed(*, tried: bool = False) -> tuple[Plugin, ...]:
    """All plug-ins, group by group.

    Args:
        tried: import plug-ins outside of the core to report failures; else report earlier failures.
    """
    return tuple(_with_problem(plugin, tried) for group in GROUPS for plugin in _plugins_of(group))


def _with_problem(plugin: Plugin, tried: bool) -> Plugin:
    twins = [p for p in _plugins_of(plugin.group) if p.name == plugin.name]
    if len(twins) > 1:
        return replace(plugin, problem=f"the name is used twice: by {_sources(twins)}")
    if tried and not plugin.target.startswith("etude."):
        try:
            of_group(plugin.group, plugin.name, _imported(plugin))
        except UsageError as error:
            return replace(plugin, problem=error.fact)
    return replace(plugin, problem=_failures.get(plugin.target, ""))


def _plugins_of(group: str) -> Sequence[Plugin]:
    built_in = [Plugin(group, name, target, "etude") for name, target in BUILT_IN[group].items()]
    # a distribution may repeat a row of the table as an entry point: that is the same plug-in
    return [*built_in, *(p for p in _installed(group) if BUILT_IN[group].get(p.name) != p.target)]


@cache
def _installed(group: str) -> tuple[Plugin, ...]:
    """Plug-ins of other distributions, each once, even if its folder is on the path several times."""
    from importlib.metadata import entry_points

    plugins = {}
    for point in sorted(entry_points(group=group), key=lambda p: (p.name, p.value)):
        source = f"{point.dist.name} {point.dist.version}" if point.dist else "an unknown distribution"
        target = point.value.split("[")[0].strip()
        plugins[point.name, target, source] = Plugin(group, point.name, target, source)
    return tuple(plugins.values())


_failures: dict[str, str] = {}
_places: dict[str, str] = {}
"""Loaded plug-ins of other packages: the module's file, or the folder of its package -> its target."""


def raised_in(error: BaseException) -> tuple[str, str] | None:
    """The plug-in in whose code an error arose, and its line "FILE:N"; None if none took part.

    An error raised in NumPy is due to the plug-in that called it, so the plug-in's last line is returned.
    """
    origin = None
    for frame in traceback.extract_tb(error.__traceback__):
        for place, target in _places.items():
            if frame.filename == place or frame.filename.startswith(f"{place}{os.sep}"):
                origin = target, f"{frame.filename}:{frame.lineno}, in {frame.name}"
    return origin


def _imported(plugin: Plugin) -> Any:
    """The object of a target. A plug-in may raise any error; the reason is stored for `listed`."""
    module, _, path = plugin.target.partition(":")
    try:
        value: Any = importlib.import_module(module)
    except (Exception, SystemExit) as error:  # a module that ends the program as it is loaded is broken too
        raise _not_loaded(plugin, error, _import_advice(plugin, module, error)) from error
    for part in path.split("."):
        try:
            value = getattr(value, part)
        except Exception as error:
            advice = f"{did_you_mean(part, dir(value))}Correct the name after the colon."
            raise _not_loaded(plugin, error, advice) from error
    _failures.pop(plugin.target, None)
    _note_place(module, plugin.target)
    return value


def _note_place(module: str, target: str) -> None:
    package = sys.modules[module.partition(".")[0]]
    if package.__name__ in OWN:
        return
    folder = next(iter(getattr(package, "__path__", ())), None)
    place = folder or getattr(package, "__file__", None)
    if place:
        _places[place] = target


def _not_loaded(plugin: Plugin, error: BaseException, advice: str) -> UsageError:
    """The error for a user; its reason is stored for `listed`."""
    reason = f"{type(error).__name__}: {error}"
    _failures[plugin.target] = reason
    return UsageError(
        f"the {NOUNS[plugin.group]} {plugin.name!r} cannot be loaded: {reason}",
        where=f"{plugin.target} ({plugin.source})",
        next_step=advice,
    )


def _import_advice(plugin: Plugin, module: str, error: BaseException) -> str:
    """Next step after a failed import. Python does not find a file beside the campaign without PYTHONPATH."""
    if isinstance(error, ModuleNotFoundError) and module.split(".")[0] == error.name:
        folder = f"the folder of {error.name}.py: PYTHONPATH=FOLDER etude ..."
        hint = did_you_mean(error.name, names(plugin.group))
        return f"{hint}If not, name {folder}" if hint else f"Install it, or name {folder}"
    return "Install its requirements, or repair it; etude plugins lists all plug-ins."


def _sources(matches: Sequence[Plugin]) -> str:
    return " and ".join(plugin.source for plugin in matches)
