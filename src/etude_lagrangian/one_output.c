/* Rows of the work: value, powers of the own joint; of each joint inputs, factor, chain before it, sums of its
   link, factor and chain of the potential. */
#define @K_STRIP 16
enum { @K_P = 1, @K_T = 5, @K_T_OF = 4, @K_BEFORE = 8, @K_LINK = 12, @K_U = 16, @K_SIZE = 17 };

static void @K_chain(real (*work)[@K_STRIP], int before, int joint, real w)
{
    int x;
    real(*const from)[@K_STRIP] = work + before + @K_BEFORE, (*const to)[@K_STRIP] = from + @K_SIZE;
    real(*const own)[@K_STRIP] = work + joint;
    for (x = 0; x < @K_STRIP; ++x) {
        const real c = own[@K_T_OF][x], cx = own[@K_T_OF + 1][x], cz = own[@K_T_OF + 2][x], wz = own[2][x];
        const real p = c * c, alpha = R(2.0) * w * c * cx, beta = R(2.0) * wz * c * cz;
        const real gamma = R(2.0) * w * wz * (cx * cz + c * own[@K_T_OF + 3][x]);
        const real a = from[0][x], b = from[1][x], d = from[2][x], e = from[3][x];
        to[0][x] = a * p;
        to[1][x] = b * p + a * alpha;
        to[2][x] = d * p + a * beta;
        to[3][x] = e * p + b * beta + d * alpha + a * gamma;
    }
}

/* work[0]: covariances of the command of joint @OWN at F (4, J) with the inputs that the joints' rows hold. */
static void @K_values(const real *F, real (*work)[@K_STRIP])
{
    const real *const p = @K_parameters;
    int x, j, link;
    real(*const blocks)[@K_STRIP] = work + @K_T;
    real(*const own)[@K_STRIP] = blocks + @OWN * @K_SIZE;
    for (j = 0; j < @J; ++j) {
        real(*const joint)[@K_STRIP] = blocks + j * @K_SIZE;
        const real ha = R(0.5) * p[j], hb = R(0.5) * p[@J + j];
        const real s = j == @OWN ? hb * F[j] : ha * F[j], c = j == @OWN ? ha * F[@J + j] : hb * F[@J + j];
        const real one = j == @OWN ? R(0.0) : R(0.5);
        const real aS = R(0.5) * p[2 * @J + j] * F[j], aC = R(0.5) * p[2 * @J + j] * F[@J + j];
        const real bS = R(0.5) * p[3 * @J + j] * F[j], bC = R(0.5) * p[3 * @J + j] * F[@J + j];
        for (x = 0; x < @K_STRIP; ++x) {
            const real sz = joint[0][x], cz = joint[1][x];
            joint[@K_U][x] = s * sz + c * cz + one;
            joint[@K_T_OF][x] = aS * sz + bC * cz + R(0.5);
            joint[@K_T_OF + 1][x] = aC * sz - bS * cz;
            joint[@K_T_OF + 2][x] = aS * cz - bC * sz;
            joint[@K_T_OF + 3][x] = aC * cz + bS * sz;
        }
    }
    for (x = 0; x < @K_STRIP; ++x) {
        const real c = own[@K_T_OF][x], cx = own[@K_T_OF + 1][x], cz = own[@K_T_OF + 2][x];
        real potential = p[(4 + @J) * @J];
        for (j = 0; j < @J; ++j)
            potential *= blocks[j * @K_SIZE + @K_U][x];
        work[0][x] = potential;
        work[@K_P][x] = c * c;
        work[@K_P + 1][x] = R(2.0) * c * cx;
        work[@K_P + 2][x] = R(2.0) * c * cz;
        work[@K_P + 3][x] = R(2.0) * (cx * cz + c * own[@K_T_OF + 3][x]);
        blocks[@K_BEFORE][x] = R(1.0);
        blocks[@K_BEFORE + 1][x] = R(0.0);
        blocks[@K_BEFORE + 2][x] = R(0.0);
        blocks[@K_BEFORE + 3][x] = R(0.0);
    }
    for (j = 0; j < @OWN; ++j)
        @K_chain(blocks, j * @K_SIZE, j * @K_SIZE, F[2 * @J + j]);
    for (link = @OWN; link < @J; ++link) {
        real(*const at)[@K_STRIP] = blocks + link * @K_SIZE;
        const real v = p[(4 + link) * @J + @OWN], w = F[2 * @J + @OWN], u = F[3 * @J + @OWN];
        if (link > @OWN)
            @K_chain(blocks, (link - 1) * @K_SIZE, link * @K_SIZE, F[2 * @J + link]);
        for (j = 0; j < 4; ++j)
            for (x = 0; x < @K_STRIP; ++x)
                at[@K_LINK + j][x] = R(0.0);
        for (j = 0; j <= link; ++j) {
            real(*const z)[@K_STRIP] = blocks + j * @K_SIZE;
            const real vw = p[(4 + link) * @J + j] * F[2 * @J + j], vu = p[(4 + link) * @J + j] * F[3 * @J + j];
            if (j == @OWN)
                continue;
            for (x = 0; x < @K_STRIP; ++x) {
                at[@K_LINK][x] += vw * z[2][x];
                at[@K_LINK + 1][x] += vw * z[3][x];
                at[@K_LINK + 2][x] += vu * z[2][x];
                at[@K_LINK + 3][x] += vu * z[3][x];
            }
        }
        for (x = 0; x < @K_STRIP; ++x) {
            const real a = at[@K_BEFORE][x], b = at[@K_BEFORE + 1][x];
            const real d = at[@K_BEFORE + 2][x], e = at[@K_BEFORE + 3][x];
            const real ww = at[@K_LINK][x], wu = at[@K_LINK + 1][x], uw = at[@K_LINK + 2][x];
            const real uu = at[@K_LINK + 3][x], wz = own[2][x], uz = own[3][x], two = R(2.0) * v;
            const real mixed = (uu + two * u * uz) * a + (wu + two * w * uz) * b + (uw + two * u * wz) * d +
                               (ww + two * w * wz) * e;
            work[0][x] += work[@K_P][x] * mixed * two;
            work[0][x] += two * v * w * w * work[@K_P + 1][x] * (uz * a + wz * d);
            work[0][x] += two * v * wz * wz * work[@K_P + 2][x] * (u * a + w * b);
            work[0][x] += work[@K_P + 3][x] * a * (ww * ww + v * v * w * w * wz * wz);
        }
    }
}

static void @K(const real *x, int first, real *k)
{
    real F[4 * @J], work[@K_T + @J * @K_SIZE][@K_STRIP];
    int start, i, j, r;
    @K_packed(x, F);
    for (start = 0; start < BLOCK; start += @K_STRIP) {
        for (j = 0; j < @J; ++j)
            for (r = 0; r < 4; ++r)
                for (i = 0; i < @K_STRIP; ++i)
                    work[@K_T + j * @K_SIZE + r][i] = @K_points[r * @J + j][first + start + i];
        @K_values(F, work);
        for (i = 0; i < @K_STRIP; ++i)
            k[start + i] = work[0][i];
    }
}

#if VARIANCE
static real @K_diagonal(const real *x)
{
    real F[4 * @J], work[@K_T + @J * @K_SIZE][@K_STRIP];
    int i, j, r;
    @K_packed(x, F);
    for (j = 0; j < @J; ++j)
        for (r = 0; r < 4; ++r)
            for (i = 0; i < @K_STRIP; ++i)
                work[@K_T + j * @K_SIZE + r][i] = F[r * @J + j];
    @K_values(F, work);
    return work[0][0];
}
#endif
