"""etude doctor, etude plugins"""

from __future__ import annotations

import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

from etude import __version__
from etude.cli.entrance import OWN_ENVIRONMENT, conflict
from etude.cli.outcome import Common, Outcome, Say

if TYPE_CHECKING:
    from etude.plugins import Plugin


@dataclass(frozen=True, kw_only=True)
class Doctor(Common):
    """Check what this machine has for Étude: versions, threads, compilers, extras, a browser, folders.

    Exit code 1: something that Étude needs is missing.
    """

    def run(self, _: Say) -> Outcome:

        checks = examined()
        first = max(len(one.name) for one in checks)
        lines = [f"{one.sign:<6} {one.name:<{first}}  {one.sentence}" for one in checks]
        needed = [one for one in checks if one.light == "red"]
        lines += [
            "",
            "Something that Étude needs is missing."
            if needed
            else "Everything that Étude needs is installed.",
        ]
        data = {"checks": [asdict(one) for one in checks], "ok": not needed}
        return Outcome("\n".join(lines), data, 1 if needed else 0)


SIGNS = {"green": "ok", "yellow": "none", "red": "WRONG"}
TOOLS: Mapping[str, str] = {
    "gcc": "compiles exported C files for a test",
    "clang": "a second compiler for exported C",
    "cmake": "builds exports from their CMakeLists.txt",
}
EXTRAS_NOT_OF_USERS = ("test", "docs")
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "firefox")
ANSWER_S = 10.0
"""A compiler that takes longer to print its version counts as broken."""


@dataclass(frozen=True)
class Check:
    """Result of one check.

    Attributes:
        name: of it. light: "green", "yellow" (it is optional, and not there), "red" (Étude needs it).
        sentence: what was found, or what to do.
    """

    name: str
    light: str
    sentence: str

    @property
    def sign(self) -> str:
        """For people."""
        return SIGNS[self.light]


def examined() -> list[Check]:
    """All checks, required ones first."""
    return [*versions(), *threads(), *places(), *compilers(), browser(), *extras()]


def versions() -> list[Check]:
    """Versions of Étude, Python and every required library."""
    system = f"{platform.system()} {platform.machine()}"
    checks = [
        Check("etude", "green", f"{__version__}, Python {platform.python_version()}, {system}"),
        *_name(),
    ]
    for library in _libraries(""):
        try:
            checks.append(Check(library, "green", metadata.version(library)))
        except metadata.PackageNotFoundError:
            checks.append(Check(library, "red", f"not installed: pip install {library}"))
    return checks


def _name() -> list[Check]:
    """A red check if another distribution has files in the package `etude`."""
    clash = conflict()
    return [Check("name", "red", f"{clash}. {OWN_ENVIRONMENT}")] if clash else []


def threads() -> list[Check]:
    """Usable cores, and thread pools of BLAS."""
    import numpy as np
    import scipy.linalg  # noqa: F401 - brings a library of its own
    from threadpoolctl import threadpool_info

    np.linalg.inv(np.eye(2))
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    limits = [f"{name}={os.environ[name]}" for name in sorted(os.environ) if name.endswith("_NUM_THREADS")]
    pools = {
        f"{p['internal_api']} {p['version']}, {p['num_threads']} thread{'s' * (p['num_threads'] > 1)}"
        for p in threadpool_info()
        if p["user_api"] == "blas"
    }
    return [
        Check("cores", "green", f"{usable} usable{''.join(f', {limit}' for limit in limits)}"),
        Check("BLAS", "green", "; ".join(sorted(pools)) or "unknown to threadpoolctl"),
    ]


def places() -> list[Check]:
    """Whether campaigns and compiled code can be written here."""
    here = Path.cwd()
    folder_check = Check("this folder", "green", f"can be written: {here}")
    if not _writable(here):
        folder_check = Check(
            "this folder", "yellow", f"cannot be written: {here}; use another folder for campaigns"
        )
    cache = _cache_folder()
    if cache is None:
        sentence = (
            "no writable folder for compiled code, so every command compiles again; set NUMBA_CACHE_DIR"
        )
        return [folder_check, Check("numba cache", "yellow", sentence)]
    return [folder_check, Check("numba cache", "green", f"in {cache}")]


def compilers() -> list[Check]:
    """C compilers, for exported models."""
    checks = []
    for tool, what in TOOLS.items():
        path = shutil.which(tool)
        version = _version_of(path) if path else ""
        if version:
            checks.append(Check(tool, "green", version))
        else:
            checks.append(Check(tool, "yellow", f"{'does not run' if path else 'not installed'}: {what}"))
    return checks


