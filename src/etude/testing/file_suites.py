"""Laws of log readers and exporters: the receiver plays the motion that was proved."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

import numpy as np

from etude.deploy.playback_certificate import HELD_STILL, ORDERS_HELD, certify_played
from etude.errors import DataError
from etude.limits.lead_ins import at_rest
from etude.protocols import Exporter, Kind, Reader
from etude.testing.differences import close
from etude.testing.robot_world import World, world
from etude.types import Array


class ExporterSuite:
    """Laws of `protocols.Exporter`. Set `exporter` (a staticmethod), `kind` and `robot`."""

    exporter: ClassVar[Exporter]
    kind: ClassVar[Kind]
    robot: ClassVar[str]
    accuracy: ClassVar[float] = 1e-6
    """Of the path that the receiver plays, as a part of its size."""

    @property
    def world(self) -> World:
        return world(self.kind, self.robot)

    def test_the_receiver_plays_the_trajectory(self) -> None:
        here = self.world
        trajectory = here.trajectory(0)
        files = type(self).exporter(trajectory, here.kind, here.spec)
        assert files, "nothing was exported"
        played = type(self).exporter.back(files)
        t = np.linspace(0.0, trajectory.duration, 500)
        close(played.motion(t, 1).orders[0], trajectory.motion(t, 1).orders[0], self.accuracy, "path played")

    def test_what_it_plays_is_certified(self) -> None:
        here = self.world
        trajectory = at_rest(here.trajectory(1), here.limits)  # receivers hold the first row and the last
        files = type(self).exporter(trajectory, here.kind, here.spec)
        certificate = certify_played(type(self).exporter, files, here.limits, trajectory)
        assert certificate.seen, "nothing is proved of the motion that the receiver plays"

    def test_its_receiver_goes_from_rest_to_rest(self) -> None:
        """It holds the first row before, and the last one for ever."""
        here = self.world
        trajectory = at_rest(here.trajectory(3), here.limits)
        played = type(self).exporter.back(type(self).exporter(trajectory, here.kind, here.spec))
        ends = np.array([0.0, played.duration])
        moves = np.abs(played.motion(ends, ORDERS_HELD).orders[1:]).max()
        assert moves <= HELD_STILL, f"a row that is held moves: {moves:.3g} per s or s^2"
        outside = played.motion(ends + np.array([-10.0, 10.0]), ORDERS_HELD).orders
        close(outside[0], played.motion(ends, 1).orders[0], self.accuracy, "place held")
        assert not outside[1:].any(), "it moves before the first row, or after the last"

    def test_the_same_motion_gives_the_same_bytes(self) -> None:
        here = self.world
        first, second = (type(self).exporter(here.trajectory(2), here.kind, here.spec) for _ in range(2))
        assert first == second, "the files depend on more than the trajectory"


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
        table = self._values(path)
        for name, values in self.columns.items():
            if name != "t":
                assert np.array_equal(table[name], values), f"{name}: {table[name]}, wanted {values}"

    def test_what_it_reads_it_recognises(self, tmp_path: Path) -> None:
        path = tmp_path / f"run{self.suffix}"
        self.write(path, self.columns)
        recognises = type(self).reader.recognises
        assert recognises(path, path.read_bytes()[:4096]), "a file of its own format is not recognised"

    def test_foreign_files_are_refused(self, tmp_path: Path) -> None:
        path = tmp_path / f"run{self.suffix}"
        for content in (b"", bytes(range(256)) * 64, b"\x00" * 4096):
            path.write_bytes(content)
            step = self._refused(path)
            assert step is not None, f"{content[:8]!r}... is not refused"
            assert step, "the message does not state what to do"

    def test_files_cut_anywhere_give_an_error_or_whole_rows(self, tmp_path: Path) -> None:
        path = tmp_path / f"run{self.suffix}"
        self.write(path, self.columns)
        data = path.read_bytes()
        for size in range(0, len(data), max(1, len(data) // 40)):
            path.write_bytes(data[:size])
            try:
                table = self._values(path)
            except DataError:
                continue
            assert set(table) <= set(self.columns), (
                f"names that nobody wrote: {set(table) - set(self.columns)}"
            )
            for name, values in table.items():
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
