"""From a file to a Log: readers, columns, units, the doctor, alignment, and the steps of every recipe."""

from typing import TYPE_CHECKING

from etude._runtime.lazy import face

if TYPE_CHECKING:
    from etude.logs.alignment.tracking_errors import largest_errors
    from etude.logs.checks.filtered_motion import seen
    from etude.logs.checks.finding_texts import Mendable
    from etude.logs.checks.plausibility import judge_motion
    from etude.logs.cleaning.filters import median_rate, smooth, without_lag
    from etude.logs.cleaning.read import clean_log, read_log
    from etude.logs.readers.frames import parquet_frame, parquet_metadata, raw_log
    from etude.logs.readers.log_file import read_log_file, write_log

__all__ = [
    "Mendable",
    "clean_log",
    "judge_motion",
    "largest_errors",
    "median_rate",
    "parquet_frame",
    "parquet_metadata",
    "raw_log",
    "read_log",
    "read_log_file",
    "seen",
    "smooth",
    "without_lag",
    "write_log",
]
__getattr__, __dir__ = face(__name__)
