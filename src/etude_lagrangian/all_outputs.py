"""The Lagrangian prior of all commands together, compiled: covariances, gradients of their sums, and means.

One kinetic and one potential energy serve all commands. Inputs, parameters, strips and work rows are those of
`one_output`; a row x has K_km = cov(command k at x, command m at z) for all k and m. This form divides by the
factors c, of which those nearer to zero than LEAST are taken to be LEAST away. Link i of P = Π c² adds

    P {2 a'_k a_m + 2 (e b'_k - y_k) b_m - 2 b'_k y'_m + s² ρ_k ρ'_m + δ_km [2 v_k (τ + s e) + s² σ_k]}

with α = u + d w, a = v α, b = v w, s = Σ v w w', t = Σ w' a, τ = Σ v α α', y_k = ρ_k t' + s w'_k σ_k, and
d = Σ w ρ, e = Σ w w' σ over its joints. All parts are in this file.
"""

from __future__ import annotations

import numpy as np

from etude._runtime.loop_compiler import Part, loops
from etude.types import Array

WIDTH = 32  # columns in a strip: a multiple of a processor's lanes
LEAST = 1e-9  # a factor may be divided out again
EVERY, LOWER, SELF = 0, 1, 2  # which pairs are summed
A_U, B_U, A_T, B_T, LINKS = 0, 1, 2, 3, 4  # rows of the parameters

# rows of their own: P, d, d', e of the links so far; s, t, t', τ of a link; adjoints and sums; Π of U
P, D, DZ, E, S, TAU = 0, 1, 2, 3, 4, 7
# rows of a strip's work, all joints together
AT, ATZ, AS, AX, ALL, Q, AQ, TOTAL, BLOCKS = 8, 9, 10, 11, 12, 13, 14, 15, 19
# rows of a joint's block: inputs; c, c_x, c_z, c_xz; ρ, ρ', σ; the same seven of U; α, α', a, a' and y, y';
# four sums over weights that know no v, four that do; adjoints of c..c_xz, of ρ, ρ', σ, of the link's P, d,
# d', e
FIELDS, C, R, RZ, SG, CU, RU, RUZ, QU, LINK = 0, 4, 8, 9, 10, 11, 15, 16, 17, 18
FREE, BOUND, BACK, BR, BRZ, BSG, BLINK, SIZE = 24, 28, 32, 36, 37, 38, 39, 43  # rows of a joint's own work


@Part
def _factor(work: Array, joint: int, at: int, a: float, b: float, sine: float, cosine: float) -> None:
    """c = (a S S' + b C C' + 1)/2, never zero, and its derivatives in q, in q', and in both."""
    aS, aC, bS, bC = 0.5 * a * sine, 0.5 * a * cosine, 0.5 * b * sine, 0.5 * b * cosine
    for x in range(WIDTH):
        s, c = work[joint, x], work[joint + 1, x]
        value = aS * s + bC * c + 0.5
        least = LEAST if value >= 0.0 else -LEAST
        work[joint + at, x] = value if abs(value) >= LEAST else least
        work[joint + at + 1, x] = aC * s - bS * c
        work[joint + at + 2, x] = aS * c - bC * s
        work[joint + at + 3, x] = aC * c + bS * s


@Part
def _ratios(work: Array, joint: int) -> None:
    """ρ, ρ', σ of the kinetic factor; c_x/c, c_z/c, c_xz/c of the potential's."""
    for x in range(WIDTH):
        one = 1.0 / work[joint + C, x]
        r, rz = 2.0 * one * work[joint + C + 1, x], 2.0 * one * work[joint + C + 2, x]
        work[joint + R, x] = r
        work[joint + RZ, x] = rz
        work[joint + SG, x] = 2.0 * one * work[joint + C + 3, x] - 0.5 * r * rz
    for x in range(WIDTH):
        one = 1.0 / work[joint + CU, x]
        work[joint + RU, x] = one * work[joint + CU + 1, x]
        work[joint + RUZ, x] = one * work[joint + CU + 2, x]
        work[joint + QU, x] = one * work[joint + CU + 3, x]


