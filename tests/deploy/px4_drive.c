/* Calls the glue as control_allocator would: lines of dt, battery, a set-point and four motors in, motors out. */
#include <stdio.h>
#include <stdlib.h>

#include "vehicle_px4.h"

static float number(void)
{
    char word[64];
    return scanf("%63s", word) == 1 ? strtof(word, NULL) : 0.0f;
}

int main(void)
{
    static vehicle_flight own;
    struct trajectory_setpoint_s asked;
    struct actuator_motors_s motors;
    unsigned flags;
    int i, rows = (int)number();
    vehicle_flight_init(&own);
    while (rows-- > 0) {
        const float dt = number(), battery = number();
        for (i = 0; i < 3; ++i)
            asked.position[i] = number();
        for (i = 0; i < 3; ++i)
            asked.velocity[i] = number();
        for (i = 0; i < 3; ++i)
            asked.acceleration[i] = number();
        for (i = 0; i < 3; ++i)
            asked.jerk[i] = number();
        asked.yaw = number();
        for (i = 0; i < 4; ++i)
            motors.control[i] = number();
        flags = vehicle_px4_add(&own, &asked, battery, dt, &motors);
        printf("%u ", flags);
        for (i = 0; i < 4; ++i)
            printf("%.9g ", (double)motors.control[i]);
        for (i = 0; i < VEHICLE_INPUTS; ++i)
            printf("%.9g ", (double)own.input[i]);
        printf("\n");
    }
    return 0;
}
