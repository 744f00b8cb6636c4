"""A kernel of one's own for the tables of the thesis."""

from etude.models import Linear, SquaredExponential


def two_parts(columns, commands):
    """A squared exponential over positions and velocities, and a line in the accelerations.

    Rigid bodies are linear in their accelerations, so a smooth kernel need not spend data on that.

    Args:
        columns: (channel, joint, unit, op) of each model input; here q_des, qd_des and qdd_des of each joint.
        commands: names of the commands that are learned together; here one.
    """
    accelerations = tuple(i for i, (channel, *_) in enumerate(columns) if channel.startswith("qdd"))
    others = tuple(i for i in range(len(columns)) if i not in accelerations)
    return SquaredExponential(others) + Linear(accelerations)
