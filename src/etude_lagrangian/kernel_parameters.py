"""Log hyperparameters of the Lagrangian prior, and the array of them that the compiled sweeps take."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from etude.models.gp.kernel_algebra import Role
from etude.types import Array

A_U, B_U, A_T, B_T, LINKS = 0, 1, 2, 3, 4
"""Rows of the array (J + 5, J): factors of potential and kinetic energy, v by link and joint, [u0², ...]."""


@dataclass(frozen=True)
class Parameters:
    """theta = log(u0, √a and √b of the potential, v of links and joints, √a and √b of the kinetic energy).

    A slide has no b. Links share the factors of their kinetic energy.

    Attributes:
        slides: (J,) whether a joint is prismatic. first: first link that counts; those before it move
            without the joint.
    """

    slides: tuple[bool, ...]
    first: int = 0

    @cached_property
    def _entries(self) -> list[tuple[str, int, int, float]]:
        """Name, place in the array, and power of each."""
        J = len(self.slides)
        turning = [j for j in range(J) if not self.slides[j]]
        links = [(i, j) for i in range(self.first, J) for j in range(i + 1)]
        return [
            ("potential", LINKS + J, 0, 2.0),
            *((f"potential_sin[{j}]", A_U, j, 2.0) for j in range(J)),
            *((f"potential_cos[{j}]", B_U, j, 2.0) for j in turning),
            *((f"inertia[{i},{j}]", LINKS + i, j, 1.0) for i, j in links),
            *((f"inertia_sin[{j}]", A_T, j, 2.0) for j in range(J)),
            *((f"inertia_cos[{j}]", B_T, j, 2.0) for j in turning),
        ]

    @cached_property
    def _places(self) -> tuple[list[int], list[int], Array]:
        _, rows, columns, powers = zip(*self._entries, strict=True)
        return list(rows), list(columns), np.array(powers)

    def names(self) -> tuple[str, ...]:
        """Of each entry of theta."""
        return tuple(name for name, *_ in self._entries)

    def roles(self) -> tuple[Role, ...]:
        """The potential's scale is an amplitude; all else is as wide as a slope."""
        others: list[Role] = ["slope"] * (len(self._entries) - 1)
        return ("amplitude", *others)

    def array(self, theta: Array) -> Array:
        """(J + 5, J)."""
        rows, columns, powers = self._places
        p = np.zeros((LINKS + len(self.slides) + 1, len(self.slides)))
        p[rows, columns] = np.exp(powers * theta)
        return p

    def theta(self, p: Array) -> Array:
        """The logarithms of an array."""
        rows, columns, powers = self._places
        return np.asarray(np.log(p[rows, columns]) / powers)

    def pulled(self, p: Array, dp: Array) -> Array:
        """Gradient in theta of what has the gradient dp in the array p."""
        rows, columns, powers = self._places
        return np.asarray(powers * p[rows, columns] * dp[rows, columns])

    def start(self, half_positions: Array, half_accelerations: Array, potential: Array, v: Array) -> Array:
        """theta to train from.

        Args:
            half_positions, half_accelerations: (J,) half ranges of q and u.
            potential: (J + 1,) u0, and a and b of its factors on turning joints.
            v: (J, J) by link and joint, times u.
        """
        J = len(self.slides)
        slide = np.where(self.slides, 1.0 / half_positions**2, 1.0)
        p = np.ones((LINKS + J + 1, J))
        p[A_U], p[B_U], p[A_T], p[B_T] = potential[1:] * slide, potential[1:], slide, 1.0
        p[LINKS : LINKS + J] = v / half_accelerations
        p[LINKS + J, 0] = potential[0] ** 2
        return self.theta(p)
