"""Whether the compiled sweeps have to be compiled first, which takes a while once for an installation."""

from __future__ import annotations

from pathlib import Path

SENTENCE = "Compiling the Lagrangian prior: half a minute, once for this installation."


def first_use() -> str:
    """A sentence for who waits, if the sweeps still have to be compiled; else ""."""
    from etude_lagrangian import all_outputs, one_output

    sweeps = (one_output.sweep, all_outputs.sweep_all, all_outputs.means_all)
    return "" if all(map(_compiled, sweeps)) else SENTENCE


def _compiled(function: object) -> bool:
    """In this process, or by an earlier one since the file was written."""
    if getattr(function, "signatures", ()):
        return True
    stats, source = getattr(function, "stats", None), getattr(function, "py_func", None)
    if stats is None or source is None or stats.cache_path is None:
        return False
    path = Path(source.__code__.co_filename)
    entries = Path(stats.cache_path).glob(
        f"{path.stem}.{source.__name__}-{source.__code__.co_firstlineno}.*.nbi"
    )
    written = path.stat().st_mtime if path.is_file() else 0.0
    return any(entry.stat().st_mtime >= written for entry in entries)
