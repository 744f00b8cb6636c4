"""What runs measured: the figures, the file of one run, and the committed collections of all seeds."""

from __future__ import annotations

from etude_studies.collected import Results, collect
from etude_studies.made import Made, made_by
from etude_studies.measured import Measured, comparable, measured_table
from etude_studies.run_file import read_made, read_result, result_path, write_result

__all__ = [
    "Made",
    "Measured",
    "Results",
    "collect",
    "comparable",
    "made_by",
    "measured_table",
    "read_made",
    "read_result",
    "result_path",
    "write_result",
]
