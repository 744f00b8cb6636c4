"""The functions that the paper of LWPR learns, and an uncompiled receptive field from its tables."""

from __future__ import annotations

import numpy as np


def cross(x: np.ndarray) -> np.ndarray:
    """Two ridges and a hill on [-1, 1]², (n,)."""
    a, b = x[:, 0], x[:, 1]
    parts = (np.exp(-10.0 * a**2), np.exp(-50.0 * b**2), 1.25 * np.exp(-5.0 * (a**2 + b**2)))
    return np.maximum.reduce(parts)


def cross_in(inputs: int, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """n samples of the cross, its plane turned into a space of that many inputs; no noise."""
    x = rng.uniform(-1.0, 1.0, size=(n, 2))
    turn = np.linalg.qr(np.random.default_rng(inputs).normal(size=(inputs, inputs)))[0]
    return (x if inputs == 2 else x @ turn[:2]), cross(x)


class PlainField:
    """One receptive field with r directions and without a metric to learn: table 2 of the paper, eq. 12."""

    def __init__(self, inputs: int, directions: int, forget: float) -> None:
        self.forget, self.W, self.y0, self.x0 = forget, 0.0, 0.0, np.zeros(inputs)
        self.u, self.SZ = np.zeros((directions, inputs)), np.zeros((directions, inputs))
        self.SS, self.SR = np.full(directions, 1e-10), np.zeros(directions)
        self.H, self.G, self.E = np.zeros(directions), np.zeros(directions), 0.0

    def update(self, x: np.ndarray, y: float, w: float) -> None:
        k, W = self.forget, self.forget * self.W + w
        self.x0 = (k * self.W * self.x0 + w * x) / W
        self.y0 = (k * self.W * self.y0 + w * y) / W
        self.W, z, e, s = W, x - self.x0, y - self.y0, np.zeros(len(self.u))
        for i in range(len(self.u)):
            self.u[i] = k * self.u[i] + w * z * e
            length = np.linalg.norm(self.u[i])
            s[i] = z @ self.u[i] / length if length > 0.0 else 0.0
            self.SS[i] = k * self.SS[i] + w * s[i] ** 2
            self.SR[i] = k * self.SR[i] + w * s[i] * e
            self.SZ[i] = k * self.SZ[i] + w * s[i] * z
            z = z - s[i] * self.SZ[i] / max(self.SS[i], 1e-10)
            e = e - s[i] * self.SR[i] / max(self.SS[i], 1e-10)
        free = max(1.0 - w * np.sum(s**2 / np.maximum(self.SS, 1e-10)), 0.1)
        self.E = k * self.E + w * (e / free) ** 2
        self.H = k * self.H + w * (e / free) * s / free
        self.G = k * self.G + w**2 * (e / free) ** 2 * s**2 / free

    def predict(self, x: np.ndarray) -> tuple[float, float]:
        """Mean, and sᵀ P s."""
        z, mean, h = x - self.x0, self.y0, 0.0
        for i in range(len(self.u)):
            s = z @ self.u[i] / np.linalg.norm(self.u[i])
            mean += s * self.SR[i] / self.SS[i]
            h += s**2 / self.SS[i]
            z = z - s * self.SZ[i] / self.SS[i]
        return mean, h
