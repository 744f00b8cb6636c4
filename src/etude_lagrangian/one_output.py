"""The Lagrangian prior of one command, compiled: covariances and, backwards, the gradients of their sums.

The command of joint k has the covariance Σ_{i>=k} K_i + potential, without a division; K_i is link i's
kinetic part. Inputs are packed as (4, J, n): S, C, w, u = sin q, cos q, velocity, acceleration; a slide has q
and 1. A row x is held against a strip of WIDTH columns z, primed below, and every statement is a loop over
the strip. All work rows lie in one array of constant width, so that the compiler knows that they do not
overlap: rows of their own first, then a block of rows for each joint. All parts are in this
file.

Parameters are one array (J + 5, J): a and b of the potential's factors, a and b of the kinetic ones, v of
each link and joint (J, J), and [u0², ...]. Of a slide b = 0.
"""

from __future__ import annotations

import numpy as np

from etude._runtime.loop_compiler import Part, loops
from etude.types import Array

WIDTH = 64  # columns in a strip: a multiple of a processor's lanes
EVERY, LOWER, SELF = 0, 1, 2
"""Which pairs: all, those with i >= j (and what shares their strip), or each input with itself."""
A_U, B_U, A_T, B_T, LINKS = 0, 1, 2, 3, 4
"""Rows of the parameters."""

# rows of their own: weights or values, powers p of joint k, the same times weights, and adjoints
K, P, GP, CHAIN, OWN, SUMS, HERE, BLOCKS = 0, 1, 5, 9, 13, 17, 21, 25
# rows of a joint's block: inputs, kinetic factor, chain before it, sums of its link, factor and chain of U
FIELDS, T, BEFORE, LINK, U, U_BEFORE, SIZE = 0, 4, 8, 12, 16, 17, 18


@Part
def _factor(work: Array, joint: int, a: float, b: float, S: float, C: float) -> None:
    """c = (a S S' + b C C' + 1)/2 and its derivatives in q, in q', and in both."""
    aS, aC, bS, bC = 0.5 * a * S, 0.5 * a * C, 0.5 * b * S, 0.5 * b * C
    for x in range(WIDTH):
        s, c = work[joint, x], work[joint + 1, x]
        work[joint + T, x] = aS * s + bC * c + 0.5
        work[joint + T + 1, x] = aC * s - bS * c
        work[joint + T + 2, x] = aS * c - bC * s
        work[joint + T + 3, x] = aC * c + bS * s


@Part
def _potential_factors(work: Array, k: int, p: Array, F: Array, i: int) -> None:
    """c of U for each joint, c_xz for joint k, and the products before each; the last is the potential's."""
    J = F.shape[1]
    first = BLOCKS + U_BEFORE
    for j in range(J):
        joint = BLOCKS + j * SIZE
        ha, hb = 0.5 * p[A_U, j], 0.5 * p[B_U, j]
        s, c, one = ha * F[0, j, i], hb * F[1, j, i], 0.5
        if j == k:
            s, c, one = hb * F[0, j, i], ha * F[1, j, i], 0.0
        for x in range(WIDTH):
            work[joint + U, x] = s * work[joint, x] + c * work[joint + 1, x] + one
    for x in range(WIDTH):
        work[first, x] = p[LINKS + J, 0] * work[BLOCKS + k * SIZE + U, x]
    for j in range(J):
        if j < k:
            here = BLOCKS + j * SIZE
            for x in range(WIDTH):
                work[here + SIZE + U_BEFORE, x] = work[here + U_BEFORE, x] * work[here + U, x]
        if j > k:
            here = BLOCKS + (j - 1) * SIZE
            for x in range(WIDTH):
                work[here + SIZE + U_BEFORE, x] = work[here + U_BEFORE, x] * work[here + SIZE + U, x]


@Part
def _chain_step(work: Array, before: int, joint: int, w: float) -> None:
    """(R, DR, D'R, DD'R) with one more joint in R = Π c²."""
    after = before + SIZE + BEFORE
    before = before + BEFORE
    for x in range(WIDTH):
        c, cx = work[joint + T, x], work[joint + T + 1, x]
        cz, wz = work[joint + T + 2, x], work[joint + 2, x]
        p, alpha, beta = c * c, 2.0 * w * c * cx, 2.0 * wz * c * cz
        gamma = 2.0 * w * wz * (cx * cz + c * work[joint + T + 3, x])
        R, DR, RD, DRD = work[before, x], work[before + 1, x], work[before + 2, x], work[before + 3, x]
        work[after, x] = R * p
        work[after + 1, x] = DR * p + R * alpha
        work[after + 2, x] = RD * p + R * beta
        work[after + 3, x] = DRD * p + DR * beta + RD * alpha + R * gamma


