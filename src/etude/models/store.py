"""Model storage in one .npz: shared arrays stored once, factors computed again on reading.

Predictions of a model that was read are the same bits on the same machine.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np

from etude.codes import stated
from etude.errors import DataError
from etude.models.change.change_detection import FREEDOM
from etude.models.learned_model import LearnedModel
from etude.models.members import member_named
from etude.models.process import Silent
from etude.models.process_abilities import EnsembleMember, name_of, share_of
from etude.models.selection.ensemble import CANDIDATES
from etude.models.selection.linear import LinearPhysics
from etude.models.student_t import StudentT
from etude.protocols import Candidate, Inputs, Mean, Physics, Process
from etude.storage import DAMAGE, arrays_of, packed, write_atomic
from etude.types import Array

VERSION = 2
"""Of the contents."""
WORDS = "words"


def save_model(path: str | Path, model: LearnedModel) -> None:
    """Writes the model, whole or not at all."""
    write_atomic(Path(path), model_bytes(model))


def load_model(
    path: str | Path, inputs_of: Callable[[Mapping[str, Array]], Inputs], physics: Mapping[str, Physics]
) -> LearnedModel:
    """The model that `save_model` wrote.

    Args:
        inputs_of: from the arrays that `Inputs.arrays` gave to the inputs: `inputs.restore` of the kind's.
        physics: the kind's, by structure; restore the means.

    Raises:
        DataError: no model there, or a damaged or foreign one. UsageError: a plug-in that it needs is
            not there.
    """
    try:
        return model_of(Path(path).read_bytes(), inputs_of, physics)
    except DAMAGE as error:
        raise DataError(
            f"this is not a readable model ({error})",
            where=str(path),
            next_step="Remove the file and train the model again.",
        ) from error


def model_bytes(model: LearnedModel) -> bytes:
    """The file of a model."""
    shelf = _Shelf()
    metadata: dict[str, Any] = {
        "version": VERSION,
        "member": model.member,
        "commands": model.commands,
        "calibrated": model.calibrated,
        "freedom": model.freedom,
        "different": model.different,
        "student": None if model.student is None else asdict(model.student),
        "warnings": [one.to_json() for one in model.warnings],
    }
    shelf.put("ranges", model.ranges)
    shelf.put("independence", model.independence)
    if model.least is not None:
        shelf.put("least", model.least)
    if model.width is not None:
        shelf.put("width", model.width)
    shelf.put_all("inputs", model.inputs.arrays())
    means: dict[int, str] = {}
    processes: dict[int, int] = {}
    rows = [_candidate_metadata(shelf, f"c{i}", c, means, processes) for i, c in enumerate(model.candidates)]
    metadata |= {"candidates": rows, "arrays": shelf.names}
    text = np.frombuffer(json.dumps(metadata).encode(), dtype=np.uint8)
    return packed({WORDS: text, **shelf.arrays})


def model_of(
    data: bytes, inputs_of: Callable[[Mapping[str, Array]], Inputs], physics: Mapping[str, Physics]
) -> LearnedModel:
    """The model of a file's bytes; errors of all kinds where they are not whole."""
    stored = arrays_of(data)
    metadata = json.loads(bytes(stored[WORDS]))
    if metadata["version"] != VERSION:
        raise ValueError(f"version {metadata['version']}")
    arrays = {name: stored[key] for name, key in metadata["arrays"].items()}
    inputs = inputs_of(_with_prefix(arrays, "inputs"))
    all_physics = {"linear": LinearPhysics(inputs), **physics}
    means: dict[str, Mean] = {}
    processes: dict[int, Process] = {}
    rows = [
        _candidate(f"c{i}", row, arrays, metadata["member"], all_physics, means, processes)
        for i, row in enumerate(metadata["candidates"])
    ]
    student = metadata["student"]
    return LearnedModel(
        inputs=inputs,
        candidates=tuple(rows),
        commands=tuple(metadata["commands"]),
        ranges=arrays["ranges"],
        calibrated=bool(metadata["calibrated"]),
        independence=arrays["independence"],
        freedom=float(metadata.get("freedom", FREEDOM)),
        different=float(metadata.get("different", 1.0)),
        member=metadata["member"],
        least=arrays.get("least"),
        width=arrays.get("width"),
        student=None if student is None else StudentT(**student),
        warnings=stated(metadata["warnings"]),
    )


