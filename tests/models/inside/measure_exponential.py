"""Nanoseconds that the exponential of one number takes in NumPy and in Étude, the least of 400 turns.

python tests/models/inside/measure_exponential.py
"""

from __future__ import annotations

import timeit

import numpy as np

from etude.models.gp.exponential import exponentials_in_place

EXPONENTS = -np.random.default_rng(0).exponential(5.0, (64, 1000))


def main() -> None:
    """Prints both."""
    K, all_of = np.empty_like(EXPONENTS), slice(None)
    turns = {
        "NumPy": lambda: np.exp(EXPONENTS, out=K),
        "copy": lambda: np.copyto(K, EXPONENTS),
        "Étude, with a copy": lambda: (
            np.copyto(K, EXPONENTS),
            exponentials_in_place(K, 0.0, all_of, all_of),
        ),
    }
    for name, turn in turns.items():
        print(f"{name} {1e9 * min(timeit.repeat(turn, number=1, repeat=400)) / K.size:.2f}")


if __name__ == "__main__":
    main()
