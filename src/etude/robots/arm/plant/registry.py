"""Which plants there are: one row per simulated robot."""

from __future__ import annotations

from collections.abc import Callable

from etude.errors import UsageError
from etude.robots.arm.plant.arm import arm_robot
from etude.robots.arm.plant.robot import SimulatedRobot
from etude.robots.arm.spec import ArmSpec
from etude.robots.toml_file import load_robot

# plant name -> (name, its owner's description, engine) -> robot
PLANTS: dict[str, Callable[[str, ArmSpec, str], SimulatedRobot]] = {
    "arm4": arm_robot,
    "arm4_rough": arm_robot,
}


def plant_names() -> tuple[str, ...]:
    """Names that `simulated_robot` takes."""
    return tuple(PLANTS)


def simulated_robot(name: str, engine: str = "mujoco", spec: ArmSpec | None = None) -> SimulatedRobot:
    """The simulated robot `name`.

    Args:
        name: one of `plant_names()`.
        engine: "mujoco", or "compiled" for bulk runs; they agree to 0.001 deg over a minute of closed loop.
        spec: the owner's description if it differs from the one shipped under the same name, for example
            in its limits; joints must be the plant's.

    Raises:
        UsageError: unknown plant or engine, or a spec that does not fit the plant.
    """
    if name not in PLANTS:
        raise UsageError(
            f"there is no simulated robot {name!r}", next_step=f"Choose one of: {', '.join(PLANTS)}."
        )
    return PLANTS[name](name, spec if spec is not None else load_robot(name), engine)