@dataclass
class _Shelf:
    """Arrays by content, and where each name's is."""

    arrays: dict[str, Array] = field(default_factory=dict)
    names: dict[str, str] = field(default_factory=dict)
    _keys: dict[tuple[str, tuple[int, ...], bool, bytes], str] = field(default_factory=dict)

    def put(self, name: str, array: Any) -> None:
        """Stores an array unless one of the same bits is there. TypeError for objects."""
        array = np.asarray(array)
        if array.dtype.hasobject:
            raise TypeError(f"the array {name!r} holds objects, which are not stored")
        content = hashlib.sha256(array.tobytes(order="A")).digest()
        key = (array.dtype.str, array.shape, bool(array.flags.f_contiguous), content)
        if key not in self._keys:
            self._keys[key] = f"a{len(self._keys)}"
            self.arrays[self._keys[key]] = array
        self.names[name] = self._keys[key]

    def put_all(self, prefix: str, arrays: Mapping[str, Array]) -> None:
        """Stores each under prefix/name."""
        for name, array in arrays.items():
            self.put(f"{prefix}/{name}", array)


def _candidate_metadata(
    shelf: _Shelf, prefix: str, candidate: Candidate, means: dict[int, str], processes: dict[int, int]
) -> dict[str, Any]:
    for name in ("weights", "units", "calibration"):
        shelf.put(f"{prefix}/{name}", getattr(candidate, name))
    shelf.put(f"{prefix}/share", share_of(candidate))
    if isinstance(candidate, EnsembleMember) and candidate.error is not None:
        shelf.put(f"{prefix}/error", candidate.error)
    metadata: dict[str, Any] = {
        "rung": candidate.structure,
        "commands": candidate.commands,
        "mean": None,
        "name": name_of(candidate),
    }
    if candidate.mean is not None:
        metadata["mean"] = name = _mean_name(candidate, means)
        shelf.put_all(f"mean/{name}", candidate.mean.arrays())
    process = candidate.process
    metadata["silent"] = isinstance(process, Silent)
    if isinstance(process, Silent):
        shelf.put_all(f"{prefix}/silent", process.arrays())
        process = process.own
    if process is None:
        return metadata | {"process": None}
    if id(process) not in processes:
        processes[id(process)] = len(processes)
        shelf.put_all(f"p{processes[id(process)]}", process.arrays())
    return metadata | {"process": processes[id(process)]}


def _mean_name(candidate: Candidate, means: dict[int, str]) -> str:
    """Under which its mean function is stored: its base, and a number where another one of that has it."""
    if id(candidate.mean) not in means:
        base = candidate.structure.removesuffix("+gp")
        alike = [name for name in means.values() if name.partition(".")[0] == base]
        means[id(candidate.mean)] = f"{base}.{len(alike)}" if alike else base
    return means[id(candidate.mean)]


def _candidate(
    prefix: str,
    metadata: Mapping[str, Any],
    arrays: Mapping[str, Array],
    member: str,
    physics: Mapping[str, Physics],
    means: dict[str, Mean],
    processes: dict[int, Process],
) -> Candidate:
    base, number = metadata["mean"], metadata["process"]
    if base is not None and base not in means:
        kind = base.partition(".")[0]
        if kind not in physics:
            raise ValueError(f"the robot has no {kind} physics")
        means[base] = physics[kind].restore(_with_prefix(arrays, f"mean/{base}"))
    if number is not None and number not in processes:
        member_config = CANDIDATES.get(metadata.get("name", "default"))
        member_name = member if member_config is None else member_config.process
        processes[number] = member_named(member_name).restore(_with_prefix(arrays, f"p{number}"))
    process: Any = None if number is None else processes[number]
    if metadata["silent"]:
        stored = _with_prefix(arrays, f"{prefix}/silent")
        numbers = (stored["calibration"], stored["least"], stored["prior"])
        process = Silent(process, *numbers, grows=bool(stored["grows"]))
    return EnsembleMember(
        structure=metadata["rung"],
        commands=tuple(metadata["commands"]),
        weights=arrays[f"{prefix}/weights"],
        mean=None if base is None else means[base],
        process=cast("Process", process),
        units=arrays[f"{prefix}/units"],
        calibration=arrays[f"{prefix}/calibration"],
        name=metadata.get("name", "default"),
        share=arrays.get(f"{prefix}/share"),
        error=arrays.get(f"{prefix}/error"),
    )


def _with_prefix(arrays: Mapping[str, Array], prefix: str) -> dict[str, Array]:
    """The arrays below a prefix, without it."""
    start = f"{prefix}/"
    return {name.removeprefix(start): array for name, array in arrays.items() if name.startswith(start)}