@Part
def _begin(work: Array, p: Array, F: Array, i: int) -> None:
    """Factors of row i, u0² Π c of the potential, and the running products and sums before any link."""
    J = F.shape[1]
    for x in range(WIDTH):
        work[Q, x] = p[LINKS + J, 0]
        work[P, x] = 1.0
        work[D, x] = 0.0
        work[DZ, x] = 0.0
        work[E, x] = 0.0
    for j in range(J):
        joint = BLOCKS + j * SIZE
        _factor(work, joint, C, p[A_T, j], p[B_T, j], F[0, j, i], F[1, j, i])
        _factor(work, joint, CU, p[A_U, j], p[B_U, j], F[0, j, i], F[1, j, i])
        _ratios(work, joint)
        for x in range(WIDTH):
            work[Q, x] *= work[joint + CU, x]


@Part
def _extend_chain(work: Array, link: int, p: Array, F: Array, i: int) -> None:
    """P, d, d', e with the joint of the next link, and that link's α, a, s, t, τ and y of its joints."""
    joint, w = BLOCKS + link * SIZE, F[2, link, i]
    for x in range(WIDTH):
        c, wz = work[joint + C, x], work[joint + 2, x]
        work[P, x] *= c * c
        work[D, x] += w * work[joint + R, x]
        work[DZ, x] += wz * work[joint + RZ, x]
        work[E, x] += w * wz * work[joint + SG, x]
        work[S, x] = 0.0
        work[S + 1, x] = 0.0
        work[S + 2, x] = 0.0
        work[TAU, x] = 0.0
    for j in range(link + 1):
        joint, v, w, u = BLOCKS + j * SIZE, p[LINKS + link, j], F[2, j, i], F[3, j, i]
        for x in range(WIDTH):
            wz = work[joint + 2, x]
            alpha, alphaz = u + w * work[D, x], work[joint + 3, x] + wz * work[DZ, x]
            work[joint + LINK, x] = alpha
            work[joint + LINK + 1, x] = alphaz
            work[joint + LINK + 2, x] = v * alpha
            work[joint + LINK + 3, x] = v * alphaz
            work[S, x] += v * w * wz
            work[S + 1, x] += v * wz * alpha
            work[S + 2, x] += v * w * alphaz
            work[TAU, x] += v * alpha * alphaz
    for j in range(link + 1):
        joint, w = BLOCKS + j * SIZE, F[2, j, i]
        for x in range(WIDTH):
            ssg = work[S, x] * work[joint + SG, x]
            work[joint + LINK + 4, x] = work[joint + R, x] * work[S + 2, x] + ssg * work[joint + 2, x]
            work[joint + LINK + 5, x] = work[joint + RZ, x] * work[S + 1, x] + ssg * w


@Part
def _values(work: Array, values: int, p: Array, F: Array, i: int) -> None:
    """All K_km of row i into the rows from `values` on, k J + m."""
    J = F.shape[1]
    for k in range(J):
        for m in range(J):
            one, other, out = BLOCKS + k * SIZE, BLOCKS + m * SIZE, values + k * J + m
            if k == m:
                for x in range(WIDTH):
                    work[out, x] = work[Q, x] * work[one + QU, x]
            else:
                for x in range(WIDTH):
                    work[out, x] = work[Q, x] * work[one + RU, x] * work[other + RUZ, x]
    for link in range(J):
        _extend_chain(work, link, p, F, i)
        for k in range(link + 1):
            one, v = BLOCKS + k * SIZE, p[LINKS + link, k]
            for x in range(WIDTH):
                b, r, s = v * work[one + 2, x], work[one + R, x], work[S, x]
                work[TOTAL, x] = 2.0 * work[P, x] * work[one + LINK + 3, x]
                work[TOTAL + 1, x] = 2.0 * work[P, x] * (work[E, x] * b - work[one + LINK + 4, x])
                work[TOTAL + 2, x] = -2.0 * work[P, x] * b
                work[TOTAL + 3, x] = work[P, x] * s * s * r
            for m in range(link + 1):
                other, out, b = BLOCKS + m * SIZE, values + k * J + m, p[LINKS + link, m] * F[2, m, i]
                for x in range(WIDTH):
                    value = work[TOTAL, x] * work[other + LINK + 2, x] + work[TOTAL + 1, x] * b
                    value += work[TOTAL + 2, x] * work[other + LINK + 5, x]
                    work[out, x] += value + work[TOTAL + 3, x] * work[other + RZ, x]
            out = values + k * J + k
            for x in range(WIDTH):
                s = work[S, x]
                diagonal = 2.0 * v * (work[TAU, x] + s * work[E, x]) + s * s * work[one + SG, x]
                work[out, x] += work[P, x] * diagonal


