"""MAT files of version 7.3 as MATLAB lays them out: HDF5 behind 512 bytes of text, axes in reverse order."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

BESIDE = 512  # bytes before the HDF5 part
HEAD = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, HDF5 schema 1.00 .".ljust(124) + b"\x00\x02IM"
CLASSES = {"f8": "double", "f4": "single", "b1": "logical"}


def write73(path: Path, variables: Mapping[str, Any], **how: Any) -> Path:
    """Arrays of MATLAB's shape, and mappings as structs; `how` goes to h5py's `create_dataset`."""
    import h5py

    with h5py.File(path, "w", userblock_size=BESIDE) as file:
        _put(file, variables, how)
    with path.open("r+b") as raw:
        raw.write(HEAD)
    return path


def _put(group: Any, variables: Mapping[str, Any], how: Mapping[str, Any]) -> None:
    for name, value in variables.items():
        if isinstance(value, Mapping):
            inner = group.create_group(name)
            inner.attrs["MATLAB_class"] = np.bytes_("struct")
            _put(inner, value, how)
            continue
        own = np.atleast_2d(value)
        kind = CLASSES.get(own.dtype.str[1:], own.dtype.name)
        own = own.astype(np.uint8) if own.dtype == bool else own
        packed = {"chunks": True, "compression": "gzip", "compression_opts": 3} if own.size > 1 else {}
        dataset = group.create_dataset(name, data=own.T, **{**packed, **how})
        dataset.attrs["MATLAB_class"] = np.bytes_(kind)
