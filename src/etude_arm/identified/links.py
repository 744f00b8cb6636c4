"""Every link of the model file as a body of its own: also those that a joint which is held, or none, carries.

Models fuse what moves as one. Here each keeps the parameters that the file gives it; what the logs cannot
tell apart is shared out as near to the file as it can be.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from etude.types import Array
from etude_arm.loading.inertia import NO_MASS
from etude_arm.loading.load import load_arm
from etude_arm.physics.kinematics import KinematicTree
from etude_arm.physics.rigid_tree import drives_from_mujoco, tree_from_mujoco
from etude_arm.physics.transmission import Drive
from etude_arm.spec import ArmSpec

FUSED, APART = 'fusestatic="true"', 'fusestatic="false"'


@dataclass(frozen=True, eq=False)
class Links:
    """Attributes:
    names: of the B - 1 bodies beside the world, as in the file.
    tree, drives: the robot's geometry with them.
    nominal: (P,) the file's parameters; zero where a body has no mass or does not move.
    """

    names: tuple[str, ...]
    tree: KinematicTree
    drives: tuple[Drive, ...]
    nominal: Array

    @property
    def told_of(self) -> tuple[tuple[str, slice], ...]:
        """Names and places in phi of the bodies that logs can say something of."""
        places = [slice(10 * b, 10 * b + 10) for b in range(len(self.names))]
        pairs = zip(self.names, places, strict=True)
        return tuple((name, place) for name, place in pairs if self.nominal[place.start] > 0.0)


def links_of(spec: ArmSpec) -> Links:
    """Of the robot's model file. Errors as `load_arm`."""
    loaded = load_arm(spec, shapes=False, drives=True)
    model = replace(loaded, xml=loaded.xml.replace(FUSED, APART)).model()
    tree = tree_from_mujoco(model, spec.names)
    bodies = [str(model.body(b).name) for b in range(1, model.nbody)]
    names = tuple(loaded.links.get(body, body) for body in bodies)
    nominal = tree.nominal[1:].copy()
    still = [not tree.path(b) or tree.nominal[b, 0] <= NO_MASS for b in range(1, model.nbody)]
    nominal[np.array(still)] = 0.0
    return Links(names, tree, drives_from_mujoco(model, spec.names), nominal.reshape(-1))