@Part
def _free_sums(work: Array, values: int, J: int, link: int, F: Array, i: int) -> None:
    """Σ_m G ρ'_m, Σ_m G w_m σ_m, Σ_k G ρ_k, Σ_k G w'_k σ_k: they grow with the joint of a link."""
    new, w = BLOCKS + link * SIZE, F[2, link, i]
    for x in range(WIDTH):
        work[new + FREE, x] = 0.0
        work[new + FREE + 1, x] = 0.0
        work[new + FREE + 2, x] = 0.0
        work[new + FREE + 3, x] = 0.0
    for j in range(link + 1):
        old, across, down, old_w = BLOCKS + j * SIZE, values + link * J + j, values + j * J + link, F[2, j, i]
        if j < link:
            for x in range(WIDTH):
                g, sg = work[down, x], work[new + SG, x]
                work[old + FREE, x] += g * work[new + RZ, x]
                work[old + FREE + 1, x] += g * w * sg
                g = work[across, x]
                work[old + FREE + 2, x] += g * work[new + R, x]
                work[old + FREE + 3, x] += g * work[new + 2, x] * sg
        for x in range(WIDTH):
            g, sg = work[across, x], work[old + SG, x]
            work[new + FREE, x] += g * work[old + RZ, x]
            work[new + FREE + 1, x] += g * old_w * sg
            g = work[down, x]
            work[new + FREE + 2, x] += g * work[old + R, x]
            work[new + FREE + 3, x] += g * work[old + 2, x] * sg


@Part
def _bound_sums(work: Array, values: int, J: int, link: int, p: Array, F: Array, i: int) -> None:
    """Σ_m G v_m w_m, Σ_m G v_m u_m for each k, and Σ_k G v_k w'_k, Σ_k G v_k u'_k for each m, of a link."""
    for k in range(link + 1):
        one = BLOCKS + k * SIZE
        for x in range(WIDTH):
            work[one + BOUND, x] = 0.0
            work[one + BOUND + 1, x] = 0.0
            work[one + BOUND + 2, x] = 0.0
            work[one + BOUND + 3, x] = 0.0
        for m in range(link + 1):
            v, across, down, other = (
                p[LINKS + link, m],
                values + k * J + m,
                values + m * J + k,
                BLOCKS + m * SIZE,
            )
            vw, vu = v * F[2, m, i], v * F[3, m, i]
            for x in range(WIDTH):
                g, h = work[across, x], v * work[down, x]
                work[one + BOUND, x] += g * vw
                work[one + BOUND + 1, x] += g * vu
                work[one + BOUND + 2, x] += h * work[other + 2, x]
                work[one + BOUND + 3, x] += h * work[other + 3, x]


