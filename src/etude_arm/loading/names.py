"""Names in the compiled model: no name of a description may mean anything to MuJoCo, or meet one given here.

MuJoCo calls its own fixed body "world", and takes a link of that name for it: what hangs the robot's root
into the room would be lost.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable

WORLD = "world"
"""MuJoCo's own body, and a link that Drake's files weld their base to without describing it."""


def free_name(name: str, taken: Collection[str]) -> str:
    """The name, or one made of it that is not taken."""
    while name in taken:
        name = f"own_{name}"
    return name


def body_names(links: Iterable[str]) -> dict[str, str]:
    """Link -> name of its body: its own, but for one that MuJoCo keeps for itself."""
    links = list(links)
    return {link: free_name(link, {WORLD, *links}) if link == WORLD else link for link in links}
