"""The Lagrangian polynomial prior: energies drawn from a process, commands by Lagrange's equations."""

from typing import TYPE_CHECKING

from etude._runtime.lazy import face

if TYPE_CHECKING:
    from etude_lagrangian.joints import Joints
    from etude_lagrangian.kernel import Lagrangian, gip_lin
    from etude_lagrangian.member import all_lin, data_together

__all__ = [
    "Joints",
    "Lagrangian",
    "all_lin",
    "data_together",
    "gip_lin",
]
__getattr__, __dir__ = face(__name__)