@Part
def _link_sums(work: Array, link: int, k: int, p: Array, F: Array, i: int) -> None:
    """Σ v {w w', w u', u w', u u'} over the joints of a link but k."""
    at = BLOCKS + link * SIZE + LINK
    for x in range(WIDTH):
        work[at, x] = 0.0
        work[at + 1, x] = 0.0
        work[at + 2, x] = 0.0
        work[at + 3, x] = 0.0
    for j in range(link + 1):
        if j == k:
            continue
        z = BLOCKS + j * SIZE
        vw, vu = p[LINKS + link, j] * F[2, j, i], p[LINKS + link, j] * F[3, j, i]
        for x in range(WIDTH):
            work[at, x] += vw * work[z + 2, x]
            work[at + 1, x] += vw * work[z + 3, x]
            work[at + 2, x] += vu * work[z + 2, x]
            work[at + 3, x] += vu * work[z + 3, x]


@Part
def _link_value(work: Array, link: int, k: int, v: float, w: float, u: float) -> None:
    """Adds K_i of a link."""
    at, z = BLOCKS + link * SIZE, BLOCKS + k * SIZE
    for x in range(WIDTH):
        R, DR = work[at + BEFORE, x], work[at + BEFORE + 1, x]
        RD, DRD = work[at + BEFORE + 2, x], work[at + BEFORE + 3, x]
        ww, wu = work[at + LINK, x], work[at + LINK + 1, x]
        uw, uu = work[at + LINK + 2, x], work[at + LINK + 3, x]
        wz, uz = work[z + 2, x], work[z + 3, x]
        mixed = (uu + 2.0 * v * u * uz) * R + (wu + 2.0 * v * w * uz) * DR
        mixed += (uw + 2.0 * v * u * wz) * RD + (ww + 2.0 * v * w * wz) * DRD
        value = work[P, x] * mixed * 2.0 * v
        value += 2.0 * v * v * w * w * work[P + 1, x] * (uz * R + wz * RD)
        value += 2.0 * v * v * wz * wz * work[P + 2, x] * (u * R + w * DR)
        work[K, x] += value + work[P + 3, x] * R * (ww * ww + v * v * w * w * wz * wz)


@Part
def _forward(work: Array, k: int, p: Array, F: Array, i: int) -> None:
    """Everything of row i that the way back needs; with `values`, the covariances too."""
    J = F.shape[1]
    block = BLOCKS + k * SIZE + T
    _potential_factors(work, k, p, F, i)
    for j in range(J):
        _factor(work, BLOCKS + j * SIZE, p[A_T, j], p[B_T, j], F[0, j, i], F[1, j, i])
    for x in range(WIDTH):
        c, cx, cz, cxz = work[block, x], work[block + 1, x], work[block + 2, x], work[block + 3, x]
        work[P, x] = c * c
        work[P + 1, x] = 2.0 * c * cx
        work[P + 2, x] = 2.0 * c * cz
        work[P + 3, x] = 2.0 * (cx * cz + c * cxz)
        work[BLOCKS + BEFORE, x] = 1.0
        work[BLOCKS + BEFORE + 1, x] = 0.0
        work[BLOCKS + BEFORE + 2, x] = 0.0
        work[BLOCKS + BEFORE + 3, x] = 0.0
    for j in range(k):
        _chain_step(work, BLOCKS + j * SIZE, BLOCKS + j * SIZE, F[2, j, i])
    for j in range(k, J):
        if j > k:
            _chain_step(work, BLOCKS + (j - 1) * SIZE, BLOCKS + j * SIZE, F[2, j, i])
        _link_sums(work, j, k, p, F, i)


@Part
def _values(work: Array, k: int, p: Array, F: Array, i: int) -> None:
    J = F.shape[1]
    for x in range(WIDTH):
        work[K, x] = work[BLOCKS + (J - 1) * SIZE + U_BEFORE, x]
    for link in range(k, J):
        _link_value(work, link, k, p[LINKS + link, k], F[2, k, i], F[3, k, i])