@Part
def _link_totals(work: Array, values: int, J: int, link: int, p: Array, F: Array, i: int) -> None:
    """Adjoints that a link's joints share: of t, t', s and of its P, d, d', e, less what a' and a add."""
    at = BLOCKS + link * SIZE + BLINK
    for x in range(WIDTH):
        work[AX, x] = 0.0
        work[AT, x] = 0.0
        work[ATZ, x] = 0.0
        work[AS, x] = 0.0
        work[ALL, x] = 0.0
        work[at, x] = 0.0
        work[at + 1, x] = 0.0
        work[at + 2, x] = 0.0
        work[at + 3, x] = 0.0
    for k in range(link + 1):
        one, v, w, diagonal = BLOCKS + k * SIZE, p[LINKS + link, k], F[2, k, i], values + k * J + k
        for x in range(WIDTH):
            s, r, rz, sg = work[S, x], work[one + R, x], work[one + RZ, x], work[one + SG, x]
            gb, gbz, g = work[one + BOUND, x], work[one + BOUND + 2, x], work[diagonal, x]
            work[AX, x] += 2.0 * v * g
            work[ATZ, x] -= 2.0 * gb * r
            work[AT, x] -= 2.0 * gbz * rz
            work[AS, x] += 2.0 * (
                s * (r * work[one + FREE, x] + g * sg) - sg * (gb * work[one + 2, x] + gbz * w)
            )
            work[ALL, x] += 2.0 * v * work[one + 2, x] * gb
        for x in range(WIDTH):
            s, b, gb = work[S, x], v * work[one + 2, x], work[one + BOUND, x]
            ga = work[one + BOUND + 1, x] + work[D, x] * gb
            gy = work[S + 1, x] * work[one + FREE, x] + s * work[one + FREE + 1, x]
            total = work[one + LINK + 3, x] * ga + (work[E, x] * b - work[one + LINK + 4, x]) * gb - b * gy
            total += work[diagonal, x] * v * (work[TAU, x] + s * work[E, x])
            total += (
                0.5 * s * s * (work[one + R, x] * work[one + FREE, x] + work[diagonal, x] * work[one + SG, x])
            )
            work[at, x] += 2.0 * work[P, x] * total
    for x in range(WIDTH):
        work[AS, x] = work[P, x] * (work[AS, x] + work[E, x] * work[AX, x])
        work[at + 3, x] = work[P, x] * (work[S, x] * work[AX, x] + work[ALL, x])
        work[AX, x] *= work[P, x]
        work[AT, x] *= work[P, x]
        work[ATZ, x] *= work[P, x]


@Part
def _link_joints(
    work: Array, values: int, J: int, link: int, p: Array, F: Array, i: int, dF: Array, dp: Array
) -> None:
    """From a link to v, w and u of its joints, their ρ, ρ', σ, and its d and d'."""
    at = BLOCKS + link * SIZE + BLINK
    for k in range(link + 1):
        one, v, w, diagonal = BLOCKS + k * SIZE, p[LINKS + link, k], F[2, k, i], values + k * J + k
        for x in range(WIDTH):
            q, s, wz = work[P, x], work[S, x], work[one + 2, x]
            yb, yz = -2.0 * q * work[one + BOUND, x], -2.0 * q * work[one + BOUND + 2, x]
            work[one + BR, x] += yb * work[S + 2, x] + q * s * s * work[one + FREE, x]
            work[one + BRZ, x] += yz * work[S + 1, x] + q * s * s * work[one + FREE + 2, x]
            work[one + BSG, x] += s * (yb * wz + yz * w) + q * s * s * work[diagonal, x]
        for x in range(WIDTH):
            q, gb, gbz = work[P, x], work[one + BOUND, x], work[one + BOUND + 2, x]
            to_az = 2.0 * q * (work[one + BOUND + 1, x] + work[D, x] * gb) + work[ATZ, x] * w
            to_a = 2.0 * q * (work[one + BOUND + 3, x] + work[DZ, x] * gbz) + work[AT, x] * work[one + 2, x]
            alpha, alphaz, X = work[one + LINK, x], work[one + LINK + 1, x], work[AX, x]
            work[TOTAL, x] = v * (to_a + X * alphaz)
            work[TOTAL + 1, x] = to_a * alpha + to_az * alphaz + X * alpha * alphaz
            work[at + 1, x] += work[TOTAL, x] * w
            work[at + 2, x] += v * (to_az + X * alpha) * work[one + 2, x]
        to_v, to_w, to_u = 0.0, 0.0, 0.0
        for x in range(WIDTH):
            q, s, e, wz = work[P, x], work[S, x], work[E, x], work[one + 2, x]
            gb, gbz = work[one + BOUND, x], work[one + BOUND + 2, x]
            gy = work[S + 1, x] * work[one + FREE, x] + s * work[one + FREE + 1, x]
            gyz = work[S + 2, x] * work[one + FREE + 2, x] + s * work[one + FREE + 3, x]
            to_b, to_bz = 2.0 * q * (e * gbz - gyz), 2.0 * q * (e * gb - gy)
            to_v += work[TOTAL + 1, x] + to_b * w + to_bz * wz + work[AS, x] * w * wz
            to_v += 2.0 * q * work[diagonal, x] * (work[TAU, x] + s * e)
            to_u += work[TOTAL, x]
            to_w += -2.0 * q * gbz * s * work[one + SG, x] + work[ATZ, x] * work[one + LINK + 3, x]
            to_w += to_b * v + work[TOTAL, x] * work[D, x] + work[AS, x] * v * wz
        dp[LINKS + link, k] += to_v
        dF[2, k, i] += to_w
        dF[3, k, i] += to_u


