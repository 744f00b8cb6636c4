"""What the files are worth here and now: built with this machine's compiler, their own test run."""

from __future__ import annotations

import re
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from etude.errors import EtudeError

COMPILERS = ("cc", "gcc", "clang")
FLAGS = ("-std=c99", "-O2")
DEVIATION = re.compile(r"largest deviation: (\S+) .*; (\d+) wrong")
LONGEST_S = 300.0


@dataclass(frozen=True)
class Built:
    """The test's own words.

    Attributes:
        compiler: with which. deviation: largest, as a part of a command's limit. wrong: flags that differ.
        code: bytes of the machine code without tables; 0 where nothing tells.
    """

    compiler: str
    deviation: float
    wrong: int
    code: int


def compiler() -> str:
    """This machine's C compiler; "" if there is none."""
    return next((name for name in COMPILERS if shutil.which(name)), "")


def built(name: str, files: Mapping[str, bytes], tables: int) -> Built | None:
    """The files built and their test run; None where there is no compiler.

    Raises:
        EtudeError: they do not compile, or the test does not end as it should.
    """
    cc = compiler()
    if not cc:
        return None
    with tempfile.TemporaryDirectory(prefix="etude-c99-") as place:
        folder = Path(place)
        for file, data in files.items():
            (folder / file).write_bytes(data)
        _run([cc, *FLAGS, "-c", f"{name}.c", "-o", f"{name}.o"], folder)
        _run([cc, *FLAGS, f"{name}_test.c", f"{name}.o", "-lm", "-o", "self_test"], folder)
        found = DEVIATION.search(_run(["./self_test"], folder, good=(0, 1)))
        if found is None:
            raise EtudeError("the exported model's own test says nothing", next_step="Please report it.")
        return Built(cc, float(found[1]), int(found[2]), max(_text(folder / f"{name}.o") - tables, 0))


def _run(command: list[str], folder: Path, good: tuple[int, ...] = (0,)) -> str:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=LONGEST_S)
    if done.returncode not in good:
        raise EtudeError(
            f"{command[0]} does not take the exported model: {done.stderr.strip()[-400:]}",
            next_step="Please report it, with the compiler's version.",
        )
    return done.stdout


def _text(path: Path) -> int:
    """Bytes of code and constant tables of an object file."""
    if not shutil.which("size"):
        return 0
    lines = _run(["size", path.name], path.parent).splitlines()
    return int(lines[1].split()[0]) if len(lines) > 1 else 0
