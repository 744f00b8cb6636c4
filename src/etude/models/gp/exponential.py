"""exp of the exponents of a kernel, many at once: where most of the time of Gaussian processes goes.

NumPy calls the C library for each number where the processor has no AVX-512. This is the same algorithm,
compiled into the loop, so that the processor works on several numbers at once; results are the same bits as
those of glibc 2.36, and the same on every processor. With x = k ln 2 / 128 + r, exp(x) is 2^(k / 128) exp(r):
a table and a polynomial in r. Source: Szabolcs Nagy, exp.c of Arm Optimized Routines, 2018, whose
coefficients these are. docs/decisions/0069-loop-compiler.md has the times.
"""

from __future__ import annotations

from decimal import Decimal, localcontext

import numpy as np

from etude._runtime.loop_compiler import bits, fused, fused_in_one_instruction, loops, number
from etude.types import Array

STEPS = 128  # of the table, in an octave
PER_UNIT = float.fromhex("0x1.71547652b82fep0") * STEPS  # STEPS / ln 2
# -ln 2 / STEPS in two parts, so that k times the first is exact
HIGH, LOW = float.fromhex("-0x1.62e42fefa0000p-8"), float.fromhex("-0x1.cf79abc9e3b39p-47")
# of r², r³, r⁴, r⁵: minimax on |r| <= ln 2 / 256
C2, C3 = float.fromhex("0x1.ffffffffffdbdp-2"), float.fromhex("0x1.555555555543cp-3")
C4, C5 = float.fromhex("0x1.55555cf172b91p-5"), float.fromhex("0x1.1111167a4d017p-7")
ROUNDER = float.fromhex("0x1.8p52")  # adding it leaves the nearest integer in the low bits
LEAST_FUSED = -512.0  # below it the C library takes another path, whose products are not fused
LEAST, MOST = -700.0, 700.0  # between them, results are far from those that are no normal numbers


def _table() -> Array:
    """(2 STEPS,) for i / STEPS: the part that the number lacks of 2^(i / STEPS), and the number's bits.

    The bits are less i << 45, so that k << 45 adds the whole octaves.
    """
    table = np.empty(2 * STEPS)
    with localcontext() as context:
        context.prec = 40
        step = Decimal(2).ln() / STEPS
        for i in range(STEPS):
            exact = (step * i).exp()
            near = float(exact)
            table[2 * i] = float(exact / Decimal(near) - 1)
            table[2 * i + 1] = near
    table.view(np.int64)[1::2] -= np.arange(STEPS) << 45
    return table


TABLE = _table()


def exponentials_in_place(K: Array, most: float, rows: slice, columns: slice) -> None:
    """K[rows, columns] of a C-contiguous K (n, m) become exp(min(., most)); NaN stays."""
    part = K[rows, columns]
    if most > MOST or not fused_in_one_instruction():
        np.exp(np.minimum(part, most, out=part), out=part)
        return
    left = np.zeros(1)
    bounds = (*rows.indices(len(K))[:2], *columns.indices(K.shape[1])[:2])
    _exponentials(K, *bounds, np.array([most]), left)
    if left[0]:
        others = ~(part > 0.0)
        part[others] = np.exp(part[others])


@loops(exact=True)
def _exponentials(K: Array, first: int, last: int, left: int, right: int, most: Array, others: Array) -> None:
    """As `exponentials_in_place`; what is below LEAST or no number stays, and is counted in `others`."""
    count = 0
    limit = most[0]
    for i in range(first, last):
        for j in range(left, right):
            x = limit if K[i, j] > limit else K[i, j]
            rounded = fused(PER_UNIT, x, ROUNDER)
            k = bits(rounded)
            whole = rounded - ROUNDER
            r = fused(whole, LOW, fused(whole, HIGH, x))
            place = 2 * (k & (STEPS - 1))
            square = r * r
            low = fused(square, fused(r, C3, C2), TABLE[place] + r)
            rest = fused(square * square, fused(r, C5, C4), low)
            scale = number(bits(TABLE[place + 1]), k << 45)
            y = fused(scale, rest, scale) if x > LEAST_FUSED else scale + scale * rest
            K[i, j] = y if x > LEAST else x
            count += 0 if x > LEAST else 1
    others[0] = count