@Part
def _gradients(
    work: Array, joint: int, at: int, a: int, j: int, p: Array, F: Array, i: int, dF: Array, dp: Array
) -> None:
    """From the adjoints of c, c_x, c_z, c_xz at rows `at` to a, b (rows a, a + 1) and row i's S and C."""
    s0, c0, s1, c1, s2, c2, s3, c3 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for x in range(WIDTH):
        sine, cosine = 0.5 * work[joint, x], 0.5 * work[joint + 1, x]
        s0 += work[at, x] * sine
        c0 += work[at, x] * cosine
        s1 += work[at + 1, x] * sine
        c1 += work[at + 1, x] * cosine
        s2 += work[at + 2, x] * sine
        c2 += work[at + 2, x] * cosine
        s3 += work[at + 3, x] * sine
        c3 += work[at + 3, x] * cosine
    sine, cosine = F[0, j, i], F[1, j, i]
    dp[a, j] += sine * (s0 + c2) + cosine * (s1 + c3)
    dp[a + 1, j] += cosine * (c0 - s2) + sine * (s3 - c1)
    dF[0, j, i] += p[a, j] * (s0 + c2) + p[a + 1, j] * (s3 - c1)
    dF[1, j, i] += p[a, j] * (s1 + c3) + p[a + 1, j] * (c0 - s2)


@Part
def _joints_back(work: Array, p: Array, F: Array, i: int, dF: Array, dp: Array) -> None:
    """Down the chain of links: their P, d, d', e add up, and each joint's factor gets what it is due."""
    J = F.shape[1]
    for x in range(WIDTH):
        work[TOTAL, x] = 0.0
        work[TOTAL + 1, x] = 0.0
        work[TOTAL + 2, x] = 0.0
        work[TOTAL + 3, x] = 0.0
    for j in range(J - 1, -1, -1):
        joint, w, to_w = BLOCKS + j * SIZE, F[2, j, i], 0.0
        for x in range(WIDTH):
            work[TOTAL, x] += work[joint + BLINK, x]
            work[TOTAL + 1, x] += work[joint + BLINK + 1, x]
            work[TOTAL + 2, x] += work[joint + BLINK + 2, x]
            work[TOTAL + 3, x] += work[joint + BLINK + 3, x]
        for x in range(WIDTH):
            wz, r, rz, sg = work[joint + 2, x], work[joint + R, x], work[joint + RZ, x], work[joint + SG, x]
            one = 1.0 / work[joint + C, x]
            to_w += work[TOTAL + 3, x] * wz * sg + work[TOTAL + 1, x] * r
            to_sg = work[joint + BSG, x] + work[TOTAL + 3, x] * w * wz
            to_r = work[joint + BR, x] + work[TOTAL + 1, x] * w - 0.5 * to_sg * rz
            to_rz = work[joint + BRZ, x] + work[TOTAL + 2, x] * wz - 0.5 * to_sg * r
            total = 2.0 * work[TOTAL, x] - 2.0 * one * work[joint + C + 3, x] * to_sg - to_r * r - to_rz * rz
            work[joint + BACK, x] = one * total
            work[joint + BACK + 1, x] = 2.0 * one * to_r
            work[joint + BACK + 2, x] = 2.0 * one * to_rz
            work[joint + BACK + 3, x] = 2.0 * one * to_sg
        dF[2, j, i] += to_w
        _gradients(work, joint, joint + BACK, A_T, j, p, F, i, dF, dp)


