"""etude doctor"""

from __future__ import annotations

from dataclasses import asdict, dataclass

from etude.commands.common import Common
from etude.commands.outcome import Outcome, Say


@dataclass(frozen=True, kw_only=True)
class Doctor(Common):
    """Say what this machine has for Étude: versions, threads, compilers, extras, a browser, folders.

    Exit code 1 if something is missing without which Étude does not work.
    """

    def run(self, _: Say) -> Outcome:
        from etude.commands.machine import examined

        found = examined()
        first = max(len(one.name) for one in found)
        lines = [f"{one.sign:<6} {one.name:<{first}}  {one.sentence}" for one in found]
        needed = [one for one in found if one.light == "red"]
        lines += ["", "Something that is needed is missing." if needed else "All that is needed is there."]
        data = {"checks": [asdict(one) for one in found], "ok": not needed}
        return Outcome("\n".join(lines), data, 1 if needed else 0)