def browser() -> Check:
    """Browser for reports."""
    there = next((name for name in BROWSERS if shutil.which(name)), "")
    if there or sys.platform in ("darwin", "win32"):
        return Check("browser", "green", there or "the system's")
    return Check(
        "browser",
        "yellow",
        "none on this machine; report.html opens on any other machine without further files",
    )


def extras() -> list[Check]:
    """Each extra, with the command that installs it."""
    checks = []
    for extra in sorted(set(_metadata_lines("Provides-Extra")) - set(EXTRAS_NOT_OF_USERS)):
        missing = [
            requirement for requirement in _requirements(extra) if not _is_installed(_name_of(requirement))
        ]
        if missing:
            # by the libraries' names: the extra's would fetch a stranger's package, docs/decisions/0048
            quoted = " ".join(f"'{requirement}'" for requirement in missing)
            sentence = (
                f"{', '.join(_name_of(requirement) for requirement in missing)} missing: pip install {quoted}"
            )
            checks.append(Check(f"extra {extra}", "yellow", sentence))
        else:
            checks.append(Check(f"extra {extra}", "green", ", ".join(_libraries(extra))))
    return checks


def _libraries(extra: str) -> list[str]:
    """Libraries that the package requires: those of one extra; "": always."""
    return [_name_of(line) for line in _requirements(extra)]


def _requirements(extra: str) -> list[str]:
    """These libraries with version bounds for pip: "rosbags>=0.10.9"."""
    requirements = []
    for line in _metadata_lines("Requires-Dist"):
        match = re.search(r"extra == ['\"]([\w-]+)['\"]", line)
        if (match[1] if match else "") == extra:
            requirements.append(line.partition(";")[0].replace(" ", ""))
    return requirements


def _name_of(requirement: str) -> str:
    named = re.match(r"[\w.-]+", requirement)
    return named[0] if named else requirement


def _metadata_lines(what: str) -> list[str]:
    """Lines of the installed package's metadata; none where it runs from its sources alone."""
    try:
        return [str(line) for line in metadata.metadata("etude").get_all(what) or ()]
    except metadata.PackageNotFoundError:
        return []


def _is_installed(library: str) -> bool:
    try:
        metadata.version(library)
    except metadata.PackageNotFoundError:
        return False
    return True


def _version_of(path: str) -> str:
    try:
        done = subprocess.run(
            [path, "--version"], capture_output=True, text=True, check=True, timeout=ANSWER_S
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.partition("\n")[0].strip()


def _writable(folder: Path) -> bool:
    """Whether a file can be written; permissions would not reveal full or read-only disks."""
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _cache_folder() -> Path | None:
    """Cache folder of numba, by its own rules: NUMBA_CACHE_DIR, beside the source, or the user's."""
    import etude

    beside = Path(etude.__file__).parent / "__pycache__"
    configured = os.environ.get("NUMBA_CACHE_DIR")
    candidates = [Path(configured)] if configured else [beside, Path.home() / ".cache"]
    return next((folder for folder in candidates if folder.is_dir() and _writable(folder)), None)


@dataclass(frozen=True, kw_only=True)
class Plugins(Common):
    """List what can be replaced: robots, models, kernels, criteria, readers, exporters and studies."""

    def run(self, _: Say) -> Outcome:
        from etude.plugins import GROUPS, listed

        plugins = listed(tried=True)
        lines = []
        for group in GROUPS:
            rows = [_row(plugin) for plugin in plugins if plugin.group == group]
            lines += [group, *(_columns(rows) or ["  none yet"]), ""]
        lines += _problems(plugins)
        return Outcome("\n".join(lines).rstrip(), {"plugins": [asdict(plugin) for plugin in plugins]})


def _row(plugin: Plugin) -> tuple[str, str, str]:
    """Cells of a plug-in: name, object, and its package if that is another one."""
    source = "" if plugin.source == "etude" else f"({plugin.source})"
    return f"{plugin.name}{' (!)' if plugin.problem else ''}", plugin.target, source


def _columns(rows: Sequence[tuple[str, str, str]]) -> list[str]:
    """Rows as lines with aligned columns."""
    first, second = (max((len(row[i]) for row in rows), default=0) for i in (0, 1))
    return [f"  {name:<{first}}  {target:<{second}}  {source}".rstrip() for name, target, source in rows]


def _problems(plugins: Sequence[Plugin]) -> list[str]:
    return [f"(!) {p.name} of {p.group} ({p.source}): {p.problem}." for p in plugins if p.problem]