@Part
def _potential_back(work: Array, values: int, p: Array, F: Array, i: int, dF: Array, dp: Array) -> None:
    """From the weights to the parameters of U and row i's S and C."""
    J = F.shape[1]
    for x in range(WIDTH):
        work[AQ, x] = 0.0
    for k in range(J):
        one = BLOCKS + k * SIZE
        for x in range(WIDTH):
            work[one + BACK + 1, x] = 0.0
            work[one + BACK + 2, x] = 0.0
            work[one + BACK + 3, x] = work[values + k * J + k, x]
            work[AQ, x] += work[values + k * J + k, x] * work[one + QU, x]
        for m in range(J):
            other, across, down = BLOCKS + m * SIZE, values + k * J + m, values + m * J + k
            if m == k:
                continue
            for x in range(WIDTH):
                work[one + BACK + 1, x] += work[across, x] * work[other + RUZ, x]
                work[one + BACK + 2, x] += work[down, x] * work[other + RU, x]
        for x in range(WIDTH):
            work[AQ, x] += work[one + BACK + 1, x] * work[one + RU, x]
    to_u0 = 0.0
    for x in range(WIDTH):
        work[AQ, x] *= work[Q, x]
        to_u0 += work[AQ, x]
    dp[LINKS + J, 0] += to_u0 / p[LINKS + J, 0]
    for k in range(J):
        one = BLOCKS + k * SIZE
        for x in range(WIDTH):
            scale = 1.0 / work[one + CU, x]
            r = work[Q, x] * work[one + BACK + 1, x]
            rz = work[Q, x] * work[one + BACK + 2, x]
            q = work[Q, x] * work[one + BACK + 3, x]
            total = work[AQ, x] - r * work[one + RU, x] - rz * work[one + RUZ, x] - q * work[one + QU, x]
            work[one + BACK, x] = scale * total
            work[one + BACK + 1, x] = scale * r
            work[one + BACK + 2, x] = scale * rz
            work[one + BACK + 3, x] = scale * q
        _gradients(work, one, one + BACK, A_U, k, p, F, i, dF, dp)


@Part
def _backward(work: Array, values: int, p: Array, F: Array, i: int, dF: Array, dp: Array) -> None:
    """From the weights of all K_km to the gradients."""
    J = F.shape[1]
    _potential_back(work, values, p, F, i, dF, dp)
    for j in range(J):
        joint = BLOCKS + j * SIZE
        for x in range(WIDTH):
            work[joint + BR, x] = 0.0
            work[joint + BRZ, x] = 0.0
            work[joint + BSG, x] = 0.0
    for link in range(J):
        _extend_chain(work, link, p, F, i)
        _free_sums(work, values, J, link, F, i)
        _bound_sums(work, values, J, link, p, F, i)
        _link_totals(work, values, J, link, p, F, i)
        _link_joints(work, values, J, link, p, F, i, dF, dp)
    _joints_back(work, p, F, i, dF, dp)


@Part
def _strip(work: Array, Z: Array, start: int, count: int) -> None:
    for j in range(Z.shape[1]):
        for f in range(4):
            row = BLOCKS + j * SIZE + f
            for x in range(count):
                work[row, x] = Z[f, j, start + x]
            for x in range(count, WIDTH):
                work[row, x] = 0.0


def sweep_all(p: Array, F: Array, Z: Array, pairs: int, G: Array, back: bool, dF: Array, dp: Array) -> None:
    """Covariances of all commands between packed inputs F (4, J, n) and Z (4, J, m), or their gradients.

    Args:
        p: (J + 5, J) parameters. pairs: EVERY, LOWER (Z is F) or SELF (Z is F, m counted as 1 in G).
        G: (J, n, J, m), C order: covariances of command k at x and m at z, or with `back` their weights.
        dF, dp: like F and p, with `back`: the gradients of sum(G * covariances) are added, Z held fixed.
    """
    _sweep_all(_work(F.shape[1], F.shape[1] ** 2), p, F, Z, pairs, G, back, dF, dp)


def _work(joints: int, more: int) -> Array:
    """Rows of a strip's work, and as many more."""
    return np.zeros((BLOCKS + joints * SIZE + more, WIDTH))