@Part
def _link_adjoints(work: Array, link: int, k: int, v: float, w: float, u: float) -> None:
    """What a link adds to the adjoints of the chain, of joint k's powers and of its sums."""
    at, z = BLOCKS + link * SIZE, BLOCKS + k * SIZE
    vv = 2.0 * v * v
    for x in range(WIDTH):
        ww, wz, uz = work[at + LINK, x], work[z + 2, x], work[z + 3, x]
        g, gx, gz = 2.0 * v * work[GP, x], vv * w * w * work[GP + 1, x], vv * wz * wz * work[GP + 2, x]
        square = ww * ww + 0.5 * vv * w * w * wz * wz
        work[CHAIN, x] += g * (work[at + LINK + 3, x] + 2.0 * v * u * uz) + gx * uz + gz * u
        work[CHAIN, x] += work[GP + 3, x] * square
        work[CHAIN + 1, x] += g * (work[at + LINK + 1, x] + 2.0 * v * w * uz) + gz * w
        work[CHAIN + 2, x] += g * (work[at + LINK + 2, x] + 2.0 * v * u * wz) + gx * wz
        work[CHAIN + 3, x] += g * (ww + 2.0 * v * w * wz)
    for x in range(WIDTH):
        R, DR = work[at + BEFORE, x], work[at + BEFORE + 1, x]
        RD, DRD = work[at + BEFORE + 2, x], work[at + BEFORE + 3, x]
        ww, wz, uz, g = work[at + LINK, x], work[z + 2, x], work[z + 3, x], work[K, x]
        mixed = (work[at + LINK + 3, x] + 2.0 * v * u * uz) * R
        mixed += (work[at + LINK + 1, x] + 2.0 * v * w * uz) * DR
        mixed += (work[at + LINK + 2, x] + 2.0 * v * u * wz) * RD + (ww + 2.0 * v * w * wz) * DRD
        work[OWN, x] += 2.0 * v * g * mixed
        work[OWN + 1, x] += vv * w * w * g * (uz * R + wz * RD)
        work[OWN + 2, x] += vv * wz * wz * g * (u * R + w * DR)
        work[OWN + 3, x] += g * R * (ww * ww + 0.5 * vv * w * w * wz * wz)
    for x in range(WIDTH):
        R, g = work[at + BEFORE, x], 2.0 * v * work[GP, x]
        work[SUMS, x] = g * work[at + BEFORE + 3, x] + 2.0 * work[at + LINK, x] * work[GP + 3, x] * R
        work[SUMS + 1, x] = g * work[at + BEFORE + 1, x]
        work[SUMS + 2, x] = g * work[at + BEFORE + 2, x]
        work[SUMS + 3, x] = g * R


@Part
def _link_gradients(work: Array, link: int, k: int, p: Array, F: Array, i: int, dF: Array, dp: Array) -> None:
    """From them to v of the link, and to w and u of row i."""
    at, z = BLOCKS + link * SIZE, BLOCKS + k * SIZE
    v, w, u = p[LINKS + link, k], F[2, k, i], F[3, k, i]
    vv = 2.0 * v * v
    to_v, to_w, to_u = 0.0, 0.0, 0.0
    for x in range(WIDTH):
        R, DR = work[at + BEFORE, x], work[at + BEFORE + 1, x]
        RD, DRD = work[at + BEFORE + 2, x], work[at + BEFORE + 3, x]
        wz, uz, g = work[z + 2, x], work[z + 3, x], 2.0 * work[GP, x]
        gx, gz, gxz = work[GP + 1, x], work[GP + 2, x] * wz * wz, work[GP + 3, x] * R * wz * wz
        along = uz * R + wz * RD
        back = uz * DR + wz * DRD
        sums = work[at + LINK + 3, x] * R + work[at + LINK + 1, x] * DR
        sums += work[at + LINK + 2, x] * RD + work[at + LINK, x] * DRD
        to_v += g * (sums + 4.0 * v * (u * along + w * back))
        to_v += 4.0 * v * (w * w * gx * along + gz * (u * R + w * DR)) + 2.0 * v * w * w * gxz
        to_u += vv * (g * along + gz * R)
        to_w += vv * (g * back + 2.0 * w * gx * along + gz * DR + w * gxz)
    dp[LINKS + link, k] += to_v
    dF[2, k, i] += to_w
    dF[3, k, i] += to_u
    for j in range(link + 1):
        if j == k:
            continue
        z = BLOCKS + j * SIZE
        on_w, on_u = 0.0, 0.0
        for x in range(WIDTH):
            wz, uz = work[z + 2, x], work[z + 3, x]
            on_w += work[SUMS, x] * wz + work[SUMS + 1, x] * uz
            on_u += work[SUMS + 2, x] * wz + work[SUMS + 3, x] * uz
        dp[LINKS + link, j] += F[2, j, i] * on_w + F[3, j, i] * on_u
        dF[2, j, i] += p[LINKS + link, j] * on_w
        dF[3, j, i] += p[LINKS + link, j] * on_u


