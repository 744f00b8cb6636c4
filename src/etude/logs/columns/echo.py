"""What `ros2 topic echo --csv` writes of joint states: no header, each message's arrays in turn.

sec, nanosec, frame, then the names of all joints, their positions, velocities and efforts.
"""

from __future__ import annotations

from collections.abc import Sequence

from etude.errors import DataError

STAMP = ("header.stamp.sec", "header.stamp.nanosec", "header.frame_id")
ARRAYS = ("position", "velocity", "effort")


def echo_names(cells: Sequence[str], where: str) -> list[str]:
    """Headers for the cells of a first line that is such a message; none for any other line.

    Raises:
        DataError: each joint has two values, of which the second may be either of two things; or there are
            no names and the values are not three a joint.
    """
    if len(cells) < 5 or not (cells[0].isdigit() and cells[1].isdigit() and int(cells[1]) < 10**9):
        return []
    numbers = [is_number(cell) for cell in cells[3:]]
    joints = numbers.index(True) if True in numbers else 0
    values = len(numbers) - joints
    if not joints:
        return [] if is_number(cells[2]) or not all(numbers) else _nameless(len(numbers), where)
    if is_number(cells[2]) or not all(numbers[joints:]) or values % joints:
        return []
    arrays = values // joints
    if arrays == 2:
        own = ",".join(
            [*STAMP, *(f"{w}[{i}]" for w in ("name", "position", "effort") for i in range(joints))]
        )
        raise DataError(
            "a message has two values for each joint: position, and velocity or effort",
            where=where,
            next_step=f"Add a header row, for efforts: {own}",
        )
    if arrays > len(ARRAYS):
        return []
    return [*STAMP, *(f"{word}[{i}]" for word in ("name", *ARRAYS[:arrays]) for i in range(joints))]


def _nameless(values: int, where: str) -> list[str]:
    """Headers of a message without names: three arrays, of which the count of joints is to be right."""
    joints, left = divmod(values, len(ARRAYS))
    if left:
        raise DataError(
            f"a message without names of joints has {values} values, which are not position, velocity and "
            "effort of each",
            where=where,
            next_step=f"Add a header row: {','.join(STAMP)}, then position[0],position[1],... and so on.",
        )
    return [*STAMP, *(f"{word}[{i}]" for word in ARRAYS for i in range(joints))]


def is_number(text: str) -> bool:
    """Whether a cell is one."""
    try:
        float(text)
    except ValueError:
        return False
    return True
