#define GRAVITY R(9.81)
#define LEAST_LIFT R(0.3) /* part of the weight below which thrust has no sure direction */

static real dot(const real *a, const real *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

void @NAME@_drag(const real *body_velocity, real *force)
{
    @NAME@_force(body_velocity, force);
}

/* Faessler, Franchi and Scaramuzza 2018, heading 0: x of the body is normal to the left axis and to
   a + g z + dx v, y to x and to a + g z + dy v. Derivatives of unit vectors: (w' - u (u w')) / |w|. */
int @NAME@_axes(const real *velocity, const real *acceleration, const real *jerk, real *axes, real *rates)
{
    real push[2][3], slope[2][3], w[3], p, q, dp, dq, size, along;
    real *const x = axes, *const y = axes + 3, *const z = axes + 6;
    int i, j;
    for (j = 0; j < 2; ++j) {
        const real drag = j ? @DY@ : @DX@;
        for (i = 0; i < 3; ++i) {
            push[j][i] = acceleration[i] + drag * velocity[i] + (i == 2 ? GRAVITY : R(0.0));
            slope[j][i] = jerk ? jerk[i] + drag * acceleration[i] : R(0.0);
        }
    }
    if (!(push[0][2] > LEAST_LIFT * GRAVITY) || !(push[1][2] > LEAST_LIFT * GRAVITY))
        return 0;
    size = SQRT(push[0][0] * push[0][0] + push[0][2] * push[0][2]);
    p = push[0][2] / size;
    q = push[0][0] / size;
    along = p * slope[0][2] + q * slope[0][0];
    dp = (slope[0][2] - p * along) / size;
    dq = (slope[0][0] - q * along) / size;
    x[0] = p;
    x[1] = R(0.0);
    x[2] = -q;
    y[0] = -push[1][1] * q;
    y[1] = push[1][2] * p + push[1][0] * q;
    y[2] = -push[1][1] * p;
    w[0] = -slope[1][1] * q - push[1][1] * dq;
    w[1] = slope[1][2] * p + push[1][2] * dp + slope[1][0] * q + push[1][0] * dq;
    w[2] = -slope[1][1] * p - push[1][1] * dp;
    size = SQRT(dot(y, y));
    for (i = 0; i < 3; ++i)
        y[i] /= size;
    along = dot(y, w);
    for (i = 0; i < 3; ++i)
        w[i] = (w[i] - y[i] * along) / size;
    z[0] = q * y[1];
    z[1] = -q * y[0] - p * y[2];
    z[2] = p * y[1];
    if (rates) {
        const real dz[3] = {dq * y[1] + q * w[1], -dq * y[0] - q * w[0] - dp * y[2] - p * w[2],
                            dp * y[1] + p * w[1]};
        rates[0] = jerk ? dot(z, w) : R(0.0);
        rates[1] = jerk ? dot(x, dz) : R(0.0);
        rates[2] = jerk ? y[0] * dp - y[2] * dq : R(0.0);
    }
    return 1;
}

int @NAME@_lean(const real *velocity, const real *acceleration, real yaw, real *lean)
{
    const real cosine = COS(yaw), sine = SIN(yaw);
    const real speed[3] = {cosine * velocity[0] + sine * velocity[1], cosine * velocity[1] - sine * velocity[0],
                           velocity[2]};
    const real change[3] = {cosine * acceleration[0] + sine * acceleration[1],
                            cosine * acceleration[1] - sine * acceleration[0], acceleration[2]};
    real axes[9], inside[3], force[2], level[3];
    int i, known = is_number(yaw);
    lean[0] = lean[1] = lean[2] = R(0.0);
    for (i = 0; i < 3; ++i)
        known = known && is_number(velocity[i]) && is_number(acceleration[i]);
    if (!known || !@NAME@_axes(speed, change, 0, axes, 0))
        return 0;
    for (i = 0; i < 3; ++i)
        inside[i] = dot(axes + 3 * i, speed);
    @NAME@_drag(inside, force);
    for (i = 0; i < 3; ++i)
        level[i] = -axes[i] * force[0] - axes[3 + i] * force[1];
    lean[0] = cosine * level[0] - sine * level[1];
    lean[1] = cosine * level[1] + sine * level[0];
    lean[2] = level[2];
    return 1;
}
