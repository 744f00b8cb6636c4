typedef struct {
    real rotation[9], position[3], velocity[3], acceleration[3], omega[3], alpha[3];
} @MEAN_frame;

static void @MEAN_cross(const real *a, const real *b, real *out)
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static real @MEAN_dot(const real *a, const real *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void @MEAN_turned(const real *rotation, const real *v, real *out)
{
    int i;
    for (i = 0; i < 3; ++i)
        out[i] = @MEAN_dot(rotation + 3 * i, v);
}

static void @MEAN_turned_back(const real *rotation, const real *v, real *out)
{
    int i;
    for (i = 0; i < 3; ++i)
        out[i] = rotation[i] * v[0] + rotation[3 + i] * v[1] + rotation[6 + i] * v[2];
}

static void @MEAN_multiplied(const real *a, const real *b, real *out)
{
    int i, j;
    for (i = 0; i < 3; ++i)
        for (j = 0; j < 3; ++j)
            out[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j];
}

/* Velocity and acceleration of the point of a frame that is at `point` now. */
static void @MEAN_shifted(const @MEAN_frame *f, const real *point, real *velocity, real *acceleration)
{
    real arm[3], swing[3], turn[3], inward[3];
    int i;
    for (i = 0; i < 3; ++i)
        arm[i] = point[i] - f->position[i];
    @MEAN_cross(f->omega, arm, swing);
    @MEAN_cross(f->alpha, arm, turn);
    @MEAN_cross(f->omega, swing, inward);
    for (i = 0; i < 3; ++i) {
        velocity[i] = f->velocity[i] + swing[i];
        acceleration[i] = f->acceleration[i] + turn[i] + inward[i];
    }
}

/* The frame after a hinge or a slide; its axis z and a point on it, in the world. */
static void @MEAN_moved(@MEAN_frame *f, int j, real travel, real rate, real pull, real *z, real *pivot)
{
    const real *const axis = @MEAN_axis + 3 * j, *const anchor = @MEAN_anchor + 3 * j;
    real velocity[3], acceleration[3], spun[3], across[3], lever[3];
    int i;
    @MEAN_turned(f->rotation, axis, z);
    @MEAN_turned(f->rotation, anchor, lever);
    for (i = 0; i < 3; ++i) {
        pivot[i] = f->position[i] + lever[i];
        spun[i] = z[i] * rate;
    }
    @MEAN_cross(f->omega, spun, across);
    if (@MEAN_slides[j]) {
        real origin[3];
        for (i = 0; i < 3; ++i)
            origin[i] = f->position[i] + z[i] * travel;
        @MEAN_shifted(f, origin, velocity, acceleration);
        for (i = 0; i < 3; ++i) {
            f->position[i] = origin[i];
            f->velocity[i] = velocity[i] + spun[i];
            f->acceleration[i] = acceleration[i] + z[i] * pull + R(2.0) * across[i];
        }
    } else {
        const real s = SIN(travel), v = R(1.0) - COS(travel), x = axis[0], y = axis[1], w = axis[2];
        real turn[9], rotation[9];
        turn[0] = R(1.0) - v * (w * w + y * y);
        turn[1] = v * x * y - s * w;
        turn[2] = v * x * w + s * y;
        turn[3] = v * x * y + s * w;
        turn[4] = R(1.0) - v * (w * w + x * x);
        turn[5] = v * y * w - s * x;
        turn[6] = v * x * w - s * y;
        turn[7] = v * y * w + s * x;
        turn[8] = R(1.0) - v * (x * x + y * y);
        @MEAN_shifted(f, pivot, velocity, acceleration);
        @MEAN_multiplied(f->rotation, turn, rotation);
        for (i = 0; i < 9; ++i)
            f->rotation[i] = rotation[i];
        for (i = 0; i < 3; ++i) {
            f->alpha[i] += z[i] * pull + across[i];
            f->omega[i] += spun[i];
            f->position[i] = pivot[i];
            f->velocity[i] = velocity[i];
            f->acceleration[i] = acceleration[i];
        }
        @MEAN_turned(f->rotation, anchor, lever);
        for (i = 0; i < 3; ++i)
            lever[i] = pivot[i] - lever[i];
        @MEAN_shifted(f, lever, velocity, acceleration);
        for (i = 0; i < 3; ++i) {
            f->position[i] = lever[i];
            f->velocity[i] = velocity[i];
            f->acceleration[i] = acceleration[i];
        }
    }
}

/* Motion of all bodies, with the joints' axes and points on them. */
static void @MEAN_motion(
    const real *q, const real *qd, const real *qdd, @MEAN_frame *frames, real *axes, real *pivots)
{
    int body, i, n;
    memset(frames, 0, sizeof *frames);
    for (i = 0; i < 9; i += 4)
        frames[0].rotation[i] = R(1.0);
    for (body = 1; body < @BODIES; ++body) {
        const @MEAN_frame *const base = frames + @MEAN_parent[body];
        @MEAN_frame *const f = frames + body;
        real origin[3];
        @MEAN_turned(base->rotation, @MEAN_position + 3 * body, origin);
        for (i = 0; i < 3; ++i) {
            f->position[i] = base->position[i] + origin[i];
            f->omega[i] = base->omega[i];
            f->alpha[i] = base->alpha[i];
        }
        @MEAN_shifted(base, f->position, f->velocity, f->acceleration);
        @MEAN_multiplied(base->rotation, @MEAN_rotation + 9 * body, f->rotation);
        for (n = @MEAN_first[body]; n < @MEAN_first[body + 1]; ++n) {
            const int j = @MEAN_order[n];
            @MEAN_moved(f, j, q[j] - @MEAN_zero[j], qd[j], qdd[j], axes + 3 * j, pivots + 3 * j);
        }
    }
}

/* Moments, speeds and accelerations of the drives. */
static void @MEAN_drives(
    const @MEAN_frame *frames,
    const real *axes,
    const real *pivots,
    const real *qd,
    const real *qdd,
    real *moments,
    real *speeds,
    real *accelerations)
{
    int a, i, j, n;
    for (a = 0; a < @JOINTS; ++a) {
        real speed = R(0.0), acceleration = R(0.0), *const moment = moments + @JOINTS * a;
        real before[3][3] = {{R(0.0)}}, jacobian[3 * @JOINTS] = {R(0.0)};
        for (j = 0; j < @JOINTS; ++j) {
            moment[j] = @MEAN_coefficients[@JOINTS * a + j];
            speed += moment[j] * qd[j];
            acceleration += moment[j] * qdd[j];
        }
        for (n = @MEAN_sites[a]; n < @MEAN_sites[a + 1]; ++n) {
            const int body = @MEAN_site_body[n];
            const @MEAN_frame *const f = frames + body;
            real site[3][3], own[3 * @JOINTS], arm[3], across[3];
            @MEAN_turned(f->rotation, @MEAN_site_point + 3 * n, arm);
            for (i = 0; i < 3; ++i)
                site[0][i] = f->position[i] + arm[i];
            @MEAN_shifted(f, site[0], site[1], site[2]);
            for (j = 0; j < @JOINTS; ++j) {
                real lever[3];
                for (i = 0; i < 3; ++i) {
                    lever[i] = site[0][i] - pivots[3 * j + i];
                    across[i] = axes[3 * j + i];
                }
                if (!@MEAN_slides[j])
                    @MEAN_cross(axes + 3 * j, lever, across);
                for (i = 0; i < 3; ++i)
                    own[3 * j + i] = @MEAN_paths[@JOINTS * body + j] ? across[i] : R(0.0);
            }
            if (n > @MEAN_sites[a]) {
                real gap[3], drift[3], push[3], length, along;
                for (i = 0; i < 3; ++i) {
                    gap[i] = site[0][i] - before[0][i];
                    drift[i] = site[1][i] - before[1][i];
                    push[i] = site[2][i] - before[2][i];
                }
                length = SQRT(@MEAN_dot(gap, gap));
                for (i = 0; i < 3; ++i)
                    gap[i] /= length;
                along = @MEAN_dot(gap, drift);
                speed += along;
                acceleration += @MEAN_dot(gap, push) + (@MEAN_dot(drift, drift) - along * along) / length;
                for (j = 0; j < @JOINTS; ++j)
                    for (i = 0; i < 3; ++i)
                        moment[j] += gap[i] * (own[3 * j + i] - jacobian[3 * j + i]);
            }
            memcpy(before, site, sizeof before);
            memcpy(jacobian, own, sizeof jacobian);
        }
        for (j = 0; j < @JOINTS; ++j)
            moment[j] *= @MEAN_gear[a];
        speeds[a] = speed * @MEAN_gear[a];
        accelerations[a] = acceleration * @MEAN_gear[a];
    }
}

/* A becomes what is left of it by elimination with pivots, B (n, n) A^-1 B; 0 where A is singular. */
static void @MEAN_solved(real *A, real *B)
{
    int i, j, k;
    for (k = 0; k < @JOINTS; ++k) {
        int best = k;
        for (i = k + 1; i < @JOINTS; ++i)
            if (FABS(A[@JOINTS * i + k]) > FABS(A[@JOINTS * best + k]))
                best = i;
        for (j = 0; j < @JOINTS; ++j) {
            const real a = A[@JOINTS * k + j], b = B[@JOINTS * k + j];
            A[@JOINTS * k + j] = A[@JOINTS * best + j];
            B[@JOINTS * k + j] = B[@JOINTS * best + j];
            A[@JOINTS * best + j] = a;
            B[@JOINTS * best + j] = b;
        }
        for (i = 0; i < @JOINTS; ++i) {
            const real pivot = A[@JOINTS * k + k];
            const real factor = i == k || pivot == R(0.0) ? R(0.0) : A[@JOINTS * i + k] / pivot;
            for (j = 0; j < @JOINTS; ++j) {
                A[@JOINTS * i + j] -= factor * A[@JOINTS * k + j];
                B[@JOINTS * i + j] -= factor * B[@JOINTS * k + j];
            }
        }
    }
    for (k = 0; k < @JOINTS; ++k)
        for (j = 0; j < @JOINTS; ++j)
            B[@JOINTS * k + j] = A[@JOINTS * k + k] == R(0.0) ? R(0.0) : B[@JOINTS * k + j] / A[@JOINTS * k + k];
}

/* Forces in the joints' coordinates of bodies with the inertial parameters phi. */
static void @MEAN_forces(
    const @MEAN_frame *frames, const real *axes, const real *pivots, const real *phi, real *force)
{
    int body, i, j;
    for (j = 0; j < @JOINTS; ++j)
        force[j] = R(0.0);
    for (body = 1; body < @BODIES; ++body, phi += 10) {
        const @MEAN_frame *const f = frames + body;
        real fall[3], a[3], w[3], al[3], push[3], turn[3], mc[3], first[3], second[3], spin[3], bent[3];
        for (i = 0; i < 3; ++i)
            fall[i] = f->acceleration[i] - @MEAN_gravity[i];
        @MEAN_turned_back(f->rotation, fall, a);
        @MEAN_turned_back(f->rotation, f->omega, w);
        @MEAN_turned_back(f->rotation, f->alpha, al);
        for (i = 0; i < 3; ++i)
            mc[i] = phi[1 + i];
        @MEAN_cross(al, mc, first);
        @MEAN_cross(w, mc, second);
        @MEAN_cross(w, second, bent);
        for (i = 0; i < 3; ++i)
            push[i] = phi[0] * a[i] + first[i] + bent[i];
        spin[0] = phi[4] * w[0] + phi[7] * w[1] + phi[8] * w[2];
        spin[1] = phi[7] * w[0] + phi[5] * w[1] + phi[9] * w[2];
        spin[2] = phi[8] * w[0] + phi[9] * w[1] + phi[6] * w[2];
        @MEAN_cross(w, spin, bent);
        @MEAN_cross(mc, a, first);
        turn[0] = phi[4] * al[0] + phi[7] * al[1] + phi[8] * al[2] + bent[0] + first[0];
        turn[1] = phi[7] * al[0] + phi[5] * al[1] + phi[9] * al[2] + bent[1] + first[1];
        turn[2] = phi[8] * al[0] + phi[9] * al[1] + phi[6] * al[2] + bent[2] + first[2];
        @MEAN_turned(f->rotation, push, first);
        @MEAN_turned(f->rotation, turn, second);
        for (j = 0; j < @JOINTS; ++j) {
            real arm[3], lever[3];
            if (!@MEAN_paths[@JOINTS * body + j])
                continue;
            if (@MEAN_slides[j]) {
                force[j] += @MEAN_dot(axes + 3 * j, first);
                continue;
            }
            for (i = 0; i < 3; ++i)
                arm[i] = f->position[i] - pivots[3 * j + i];
            @MEAN_cross(axes + 3 * j, arm, lever);
            force[j] += @MEAN_dot(lever, first) + @MEAN_dot(axes + 3 * j, second);
        }
    }
}

/* turned: what the narrowest friction of each joint is after its way, by speed where it has none; or 0. */
static void @MEAN_commands(
    const real *q, const real *qd, const real *qdd, const real *turned, real *command)
{
    static const real scales[@EXTRAS - 3] = {@SCALES};
    @MEAN_frame frames[@BODIES];
    real axes[3 * @JOINTS], pivots[3 * @JOINTS], moments[@JOINTS * @JOINTS], force[@JOINTS];
    real inverse[@JOINTS * @JOINTS] = {R(0.0)}, speeds[@JOINTS], accelerations[@JOINTS];
    real threshold[@JOINTS] = {R(0.0)};
    int i, j, s;
    @MEAN_motion(q, qd, qdd, frames, axes, pivots);
    @MEAN_drives(frames, axes, pivots, qd, qdd, moments, speeds, accelerations);
    for (i = 0; i < @JOINTS; ++i) {
        inverse[@JOINTS * i + i] = R(1.0);
        for (j = 0; j < @JOINTS; ++j)
            threshold[i] += FABS(moments[@JOINTS * i + j]) * @MEAN_speed[j];
    }
    @MEAN_solved(moments, inverse);
    for (j = 0; j < @JOINTS; ++j) {
        const real *const extra = @MEAN_extra + @EXTRAS * j;
        @MEAN_forces(frames, axes, pivots, @MEAN_inertial + 10 * (@BODIES - 1) * j, force);
        command[j] = extra[0] * accelerations[j] + extra[1] * speeds[j] + extra[@EXTRAS - 1];
        for (s = 0; s < @EXTRAS - 3; ++s) {
            const int remembered = s == 0 && turned && @MEAN_side[j] != R(0.0);
            const real friction = remembered
                ? @MEAN_side[j] * turned[j] * (R(1.0) - EXP(-FABS(speeds[j]) / @MEAN_resting[j]))
                : TANH(speeds[j] / (scales[s] * threshold[j]));
            command[j] += extra[2 + s] * friction;
        }
        for (i = 0; i < @JOINTS; ++i)
            command[j] += inverse[@JOINTS * i + j] * force[i];
@RIPPLE    }
}
