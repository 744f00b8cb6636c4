"""The [log] table of a campaign."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class LogConfig:
    """The table [log]: how the logs of a robot differ from what Étude expects.

    Attributes:
        columns: header as it is to be read -> header in the file. A unit in the file's header is kept.
        ignored: headers of columns that are left out.
        topics: topics to read, of logs with several; none: the topics that fit.
        rate: Hz, at which rows of logs without times stand; 0: such logs are refused.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    ignored: tuple[str, ...] = ()
    topics: tuple[str, ...] = ()
    rate: float = 0.0
