"""A model on disk: numbers in one .npz, everything else in one .json, each whole or not at all."""

from __future__ import annotations

import io
import json
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tokenize import TokenError
from typing import Any, TypeVar
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from etude.errors import DataError
from etude.storage import write_atomic

Arrays = dict[str, NDArray[Any]]
Words = dict[str, Any]
M = TypeVar("M")
# a RuntimeError covers zip features that damage seems to ask for, and JSON nested too deeply; TokenError is
# what NumPy's reader of array headers lets through
DAMAGE = (
    *(OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RuntimeError),
    *(EOFError, MemoryError, SyntaxError, BadZipFile, TokenError, zlib.error),
)


@dataclass(frozen=True)
class TwoFiles:
    """Names of the two files, without folder, and the version of their contents."""

    numbers: str
    words: str
    version: int

    def write(self, folder: Path, arrays: Arrays, words: Words) -> None:
        """The numbers first, then the words, which say that the model is whole."""
        folder.mkdir(parents=True, exist_ok=True)
        buffer = io.BytesIO()
        np.savez(buffer, allow_pickle=False, **arrays)
        write_atomic(folder / self.numbers, buffer.getvalue())
        text = json.dumps({"version": self.version, **words}, indent=1)
        write_atomic(folder / self.words, text.encode())

    def read(self, folder: Path, make: Callable[[Words, Arrays], M], what: str) -> M:
        """What `make` makes of both.

        Raises:
            DataError: no model there, or a damaged or foreign one; `what` names it, "model" for example.
        """
        try:
            words = json.loads((folder / self.words).read_text(encoding="utf-8"))
            # from memory: NumPy leaves a damaged file open
            with np.load(io.BytesIO((folder / self.numbers).read_bytes()), allow_pickle=False) as file:
                arrays = dict(file)
            if words["version"] != self.version:
                raise ValueError(f"version {words['version']}")
            return make(words, arrays)
        except DAMAGE as error:
            raise DataError(
                f"this is no {what} that can be read ({error})",
                where=str(folder),
                next_step="Remove the folder and learn the logs again.",
            ) from error
