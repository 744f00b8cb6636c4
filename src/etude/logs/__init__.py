"""Logs: readers, columns, units, repairs, alignment, and the filters of all preprocessing."""

from typing import TYPE_CHECKING

from etude._runtime.lazy import face

if TYPE_CHECKING:
    from etude.logs.alignment.alignment import align
    from etude.logs.alignment.tracking_errors import largest_errors, tracked
    from etude.logs.checks.exact import judge_numbers
    from etude.logs.checks.filtered_motion import Seen, seen
    from etude.logs.checks.finding_texts import Doubt, Mendable
    from etude.logs.checks.plausibility import judge_motion
    from etude.logs.cleaning.filters import duration, median_rate, smooth, without_lag
    from etude.logs.cleaning.read import clean_log, matched_log, read_log
    from etude.logs.columns.matching import match_columns
    from etude.logs.evidence.command_signs import sign_decision
    from etude.logs.evidence.findings import finding_of
    from etude.logs.evidence.joint_evidence import Decision
    from etude.logs.readers.cells import header_row, restored, text_cell
    from etude.logs.readers.extras import needed
    from etude.logs.readers.frames import parquet_frame, parquet_metadata, raw_log
    from etude.logs.readers.log_file import read_log_file, write_log
    from etude.logs.readers.registry import cut_sentences, read_raw

__all__ = [
    "Decision",
    "Doubt",
    "Mendable",
    "Seen",
    "align",
    "clean_log",
    "cut_sentences",
    "duration",
    "finding_of",
    "header_row",
    "judge_motion",
    "judge_numbers",
    "largest_errors",
    "match_columns",
    "matched_log",
    "median_rate",
    "needed",
    "parquet_frame",
    "parquet_metadata",
    "raw_log",
    "read_log",
    "read_log_file",
    "read_raw",
    "restored",
    "seen",
    "sign_decision",
    "smooth",
    "text_cell",
    "tracked",
    "without_lag",
    "write_log",
]
__getattr__, __dir__ = face(__name__)
