/* Written by a program; @NAME@_flight.h says how to use it. */
#include "@NAME@_flight.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

typedef @NAME@_real real;

#define R(x) ((real)(x))
#define SQRT sqrt@F@
#define COS cos@F@
#define SIN sin@F@

#define GRAVITY R(9.81)
#define SMOOTH_S R(0.02) /* time constant of the angular acceleration, which is a difference of rates */
#define UNUSABLE (@UPPER@_NOT_A_NUMBER | @UPPER@_FAR | @UPPER@_NO_ANSWER)
#define ROUNDS 3         /* of finding the motion's own acceleration: each leaves a tenth of the error */

/* By bits, so that it holds under -ffast-math. */
static int is_number(real value)
{
    @WORD@ bits;
    memcpy(&bits, &value, sizeof bits);
    return (bits & @MASK@) != @MASK@;
}

static real dot(const real *a, const real *b)
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Into a world whose x looks where the vehicle does. */
static void turned(const real *world, real cosine, real sine, real *out)
{
    out[0] = cosine * world[0] + sine * world[1];
    out[1] = cosine * world[1] - sine * world[0];
    out[2] = world[2];
}

static int numbers(const real *values, int count)
{
    int i, known = 1;
    for (i = 0; i < count; ++i)
        known = known && is_number(values[i]);
    return known;
}

static int complete(const @NAME@_setpoint *asked)
{
    return is_number(asked->altitude) && is_number(asked->yaw) && is_number(asked->battery) &&
           numbers(asked->velocity, 3) && numbers(asked->acceleration, 3) && asked->followed &&
           is_number(asked->age) && asked->age <= R(@UPPER@_OLD_S);
}

void @NAME@_flight_init(@NAME@_flight *own)
{
    memset(own, 0, sizeof *own);
    @NAME@_init(&own->model);
    @NAME@_init(&own->still);
}

/* The motion's own acceleration, and that which holds against the drag besides; the former is the latter less
   the lean, which depends on it but little. */
static int accelerations(const real *velocity, const real *given, int leans, real *own, real *told)
{
    real lean[3];
    int i, round, sure = 1;
    memcpy(own, given, 3 * sizeof *own);
    for (round = 0; sure && round < (leans ? ROUNDS : 1); ++round) {
        sure = @NAME@_lean(velocity, own, R(0.0), lean);
        for (i = 0; i < 3; ++i) {
            own[i] = leans ? given[i] - lean[i] : given[i];
            told[i] = leans ? given[i] : given[i] + lean[i];
        }
    }
    return sure;
}

/* What the model reads of a perfect flight, which leans against the drag. 0 where thrust is too small. All goes
   into `next`: `own` keeps what belongs to the last answer that could be used. */
static int states_of(@NAME@_flight *own, const @NAME@_setpoint *asked, real dt, @NAME@_sample *next)
{
    const real cosine = COS(asked->yaw), sine = SIN(asked->yaw);
    real given[3], jerk[3], velocity[3], acceleration[3], push[3], share;
    const real *const x = next->axes, *const y = next->axes + 3, *const z = next->axes + 6;
    const real *const rates = next->rates;
    int i;
    turned(asked->acceleration, cosine, sine, given);
    turned(asked->velocity, cosine, sine, velocity);
    turned(asked->jerk, cosine, sine, jerk);
    for (i = 0; i < 3; ++i)
        jerk[i] = is_number(jerk[i]) ? jerk[i] : R(0.0);
    if (!accelerations(velocity, given, asked->leans, acceleration, next->told) ||
        !@NAME@_axes(velocity, acceleration, jerk, next->axes, next->rates))
        return 0;
    for (i = 0; i < 3; ++i)
        push[i] = acceleration[i] + (i == 2 ? GRAVITY : R(0.0));
    share = own->begun && dt > R(0.0) ? dt / (dt + SMOOTH_S) : R(0.0);
    for (i = 0; i < 3; ++i) {
        next->turning[i] = own->good.turning[i];
        if (share > R(0.0))
            next->turning[i] += share * ((rates[i] - own->good.rates[i]) / dt - next->turning[i]);
    }
    (void)push; /* a model may read the motion's own acceleration alone */
@FILL@
    return 1;
}

/* The flags of an answer; it is adopted whole, the acceleration that PX4 acts on and what the model says of it, or
   not at all: one of them new and the other old are no pair, and their difference is no command. */
static unsigned answered(@NAME@_flight *own, const @NAME@_setpoint *asked, real dt)
{
    real moving[@UPPER@_COMMANDS], still[@UPPER@_COMMANDS], hover[@UPPER@_INPUTS] = {R(0.0)};
    @NAME@_sample next;
    unsigned flags;
    int j;
    if (!complete(asked) || !states_of(own, asked, dt, &next))
        return @UPPER@_NOT_A_NUMBER;
@HOVER@
    flags = @NAME@_mean(&own->model, own->input, moving) | @NAME@_mean(&own->still, hover, still);
    next.hover = R(0.0);
    for (j = 0; j < @UPPER@_COMMANDS; ++j) {
        next.extra[j] = moving[j] - still[j];
        next.hover += still[j] / R(@UPPER@_COMMANDS);
    }
    if (!numbers(next.extra, @UPPER@_COMMANDS) || !numbers(next.told, 3) || !numbers(next.axes, 9) ||
        !numbers(next.turning, 3))
        flags |= @UPPER@_NOT_A_NUMBER;
    if (!(flags & UNUSABLE))
        own->good = next;
    return flags;
}

unsigned @NAME@_flight_ask(@NAME@_flight *own, const @NAME@_setpoint *asked, real dt, real *extra)
{
    const real passed = is_number(dt) && dt > R(0.0) ? dt : R(0.0), step = passed / R(@UPPER@_FADE_S);
    const unsigned flags = answered(own, asked, passed);
    int j;
    own->begun = !(flags & UNUSABLE); /* no difference of rates over a gap */
    own->trust += own->begun ? step : -step;
    own->trust = own->trust < R(0.0) ? R(0.0) : own->trust > R(1.0) ? R(1.0) : own->trust;
    for (j = 0; j < @UPPER@_COMMANDS; ++j)
        extra[j] = own->trust * own->good.extra[j];
    own->asked = 1;
    own->flags = flags;
    return flags;
}
