"""What every log reader owes."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np

from etude.errors import DataError
from etude.protocols import Reader
from etude.types import Array


class ReaderSuite:
    """Laws of `protocols.Reader`. Set `reader` (a staticmethod) and `suffix`, and write files in `write`."""

    reader: ClassVar[Reader]
    suffix: ClassVar[str]

    def write(self, path: Path, columns: dict[str, list[float]]) -> None:
        """Writes a file of this format with these columns."""
        raise NotImplementedError

    @property
    def columns(self) -> dict[str, list[float]]:
        return {"t": [0.0, 0.01, 0.02], "q_a": [0.1, -2.5e-17, 1 / 3], "tau_a": [1e300, 2.0, 3.0]}

    def test_every_column_is_read_exactly(self, tmp_path: Path) -> None:
        path = tmp_path / f"run{self.suffix}"
        self.write(path, self.columns)
        found = self._values(path)
        for name, values in self.columns.items():
            if name != "t":
                assert np.array_equal(found[name], values), f"{name}: {found[name]}, wanted {values}"

    def test_what_it_reads_it_recognises(self, tmp_path: Path) -> None:
        path = tmp_path / f"run{self.suffix}"
        self.write(path, self.columns)
        recognises = type(self).reader.recognises  # type: ignore[attr-defined]
        assert recognises(path, path.read_bytes()[:4096]), "a file of its own format is not recognised"

    def test_foreign_files_are_refused(self, tmp_path: Path) -> None:
        path = tmp_path / f"run{self.suffix}"
        for content in (b"", bytes(range(256)) * 64, b"\x00" * 4096):
            path.write_bytes(content)
            step = self._refused(path)
            assert step is not None, f"{content[:8]!r}... is not refused"
            assert step, "the message does not say what to do"

    def test_files_cut_anywhere_give_an_error_or_whole_rows(self, tmp_path: Path) -> None:
        path = tmp_path / f"run{self.suffix}"
        self.write(path, self.columns)
        data = path.read_bytes()
        for size in range(0, len(data), max(1, len(data) // 40)):
            path.write_bytes(data[:size])
            try:
                found = self._values(path)
            except DataError:
                continue
            for name, values in found.items():
                assert np.array_equal(values, self.columns[name][: len(values)]), f"{name} of a cut file"

    def _refused(self, path: Path) -> str | None:
        """The next step that the refusal names; None if the file was read."""
        try:
            type(self).reader(path, ())
        except DataError as refused:
            return refused.next_step
        return None

    def _values(self, path: Path) -> dict[str, Array]:
        logs = type(self).reader(path, ())
        return {name: values[:, 0] for log in logs.values() for name, values in log.values.items()}
