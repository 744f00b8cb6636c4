"""How far joints can carry points of a robot: distances from their axes, over all poses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from etude.types import Array, Mask


def reaches(
    points: Array,
    beyond: Array,
    chain: Sequence[int],
    joints: tuple[Array, Array],
    slides: Mask,
    added: Array,
) -> Array:
    """(k,) L: none of the points is ever farther from that joint's axis; 0 of joints not in the chain.

    Of a slide it is 1. Else along the chain from the joint to the points: the next anchor's distance from
    the axis, the lengths between further anchors, the farthest point from the last one, and what slides
    in between can add.

    Args:
        points: (V, 3) m in the room, in one pose. beyond: (V,) m, radii around them.
        chain: places of the joints that move them, the innermost first.
        joints: anchors and axes (k, 3) in that pose.
        slides: (k,) which joints slide. added: (k,) m that each slide can go from there.
    """
    anchors, axes = joints
    found, outside = np.zeros(len(slides)), points
    for j in chain[::-1]:
        across = np.linalg.norm(np.cross(outside - anchors[j], axes[j]), axis=1)
        found[j] = 1.0 if slides[j] else float((across + beyond).max())
        far = np.linalg.norm(outside - anchors[j], axis=1) + beyond
        outside, beyond = anchors[[j]], np.array([far.max() + added[j]])
    return found


def bent(reach: Array, chain: Sequence[int], rates: Sequence[Array]) -> Array:
    """Bounds of the second and third time derivatives of points with these reaches, m/s^2 and m/s^3.

    No point bends by more than L_j along several joints of which j is the outermost one, so

        |p''|  <= sum_j L_j A_j + sum_ij L_ij V_i V_j,
        |p'''| <= sum_j L_j J_j + 3 sum_ij L_ij A_i V_j + sum_ijk L_ijk V_i V_j V_k.

    Args:
        reach: (k,) L. chain: the innermost first.
        rates: largest |qd|, |qdd| and, for the third derivative, |qddd|, (k,) each.
    """
    L = reach[list(chain)]
    V, A = rates[0][list(chain)], rates[1][list(chain)]
    inner = np.cumsum(V) - V
    pairs = float(L @ (V * V + 2.0 * V * inner))  # of pairs, the outer one counts
    second = float(L @ A) + pairs
    if len(rates) < 3:
        return np.array([second, np.inf])
    below = np.cumsum(A) - A
    mixed = float(L @ (A * V + A * inner + below * V))
    triples = float(L @ (V**3 + 3.0 * V**2 * inner + 3.0 * V * inner**2))
    return np.array([second, float(L @ rates[2][list(chain)]) + 3.0 * mixed + triples])
