"""The journal's lines as a chain of hashes: a line that is deleted, moved or edited is found, by its number.

Each line ends with two hashes: `previous` is the SHA-256 of the line before it, and `seal` is the SHA-256 of
this line's own text up to there. Journals of version 0.1 have neither. They are read as they are; the first
line that is added to one carries the hash of everything before it, and from then on an edit of the old part
is found too, though not its line. A line that lost its hashes is told from one of 0.1 by what else it says:
see `journal.NEWER`.

What the chain cannot see: lines cut off at the end leave a whole, shorter chain. Only the files that those
lines spoke of, where they still lie, show that there was more. Nor is it a signature: who computes every hash
behind an edit again has written another journal.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence

from etude.errors import UsageError

PREVIOUS, SEAL = "previous", "seal"
_HASH = "[0-9a-f]{64}"
_END = re.compile(
    rf'(?P<text>.*, "{PREVIOUS}": "(?P<previous>{_HASH})"), "{SEAL}": "(?P<seal>{_HASH})"\}}', re.DOTALL
)
_UNCHANGED = "The journal is written by etude alone; put it back as it was, from a copy or your backup."


def chained(text: str, before: Sequence[str]) -> str:
    """The line of a JSON object's `text` that follows the lines `before`."""
    open_text = f'{text[:-1]}, "{PREVIOUS}": "{_link(before)}"'
    return f'{open_text}, "{SEAL}": "{_sha256(open_text)}"}}'


def is_chained(line: str) -> bool:
    """Whether it ends with both hashes, right or wrong."""
    return _END.fullmatch(line) is not None


def check_chain(lines: Sequence[str], path: object) -> None:
    """Holds every line against its seal and against the line before it.

    Raises:
        UsageError: a line was deleted, moved or edited; says which.
    """
    first = next((i for i, line in enumerate(lines) if is_chained(line)), len(lines))
    for i in range(first, len(lines)):
        found = _END.fullmatch(lines[i])
        if found is None or found["seal"] != _sha256(found["text"]):
            raise _changed("this line of the journal was edited", path, i)
        # the line before is chained, but for the first one's: that hash is of all before, which may be much
        if found["previous"] == _link(lines[:i] if i == first else lines[i - 1 : i]):
            continue
        if i == first and i > 0:
            raise _changed(f"the journal was changed in its first {i} lines, of version 0.1", path, 0)
        raise _changed("a line of the journal was deleted, added or moved just before this one", path, i)


def _link(before: Sequence[str]) -> str:
    """The hash that the next line carries: of the line before, or of all lines where that one is of 0.1."""
    if before and is_chained(before[-1]):
        return _sha256(before[-1])
    return _sha256("".join(f"{line}\n" for line in before))


def _sha256(text: str) -> str:
    # a damaged line may hold bytes that are no text; storage.read_lines gives them as surrogates
    return hashlib.sha256(text.encode(errors="surrogateescape")).hexdigest()


def _changed(fact: str, path: object, index: int) -> UsageError:
    return UsageError(fact, where=f"{path}:{index + 1}", next_step=_UNCHANGED)
