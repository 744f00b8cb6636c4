"""What is known of the types of messages in a recording, and messages read by it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from etude.logs.readers.extras import READING, needed
from etude.logs.readers.ros_definitions import DEFINITIONS, LATER


class Stores:
    """What is known of message types: what the recording itself says of a topic, else ROS's own."""

    def __init__(self, path: Path) -> None:
        self._typesys = needed("rosbags.typesys", READING, path)
        self._known: dict[tuple[str, str], list[Any]] = {}

    def of(self, connection: Any) -> Any:
        """The type store for a topic's messages."""
        return self._all(connection)[0]

    def read(self, connection: Any, data: bytes) -> Any:
        """A message of a topic, by the release of ROS that fits. Whatever rosbags raises: none does."""
        stores = self._all(connection)
        for last, store in enumerate(stores, 1):
            try:
                message = store.deserialize_cdr(data, connection.msgtype)
            except Exception:
                if last == len(stores):
                    raise
            else:
                stores.insert(0, stores.pop(last - 1))  # the next message is of the same
                break
        return message

    def _all(self, connection: Any) -> list[Any]:
        key = (connection.msgtype, connection.msgdef.data)
        if key not in self._known:
            self._known[key] = self._made(connection)
        return self._known[key]

    def _made(self, connection: Any) -> list[Any]:
        own, format_ = self._typesys, connection.msgdef.format.name
        if format_ == "NONE":
            later = [{**DEFINITIONS, **LATER}] if connection.msgtype in LATER else []
            return [self._of_ros(definitions) for definitions in (DEFINITIONS, *later)]
        store = own.get_typestore(own.Stores.EMPTY)
        store.register(_types(own, connection.msgdef.data, format_, connection.msgtype))
        return [store]

    def _of_ros(self, definitions: Mapping[str, str]) -> Any:
        """ROS's own types and those that it is given."""
        store = self._typesys.get_typestore(self._typesys.Stores.LATEST)
        for name, text in definitions.items():
            if name not in store.fielddefs:
                store.register(self._typesys.get_types_from_msg(text, name))
        return store


def _types(typesys: Any, text: str, format_: str, msgtype: str) -> Any:
    """Types by name of a definition as the recording holds it; several IDLs stand between lines of =."""
    if format_ == "MSG":
        return typesys.get_types_from_msg(text, msgtype)
    found: dict[str, Any] = {}
    for part in text.split(80 * "=" + "\n"):
        own = part.partition("\n")[2] if part.startswith("IDL: ") else part
        if own.strip():
            found |= typesys.get_types_from_idl(own)
    return found
