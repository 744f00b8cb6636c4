/* Rows of the work: P, d, d', e of the links so far, s, t, t', tau of a link, the potential, four sums; then of
   each joint its inputs, c and its derivatives, rho, rho', sigma, the same of the potential, and of its link
   alpha, alpha', a, a', y, y'; then J x J covariances. */
#define @K_STRIP 16
enum {
    @K_Q = 8, @K_TOTAL = 9, @K_BLOCKS = 13, @K_C = 4, @K_R = 8, @K_SG = 10, @K_CU = 11, @K_QU = 17, @K_LINK = 18,
    @K_SIZE = 24, @K_OUT = @K_BLOCKS + @J * @K_SIZE, @K_ROWS = @K_OUT + @J * @J
};

static void @K_factor(real (*joint)[@K_STRIP], int at, real a, real b, real sine, real cosine)
{
    const real aS = R(0.5) * a * sine, aC = R(0.5) * a * cosine, bS = R(0.5) * b * sine, bC = R(0.5) * b * cosine;
    int x;
    for (x = 0; x < @K_STRIP; ++x) {
        const real s = joint[0][x], c = joint[1][x], value = aS * s + bC * c + R(0.5);
        const real least = value >= R(0.0) ? R(1.0e-9) : R(-1.0e-9);
        joint[at][x] = FABS(value) >= R(1.0e-9) ? value : least;
        joint[at + 1][x] = aC * s - bS * c;
        joint[at + 2][x] = aS * c - bC * s;
        joint[at + 3][x] = aC * c + bS * s;
    }
}

static void @K_begin(const real *F, real (*work)[@K_STRIP])
{
    const real *const p = @K_parameters;
    int x, j;
    for (x = 0; x < @K_STRIP; ++x) {
        work[@K_Q][x] = p[(4 + @J) * @J];
        work[0][x] = R(1.0);
        work[1][x] = R(0.0);
        work[2][x] = R(0.0);
        work[3][x] = R(0.0);
    }
    for (j = 0; j < @J; ++j) {
        real(*const joint)[@K_STRIP] = work + @K_BLOCKS + j * @K_SIZE;
        @K_factor(joint, @K_C, p[2 * @J + j], p[3 * @J + j], F[j], F[@J + j]);
        @K_factor(joint, @K_CU, p[j], p[@J + j], F[j], F[@J + j]);
        for (x = 0; x < @K_STRIP; ++x) {
            const real one = R(1.0) / joint[@K_C][x], u = R(1.0) / joint[@K_CU][x];
            const real r = R(2.0) * one * joint[@K_C + 1][x], rz = R(2.0) * one * joint[@K_C + 2][x];
            const real cu = joint[@K_CU][x];
            joint[@K_R][x] = r;
            joint[@K_R + 1][x] = rz;
            joint[@K_SG][x] = R(2.0) * one * joint[@K_C + 3][x] - R(0.5) * r * rz;
            joint[@K_QU - 2][x] = u * joint[@K_CU + 1][x];
            joint[@K_QU - 1][x] = u * joint[@K_CU + 2][x];
            joint[@K_QU][x] = u * joint[@K_CU + 3][x];
            work[@K_Q][x] *= cu;
        }
    }
}

static void @K_grow(const real *F, real (*work)[@K_STRIP], int link)
{
    const real *const v = @K_parameters + (4 + link) * @J;
    const real w = F[2 * @J + link];
    real(*joint)[@K_STRIP] = work + @K_BLOCKS + link * @K_SIZE;
    int x, j;
    for (x = 0; x < @K_STRIP; ++x) {
        const real c = joint[@K_C][x], wz = joint[2][x];
        work[0][x] *= c * c;
        work[1][x] += w * joint[@K_R][x];
        work[2][x] += wz * joint[@K_R + 1][x];
        work[3][x] += w * wz * joint[@K_SG][x];
        work[4][x] = R(0.0);
        work[5][x] = R(0.0);
        work[6][x] = R(0.0);
        work[7][x] = R(0.0);
    }
    for (j = 0; j <= link; ++j) {
        const real wj = F[2 * @J + j], uj = F[3 * @J + j];
        joint = work + @K_BLOCKS + j * @K_SIZE;
        for (x = 0; x < @K_STRIP; ++x) {
            const real wz = joint[2][x], alpha = uj + wj * work[1][x], alphaz = joint[3][x] + wz * work[2][x];
            joint[@K_LINK][x] = alpha;
            joint[@K_LINK + 1][x] = alphaz;
            joint[@K_LINK + 2][x] = v[j] * alpha;
            joint[@K_LINK + 3][x] = v[j] * alphaz;
            work[4][x] += v[j] * wj * wz;
            work[5][x] += v[j] * wz * alpha;
            work[6][x] += v[j] * wj * alphaz;
            work[7][x] += v[j] * alpha * alphaz;
        }
    }
    for (j = 0; j <= link; ++j) {
        const real wj = F[2 * @J + j];
        joint = work + @K_BLOCKS + j * @K_SIZE;
        for (x = 0; x < @K_STRIP; ++x) {
            const real ssg = work[4][x] * joint[@K_SG][x];
            joint[@K_LINK + 4][x] = joint[@K_R][x] * work[6][x] + ssg * joint[2][x];
            joint[@K_LINK + 5][x] = joint[@K_R + 1][x] * work[5][x] + ssg * wj;
        }
    }
}

