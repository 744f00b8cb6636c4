#pragma once
struct trajectory_setpoint_s {
    float position[3];
    float velocity[3];
    float acceleration[3];
    float jerk[3];
    float yaw;
    float yawspeed;
};
