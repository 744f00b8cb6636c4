"""A text file in blocks of whole lines: UTF-8 or UTF-16, any line ends, never the whole file at once."""

from __future__ import annotations

import codecs
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from etude.errors import DataError

BLOCK = 2**20
"""Bytes that are read at once."""
LONGEST_LINE = 2**26
"""Bytes: what has no line end for longer is no table."""
ENCODINGS = {codecs.BOM_UTF8: "utf-8", codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}


@dataclass
class TextBlocks:
    """Blocks of whole lines in UTF-8 with line feeds, to be gone through once.

    Attributes:
        path: the file.
        rest: the last line, if it has no end; it is left out, since part of its last number may be lost.
    """

    path: Path
    rest: bytes = b""

    def __iter__(self) -> Iterator[bytes]:
        """DataError: the file is binary."""
        left, lost_feed = b"", False
        with self.path.open("rb") as file:
            start = file.read(3)
            mark = next((own for own in ENCODINGS if start.startswith(own)), b"")
            file.seek(len(mark))
            decoder = codecs.getincrementaldecoder(ENCODINGS.get(mark, "utf-8"))()
            while data := file.read(BLOCK):
                text = self._decoded(decoder, data)
                if b"\r" in text or lost_feed:
                    if lost_feed and text.startswith(b"\n"):  # CR LF, half in the block before
                        text = text[1:]
                    lost_feed = text.endswith(b"\r")
                    text = text.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
                lines, feed, rest = text.rpartition(b"\n")
                if feed:
                    yield left + lines + feed
                    left = rest
                else:
                    left += rest
                if len(left) > LONGEST_LINE:
                    raise self._binary()
        self.rest = left

    def _decoded(self, decoder: codecs.IncrementalDecoder, data: bytes) -> bytes:
        try:
            text = decoder.decode(data).encode()
        except UnicodeError:
            raise self._binary() from None
        if b"\0" in text:
            raise self._binary()
        return text

    def _binary(self) -> DataError:
        return DataError(
            "this is a binary file, not CSV text",
            where=str(self.path),
            next_step="Export the log as CSV or Parquet.",
        )
