"""XML parsing of a model file: no xacro, one root, unique names.

No name of a description may be reserved in MuJoCo. MuJoCo's fixed body is called "world", and a link of that
name would be merged into it: the joint between the room and the robot's root would be lost.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Collection, Iterable
from pathlib import Path

from etude.errors import UsageError

NEXT = {
    "mujocoinclude": "Name the file that includes this one.",
    "sdf": "SDF is not supported: use the URDF or the MJCF of the robot.",
}


def parsed(path: Path) -> ET.Element:
    """The root element of a URDF (<robot>) or an MJCF (<mujoco>).

    Raises:
        UsageError: no such file, no XML, xacro, neither of the two, or names that repeat.
    """
    try:
        root = ET.fromstring(declared(path.read_bytes()))
    except FileNotFoundError:
        raise UsageError(f"there is no model file {path}", next_step="Check the path.") from None
    except (ET.ParseError, OSError, UnicodeDecodeError) as problem:
        raise UsageError(
            f"not a readable URDF or MJCF file: {problem}",
            where=str(path),
            next_step="Restore the file, or correct that place of it.",
        ) from None
    if _to_be_expanded(root) or path.suffix == ".xacro":
        raise UsageError(
            "this is a xacro file",
            where=str(path),
            next_step=f"Expand it first: xacro {path.name} > {_expanded(path)} "
            "(ROS has the command; so has pip install xacro).",
        )
    if root.tag not in ("robot", "mujoco"):
        raise UsageError(
            f"the root element is <{root.tag}>; URDF has <robot>, MJCF has <mujoco>",
            where=str(path),
            next_step=NEXT.get(root.tag, "Name the robot's URDF or MJCF."),
        )
    if root.tag == "robot":
        _refuse_repeated(root, path)
    return root


def declared(text: bytes) -> bytes:
    """XML with every prefix declared: most readers of robot files, and so the files, ignore namespaces."""
    used = set(re.findall(rb"[<\s]([A-Za-z_][\w.-]*):[A-Za-z_]", text))
    prefixes = set(re.findall(rb"xmlns:([\w.-]+)\s*=", text)) | {b"xml", b"xmlns"}
    more = b"".join(b' xmlns:%s="%s"' % (prefix, prefix) for prefix in sorted(used - prefixes))
    return re.sub(rb"<(robot|mujoco)\b", lambda root: root[0] + more, text, count=1)


def _to_be_expanded(root: ET.Element) -> bool:
    """Whether xacro would change anything. Unused definitions, which many URDFs keep, change nothing."""
    elements = [element for element in root.iter() if "xacro" in element.tag]
    if any(not element.tag.endswith(("}property", "}arg")) for element in elements):
        return True
    others = [element for element in root.iter() if "xacro" not in element.tag] if elements else []
    texts = [text for one in others for text in (*one.attrib.values(), one.text or "", one.tail or "")]
    return any("${" in text or "$(" in text for text in texts)


def _expanded(path: Path) -> str:
    """An unused name for the expanded file: the printed command must not overwrite a file."""
    stem = path.name.split(".")[0]
    names = (f"{stem}.urdf", f"{stem}_expanded.urdf", f"{stem}_expanded_anew.urdf")
    return next((name for name in names if not (path.parent / name).exists()), names[-1])


def _refuse_repeated(root: ET.Element, path: Path) -> None:
    for tag in ("link", "joint"):
        for name, count in Counter(element.get("name", "") for element in root.findall(tag)).items():
            if count > 1 or not name:
                what = f"{tag} '{name}' is described {count} times" if name else f"a {tag} has no name"
                raise UsageError(what, where=str(path), next_step=f"Give each {tag} a different name.")


WORLD = "world"
"""MuJoCo's fixed body, and the undeclared link to which Drake's files weld their base."""


def free_name(name: str, taken: Collection[str]) -> str:
    """The name, or an unused one derived from it."""
    while name in taken:
        name = f"own_{name}"
    return name


def body_names(links: Iterable[str]) -> dict[str, str]:
    """Link -> name of its body: the name of the link, unless MuJoCo reserves it."""
    links = list(links)
    return {link: free_name(link, {WORLD, *links}) if link == WORLD else link for link in links}
