/* Calls the glue as control_allocator would: lines of dt, battery, a set-point and four motors in, motors out. */
#include <stdio.h>
#include <stdlib.h>

#include "vehicle_px4.h"

static float number(void)
{
    char word[64];
    return scanf("%63s", word) == 1 ? strtof(word, NULL) : 0.0f;
}

static void read3(float *own)
{
    int i;
    for (i = 0; i < 3; ++i)
        own[i] = number();
}

int main(void)
{
    static vehicle_flight own;
    struct trajectory_setpoint_s asked;
    struct actuator_motors_s motors;
    vehicle_px4 beside;
    unsigned flags;
    int i, rows = (int)number();
    vehicle_flight_init(&own);
    while (rows-- > 0) {
        const float dt = number();
        beside.battery = number();
        read3(asked.position);
        read3(asked.velocity);
        read3(asked.acceleration);
        read3(asked.jerk);
        asked.yaw = number();
        for (i = 0; i < 4; ++i)
            motors.control[i] = number();
        beside.nav_state = (uint8_t)number();
        asked.timestamp = 10000000000u;
        beside.now = asked.timestamp + (uint64_t)(int64_t)(1e6f * number());
        beside.hover_thrust = number();
        beside.leans = (int)number();
        beside.decoupled = 1;
        flags = vehicle_px4_add(&own, &asked, &beside, dt, &motors);
        printf("%u ", flags);
        for (i = 0; i < 4; ++i)
            printf("%.9g ", (double)motors.control[i]);
        for (i = 0; i < VEHICLE_INPUTS; ++i)
            printf("%.9g ", (double)own.input[i]);
        (void)vehicle_px4_lean(&asked);
        for (i = 0; i < 3; ++i)
            printf("%.9g ", (double)asked.acceleration[i]);
        printf("\n");
    }
    return 0;
}
