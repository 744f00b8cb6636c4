"""The structured kernel of joints 0, 1, ..., whose inputs are [q, qd, qdd, friction columns]."""

from __future__ import annotations

from etude.models import Kernel, structured


def structured_kernel(dof: int, axis: int, frictions: int = 1) -> Kernel:
    channels = [("q", ""), ("qd", ""), ("qdd", ""), *[("qd", "tanh")] * frictions]
    columns = [(channel, str(part), "", op) for channel, op in channels for part in range(dof)]
    return structured(columns, (str(axis),))
