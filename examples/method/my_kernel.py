"""A kernel of one's own, to be put into the tables of the thesis.

    PYTHONPATH=examples/method etude study run table-6.9 --seeds 5 --method my_kernel:two_parts

Every row that takes a kernel gets a second row with this one, on the same trajectories, tests and seeds.
"""

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
