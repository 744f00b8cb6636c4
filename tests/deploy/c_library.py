"""Exported C as a shared library in this process, by ctypes."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

import numpy as np

from compilers import run, tool
from etude.deploy import Plan
from etude.types import Array, Motion, Row

FLAGS = ("-std=c99", "-O2", "-fPIC")


class Library:
    """Functions of one model; `state` is its own."""

    def __init__(
        self, files: Any, folder: Path, flags: tuple[str, ...] = FLAGS, compiler: str = "gcc"
    ) -> None:
        self.plan: Plan = files.plan
        for file, data in files.files.items():
            (folder / file).write_bytes(data)
        name = self.plan.name
        run([tool(compiler), *flags, "-c", f"{name}.c", "-o", f"{name}.o"], folder)
        # linked without -ffast-math, or loading it would flush small numbers of this process to 0
        run([tool(compiler), "-shared", f"{name}.o", "-lm", "-o", f"{name}.so"], folder)
        self._own = ctypes.CDLL(str(folder / f"{name}.so"))
        self.real = np.float32 if files.form.single else np.float64
        self._state = ctypes.create_string_buffer(16 * (len(self.plan.low) + self.plan.memory + 8))
        self.begin()

    def begin(self) -> None:
        getattr(self._own, f"{self.plan.name}_init")(self._state)

    def call(self, function: str, row: Array) -> tuple[int, Array, Array]:
        """Flags, commands and variances of one call; variances stay NaN where the function has none."""
        data = np.ascontiguousarray(row, dtype=self.real)
        command = np.full(len(self.plan.limit), np.nan, dtype=self.real)
        variance = np.full(len(self.plan.limit), np.nan, dtype=self.real)
        pointers = [ctypes.c_void_p(a.ctypes.data) for a in (data, command, variance)]
        own = getattr(self._own, f"{self.plan.name}_{function}")
        before = [] if function in ("gravity", "instant") else [self._state]
        count = 3 if function == "predict" else 2
        return int(own(*before, *pointers[:count])), command, variance


class LibraryController:
    """The exported C in the loop of a simulated robot (implements `protocols.Controller`)."""

    def __init__(self, library: Library, function: str = "predict") -> None:
        self.library, self.function = library, function

    def planned(self, motion: Motion) -> Array:
        log = self.library.plan.model.inputs.states(motion)
        rows = np.concatenate([log[channel.name] for channel in self.library.plan.channels], axis=1)
        self.library.begin()
        return np.stack([self.library.call(self.function, row)[1] for row in rows])

    def command(self, t: float, row: Row) -> tuple[Array, Array]:
        states = np.concatenate([row[channel.name] for channel in self.library.plan.channels])
        _, command, variance = self.library.call(self.function, states)
        return command, np.sqrt(variance)

    def observe(self, t: float, row: Row) -> None:
        """Nothing is learned on the way."""
