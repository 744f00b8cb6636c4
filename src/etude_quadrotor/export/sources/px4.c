/* Written by a program; @NAME@_px4.h says how to use it. */
#include "@NAME@_px4.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

#define QUARTER 1.5707963f /* yaw 0 looks north in PX4, and along x, east, in the model's world */
#define GRAVITY 9.81f
#define LATE @LATE@f       /* s by which PX4 answers a horizontal acceleration: 1/MC_ROLL_P */
#define DAMPING @DAMPING@f /* of the measured acceleration that PX4 takes off: MPC_XY_VEL_D_ACC */
#define RATE @RATE@.0f /* Hz at which the model is asked; between, its last answer holds */
#define OFFBOARD 14 /* vehicle_status: NAVIGATION_STATE_OFFBOARD */

#define AHEAD_US 10000u /* what a synchronised clock may be off by: half of the time between two set-points */

static const int motor_of[@UPPER@_COMMANDS] = {@MOTORS@};

/* By bits, so that it holds under -ffast-math. */
static int is_number(float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return (bits & 0x7f800000u) != 0x7f800000u;
}

/* s; a stamp of the future is no age: of a computer whose clock nobody synchronised it would never become old. */
static float age_of(uint64_t stamp, uint64_t now)
{
    if (stamp > now)
        return stamp - now > AHEAD_US ? 2.0f * (float)@UPPER@_OLD_S : 0.0f;
    return (float)(now - stamp) * 1e-6f;
}

/* (east, north, up) from (north, east, down), and back. */
static void up(const float *ned, @NAME@_real *enu)
{
    enu[0] = ned[1];
    enu[1] = ned[0];
    enu[2] = -ned[2];
}

/* What PX4 makes of the acceleration beyond hover thrust: PositionControl::_accelerationControl. */
static float collective(const @NAME@_real *told, float hover, int decoupled)
{
    const float level = (float)(told[0] * told[0] + told[1] * told[1]), lift = (float)told[2] + GRAVITY;
    const float upright = decoupled ? GRAVITY : lift; /* the tilt is found as if there were no vertical part */
    return hover * (lift / GRAVITY * sqrtf(1.0f + level / (upright * upright)) - 1.0f);
}

unsigned @NAME@_px4_add(@NAME@_flight *own, const struct trajectory_setpoint_s *asked, const @NAME@_px4 *beside,
                        float dt, struct actuator_motors_s *motors)
{
    @NAME@_setpoint point;
    @NAME@_real extra[@UPPER@_COMMANDS];
    const float thrust = beside->hover_thrust;
    float hover, known, more;
    unsigned flags = own->flags;
    int j;
    point.altitude = -asked->position[2];
    up(asked->velocity, point.velocity);
    up(asked->acceleration, point.acceleration);
    up(asked->jerk, point.jerk);
    point.yaw = QUARTER - asked->yaw;
    point.battery = beside->battery;
    point.age = age_of(asked->timestamp, beside->now);
    point.followed = beside->nav_state == OFFBOARD && is_number(asked->position[0]) && is_number(asked->position[1]);
    point.leans = beside->leans;
    own->since += is_number(dt) && dt > 0.0f ? dt : 0.0f;
    if (!own->asked || own->since >= 0.999f / RATE) {
        flags = @NAME@_flight_ask(own, &point, own->since, extra);
        own->since = 0;
    }
    hover = is_number(thrust) && thrust > 0.0f && thrust <= 1.0f ? thrust : (float)own->good.hover;
    known = own->trust > 0 ? (float)own->trust * collective(own->good.told, hover, beside->decoupled) : 0.0f;
    for (j = 0; j < @UPPER@_COMMANDS; ++j) {
        float *const control = &motors->control[motor_of[j]];
        more = (float)(own->trust * own->good.extra[j]) - known;
        if (!is_number(*control) || !is_number(more))
            continue; /* stopped by PX4, or nothing to add */
        *control += more;
        if (*control > 1.0f)
            *control = 1.0f;
        if (*control < 0.0f)
            *control = 0.0f;
    }
    return flags;
}

int @NAME@_px4_lean(struct trajectory_setpoint_s *asked)
{
    @NAME@_real velocity[3], acceleration[3], lean[3];
    float later[3];
    int i;
    /* horizontally those of LATE s later */
    for (i = 0; i < 3; ++i)
        later[i] = asked->velocity[i] + (i < 2 ? LATE * asked->acceleration[i] : 0.0f);
    up(later, velocity);
    for (i = 0; i < 3; ++i)
        later[i] = asked->acceleration[i] + (i < 2 && is_number(asked->jerk[i]) ? LATE * asked->jerk[i] : 0.0f);
    up(later, acceleration);
    if (!@NAME@_lean(velocity, acceleration, QUARTER - asked->yaw, lean))
        return 0;
    if (!(lean[0] < 0 || lean[0] > 0 || lean[1] < 0 || lean[1] > 0))
        return 0; /* without drag the delay replaces what nobody compensates */
    asked->acceleration[0] = later[0] + (float)lean[1] + DAMPING * asked->acceleration[0];
    asked->acceleration[1] = later[1] + (float)lean[0] + DAMPING * asked->acceleration[1];
    asked->acceleration[2] -= (float)lean[2];
    return 1;
}