@Part
def _chain_back(work: Array, before: int, joint: int, w: float) -> float:
    """The adjoints before a joint, those of its powers into HERE, and the gradient in its w."""
    before = before + BEFORE
    for x in range(WIDTH):
        R, DR, RD, DRD = work[before, x], work[before + 1, x], work[before + 2, x], work[before + 3, x]
        r, dr, rd, drd = work[CHAIN, x], work[CHAIN + 1, x], work[CHAIN + 2, x], work[CHAIN + 3, x]
        work[HERE, x] = drd * DRD + dr * DR + rd * RD + r * R
        work[HERE + 1, x] = drd * RD + dr * R
        work[HERE + 2, x] = drd * DR + rd * R
        work[HERE + 3, x] = drd * R
    to_w = 0.0
    for x in range(WIDTH):
        c, cx = work[joint + T, x], work[joint + T + 1, x]
        cz, wz = work[joint + T + 2, x], work[joint + 2, x]
        p, px, beta = c * c, 2.0 * c * cx, 2.0 * wz * c * cz
        pxz = 2.0 * (cx * cz + c * work[joint + T + 3, x])
        r, dr, rd, drd = work[CHAIN, x], work[CHAIN + 1, x], work[CHAIN + 2, x], work[CHAIN + 3, x]
        work[CHAIN, x] = r * p + dr * w * px + rd * beta + drd * w * wz * pxz
        work[CHAIN + 1, x] = dr * p + drd * beta
        work[CHAIN + 2, x] = rd * p + drd * w * px
        work[CHAIN + 3, x] = drd * p
        alpha, gamma = work[HERE + 1, x], work[HERE + 3, x]
        to_w += alpha * px + gamma * wz * pxz
        work[HERE + 1, x] = w * alpha
        work[HERE + 2, x] = wz * work[HERE + 2, x]
        work[HERE + 3, x] = w * wz * gamma
    return to_w


@Part
def _factor_gradients(work: Array, at: int, j: int, p: Array, F: Array, i: int, dF: Array, dp: Array) -> None:
    """From the adjoints of c² and its derivatives at rows `at` to a, b and row i's S and C of joint j."""
    joint = BLOCKS + j * SIZE
    s0, c0, s1, c1, s2, c2, s3, c3 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for x in range(WIDTH):
        c, cx, cz = work[joint + T, x], work[joint + T + 1, x], work[joint + T + 2, x]
        p0, px, pz, pxz = work[at, x], work[at + 1, x], work[at + 2, x], work[at + 3, x]
        S, C = work[joint, x], work[joint + 1, x]
        to_c = c * p0 + cx * px + cz * pz + work[joint + T + 3, x] * pxz
        to_x, to_z, to_xz = c * px + cz * pxz, c * pz + cx * pxz, c * pxz
        s0 += to_c * S
        c0 += to_c * C
        s1 += to_x * S
        c1 += to_x * C
        s2 += to_z * S
        c2 += to_z * C
        s3 += to_xz * S
        c3 += to_xz * C
    a, b, S, C = p[A_T, j], p[B_T, j], F[0, j, i], F[1, j, i]
    dp[A_T, j] += S * (s0 + c2) + C * (s1 + c3)
    dp[B_T, j] += C * (c0 - s2) + S * (s3 - c1)
    dF[0, j, i] += a * (s0 + c2) + b * (s3 - c1)
    dF[1, j, i] += a * (s1 + c3) + b * (c0 - s2)


