#pragma once
struct actuator_motors_s {
    float control[12];
};