/* Rows @K_OUT + k J + m: covariances of command k at F (4, J) with command m at the inputs in the joints' rows. */
static void @K_values(const real *F, real (*work)[@K_STRIP])
{
    int x, k, m, link;
    @K_begin(F, work);
    for (k = 0; k < @J; ++k)
        for (m = 0; m < @J; ++m) {
            real(*const one)[@K_STRIP] = work + @K_BLOCKS + k * @K_SIZE;
            real(*const other)[@K_STRIP] = work + @K_BLOCKS + m * @K_SIZE;
            for (x = 0; x < @K_STRIP; ++x)
                work[@K_OUT + k * @J + m][x] =
                    work[@K_Q][x] * (k == m ? one[@K_QU][x] : one[@K_QU - 2][x] * other[@K_QU - 1][x]);
        }
    for (link = 0; link < @J; ++link) {
        const real *const v = @K_parameters + (4 + link) * @J;
        @K_grow(F, work, link);
        for (k = 0; k <= link; ++k) {
            real(*const one)[@K_STRIP] = work + @K_BLOCKS + k * @K_SIZE;
            real(*const sums)[@K_STRIP] = work + @K_TOTAL, (*const own)[@K_STRIP] = work + @K_OUT + k * @J + k;
            for (x = 0; x < @K_STRIP; ++x) {
                const real b = v[k] * one[2][x], s = work[4][x], P = work[0][x];
                sums[0][x] = R(2.0) * P * one[@K_LINK + 3][x];
                sums[1][x] = R(2.0) * P * (work[3][x] * b - one[@K_LINK + 4][x]);
                sums[2][x] = R(-2.0) * P * b;
                sums[3][x] = P * s * s * one[@K_R][x];
            }
            for (m = 0; m <= link; ++m) {
                real(*const other)[@K_STRIP] = work + @K_BLOCKS + m * @K_SIZE;
                real(*const out)[@K_STRIP] = work + @K_OUT + k * @J + m;
                const real b = v[m] * F[2 * @J + m];
                for (x = 0; x < @K_STRIP; ++x)
                    out[0][x] += sums[0][x] * other[@K_LINK + 2][x] + sums[1][x] * b +
                                 sums[2][x] * other[@K_LINK + 5][x] + sums[3][x] * other[@K_R + 1][x];
            }
            for (x = 0; x < @K_STRIP; ++x) {
                const real s = work[4][x];
                own[0][x] += work[0][x] * (R(2.0) * v[k] * (work[7][x] + s * work[3][x]) + s * s * one[@K_SG][x]);
            }
        }
    }
}

static void @K(const real *x, real *mean, real *variance)
{
    real F[4 * @J], work[@K_ROWS][@K_STRIP];
#if VARIANCE
    real every[@J][@J * @COUNT], own[@USED];
#endif
    int start, i, j, k, r;
    @K_packed(x, F);
    for (j = 0; j < @J; ++j)
        mean[j] = R(0.0);
    for (start = 0; start < @COUNT; start += @K_STRIP) {
        for (j = 0; j < @J; ++j)
            for (r = 0; r < 4; ++r)
                for (i = 0; i < @K_STRIP; ++i)
                    work[@K_BLOCKS + j * @K_SIZE + r][i] = @K_points[r * @J + j][start + i];
        @K_values(F, work);
        for (k = 0; k < @J; ++k) {
            real lanes[@K_STRIP] = {R(0.0)};
            for (j = 0; j < @J; ++j)
                for (i = 0; i < @K_STRIP; ++i) {
                    const real value = work[@K_OUT + k * @J + j][i];
                    lanes[i] += value * @K_weights[j * @COUNT + start + i];
#if VARIANCE
                    every[k][j * @COUNT + start + i] = value;
#endif
                }
            for (i = 0; i < @K_STRIP; ++i)
                mean[k] += lanes[i];
        }
    }
@MEANS
#if VARIANCE
    if (variance) {
        real enough[@J];
        for (k = 0; k < @J; ++k)
            enough[k] = variance[k];
        for (j = 0; j < @J; ++j)
            for (r = 0; r < 4; ++r)
                for (i = 0; i < @K_STRIP; ++i)
                    work[@K_BLOCKS + j * @K_SIZE + r][i] = F[r * @J + j];
        @K_values(F, work);
        for (k = 0; k < @J; ++k)
            variance[k] = work[@K_OUT + k * @J + k][0];
@SPREADS
        for (k = 0; k < @J; ++k) {
            for (i = 0; i < @USED; ++i)
                own[i] = @K_used[i] < 0 ? R(0.0) : every[k][@K_used[i]];
            variance[k] -= squared(@K_factor_table, own, @ENTRIES, variance[k] - enough[k]);
            if (variance[k] < R(0.0))
                variance[k] = R(0.0);
        }
    }
#else
    (void)variance;
#endif
}