@Part
def _potential_back(work: Array, k: int, p: Array, F: Array, i: int, dF: Array, dp: Array) -> None:
    """From the weights to the parameters of U and row i's S and C."""
    J = F.shape[1]
    for x in range(WIDTH):
        work[HERE, x] = work[K, x]
    for j in range(J - 1, -1, -1):
        if j == k:
            continue
        joint = BLOCKS + j * SIZE
        before = joint + U_BEFORE if j < k else joint - SIZE + U_BEFORE
        on_s, on_c = 0.0, 0.0
        for x in range(WIDTH):
            g = 0.5 * work[HERE, x] * work[before, x]
            on_s += g * work[joint, x]
            on_c += g * work[joint + 1, x]
            work[HERE, x] *= work[joint + U, x]
        dp[A_U, j] += F[0, j, i] * on_s
        dp[B_U, j] += F[1, j, i] * on_c
        dF[0, j, i] += p[A_U, j] * on_s
        dF[1, j, i] += p[B_U, j] * on_c
    joint = BLOCKS + k * SIZE
    on_s, on_c, on_u0 = 0.0, 0.0, 0.0
    for x in range(WIDTH):
        g = 0.5 * p[LINKS + J, 0] * work[HERE, x]
        on_s += g * work[joint, x]
        on_c += g * work[joint + 1, x]
        on_u0 += work[HERE, x] * work[joint + U, x]
    dp[A_U, k] += F[1, k, i] * on_c
    dp[B_U, k] += F[0, k, i] * on_s
    dF[0, k, i] += p[B_U, k] * on_s
    dF[1, k, i] += p[A_U, k] * on_c
    dp[LINKS + J, 0] += on_u0


@Part
def _backward(work: Array, k: int, p: Array, F: Array, i: int, dF: Array, dp: Array) -> None:
    """From the weights in K to the gradients."""
    J = F.shape[1]
    for x in range(WIDTH):
        work[GP, x] = work[K, x] * work[P, x]
        work[GP + 1, x] = work[K, x] * work[P + 1, x]
        work[GP + 2, x] = work[K, x] * work[P + 2, x]
        work[GP + 3, x] = work[K, x] * work[P + 3, x]
    for row in range(CHAIN, SUMS):
        for x in range(WIDTH):
            work[row, x] = 0.0
    _potential_back(work, k, p, F, i, dF, dp)
    for link in range(J - 1, -1, -1):
        if link >= k:
            _link_adjoints(work, link, k, p[LINKS + link, k], F[2, k, i], F[3, k, i])
            _link_gradients(work, link, k, p, F, i, dF, dp)
        if link != k:
            joint = BLOCKS + link * SIZE
            before = joint if link < k else joint - SIZE
            dF[2, link, i] += _chain_back(work, before, joint, F[2, link, i])
            _factor_gradients(work, HERE, link, p, F, i, dF, dp)
    _factor_gradients(work, OWN, k, p, F, i, dF, dp)


def sweep(
    k: int, p: Array, F: Array, Z: Array, pairs: int, G: Array, back: bool, dF: Array, dp: Array
) -> None:
    """Covariances of command k between packed inputs F (4, J, n) and Z (4, J, m), or their gradients.

    Args:
        p: (J + 5, J) parameters. pairs: EVERY, LOWER (Z is F) or SELF (Z is F, G (n, 1)).
        G: (n, m), C order: the covariances, or with `back` the weights of them.
        dF, dp: like F and p, with `back`: the gradients of sum(G * covariances) are added, Z held fixed.
    """
    work = np.zeros((BLOCKS + F.shape[1] * SIZE, WIDTH))
    _sweep(work, k, p, F, Z, pairs, G, back, dF, dp)


@loops({"work": WIDTH})
def _sweep(
    work: Array, k: int, p: Array, F: Array, Z: Array, pairs: int, G: Array, back: int, dF: Array, dp: Array
) -> None:
    J, n, m = F.shape[1], F.shape[2], Z.shape[2]
    width = 1 if pairs == SELF else WIDTH
    for start in range(0, m, width):
        count = min(width, m - start)
        column = 0 if pairs == SELF else start
        for j in range(J):
            for f in range(4):
                row = BLOCKS + j * SIZE + f
                for x in range(count):
                    work[row, x] = Z[f, j, start + x]
                for x in range(count, WIDTH):
                    work[row, x] = 0.0
        for i in range(0 if pairs == EVERY else start, start + 1 if pairs == SELF else n):
            _forward(work, k, p, F, i)
            if back:
                for x in range(count):
                    work[K, x] = G[i, column + x]
                for x in range(count, WIDTH):
                    work[K, x] = 0.0
                _backward(work, k, p, F, i, dF, dp)
            else:
                _values(work, k, p, F, i)
                for x in range(count):
                    G[i, column + x] = work[K, x]
