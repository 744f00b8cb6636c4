/* Written by a program; @NAME@_px4.h says how to use it. */
#include "@NAME@_px4.h"

#define QUARTER 1.5707963f /* yaw 0 looks north in PX4, and along x, east, in the model's world */

static const int motor_of[@UPPER@_COMMANDS] = {@MOTORS@};

/* (east, north, up) from (north, east, down). */
static void up(const float *ned, @NAME@_real *enu)
{
    enu[0] = ned[1];
    enu[1] = ned[0];
    enu[2] = -ned[2];
}

unsigned @NAME@_px4_add(@NAME@_flight *own, const struct trajectory_setpoint_s *asked, float battery, float dt,
                        struct actuator_motors_s *motors)
{
    @NAME@_setpoint point;
    @NAME@_real extra[@UPPER@_COMMANDS];
    unsigned flags;
    int j;
    point.altitude = -asked->position[2];
    up(asked->velocity, point.velocity);
    up(asked->acceleration, point.acceleration);
    up(asked->jerk, point.jerk);
    point.yaw = QUARTER - asked->yaw;
    point.battery = battery;
    flags = @NAME@_flight_ask(own, &point, dt, extra);
    for (j = 0; j < @UPPER@_COMMANDS; ++j) {
        float *const control = &motors->control[motor_of[j]];
        *control += (float)extra[j];
        if (*control > 1.0f)
            *control = 1.0f;
        if (*control < 0.0f)
            *control = 0.0f;
    }
    return flags;
}