@loops({"work": WIDTH})
def _sweep_all(
    work: Array, p: Array, F: Array, Z: Array, pairs: int, G: Array, back: int, dF: Array, dp: Array
) -> None:
    J, n, m = F.shape[1], F.shape[2], Z.shape[2]
    values = BLOCKS + J * SIZE
    width = 1 if pairs == SELF else WIDTH
    for start in range(0, m, width):
        count = min(width, m - start)
        column = 0 if pairs == SELF else start
        _strip(work, Z, start, count)
        for i in range(0 if pairs == EVERY else start, start + 1 if pairs == SELF else n):
            _begin(work, p, F, i)
            if not back:
                _values(work, values, p, F, i)
            for kl in range(J * J):
                k, other = kl // J, kl % J
                if back:
                    for x in range(count):
                        work[values + kl, x] = G[k, i, other, column + x]
                    for x in range(count, WIDTH):
                        work[values + kl, x] = 0.0
                else:
                    for x in range(count):
                        G[k, i, other, column + x] = work[values + kl, x]
            if back:
                _backward(work, values, p, F, i, dF, dp)


def means_all(p: Array, F: Array, Z: Array, alpha: Array, out: Array) -> None:
    """Σ of the covariances with Z (4, J, m) times alpha (J, m), into out (J, n): O(J²) a pair of inputs."""
    out[:] = 0.0
    _means_all(_work(F.shape[1], F.shape[1]), p, F, Z, alpha, out)


@loops({"work": WIDTH})
def _means_all(work: Array, p: Array, F: Array, Z: Array, alpha: Array, out: Array) -> None:
    J, n, m = F.shape[1], F.shape[2], Z.shape[2]
    weights = BLOCKS + J * SIZE
    for start in range(0, m, WIDTH):
        count = min(WIDTH, m - start)
        _strip(work, Z, start, count)
        for j in range(J):
            for x in range(count):
                work[weights + j, x] = alpha[j, start + x]
            for x in range(count, WIDTH):
                work[weights + j, x] = 0.0
        for i in range(n):
            _begin(work, p, F, i)
            _potential_means(work, weights, J, i, out)
            for link in range(J):
                _extend_chain(work, link, p, F, i)
                _link_means(work, weights, link, p, F, i, out)


@Part
def _potential_means(work: Array, weights: int, J: int, i: int, out: Array) -> None:
    for x in range(WIDTH):
        work[AQ, x] = 0.0
    for m in range(J):
        for x in range(WIDTH):
            work[AQ, x] += work[weights + m, x] * work[BLOCKS + m * SIZE + RUZ, x]
    for k in range(J):
        one, total = BLOCKS + k * SIZE, 0.0
        for x in range(WIDTH):
            diagonal = work[one + QU, x] - work[one + RU, x] * work[one + RUZ, x]
            total += work[Q, x] * (work[one + RU, x] * work[AQ, x] + work[weights + k, x] * diagonal)
        out[k, i] += total


@Part
def _link_means(work: Array, weights: int, link: int, p: Array, F: Array, i: int, out: Array) -> None:
    for x in range(WIDTH):
        work[TOTAL, x] = 0.0
        work[TOTAL + 1, x] = 0.0
        work[TOTAL + 2, x] = 0.0
        work[TOTAL + 3, x] = 0.0
    for m in range(link + 1):
        one, b = BLOCKS + m * SIZE, p[LINKS + link, m] * F[2, m, i]
        for x in range(WIDTH):
            alpha = work[weights + m, x]
            work[TOTAL, x] += alpha * work[one + RZ, x]
            work[TOTAL + 1, x] += alpha * work[one + LINK + 2, x]
            work[TOTAL + 2, x] += alpha * b
            work[TOTAL + 3, x] += alpha * work[one + LINK + 5, x]
    for k in range(link + 1):
        one, v, total = BLOCKS + k * SIZE, p[LINKS + link, k], 0.0
        for x in range(WIDTH):
            s, e, b = work[S, x], work[E, x], v * work[one + 2, x]
            value = 2.0 * work[one + LINK + 3, x] * work[TOTAL + 1, x]
            value += (
                2.0 * (e * b - work[one + LINK + 4, x]) * work[TOTAL + 2, x] - 2.0 * b * work[TOTAL + 3, x]
            )
            value += s * s * work[one + R, x] * work[TOTAL, x]
            diagonal = 2.0 * v * (work[TAU, x] + s * e) + s * s * work[one + SG, x]
            total += work[P, x] * (value + work[weights + k, x] * diagonal)
        out[k, i] += total
