#pragma once
#include <stdint.h>

typedef uint32_t stabilizerStep_t;
typedef struct {
    float x, y, z;
} vec3_t;
typedef struct {
    float roll, pitch, yaw;
} attitude_t;
typedef enum { modeDisable = 0, modeAbs, modeVelocity } stab_mode_t;
typedef struct {
    stab_mode_t x, y, z;
} setpoint_mode_t;
typedef struct {
    uint32_t timestamp;  /* ms */
    attitude_t attitude; /* deg */
    vec3_t position, velocity, acceleration, jerk;
    setpoint_mode_t mode;
} setpoint_t;
typedef struct {
    int unused;
} sensorData_t;
typedef struct {
    attitude_t attitude; /* deg, pitch positive nose up */
} state_t;

#define STABILIZER_NR_OF_MOTORS 4
typedef enum { controlModeLegacy = 0, controlModeForceTorque = 1, controlModeForce = 2 } control_mode_t;
typedef struct {
    union {
        struct {
            int16_t roll, pitch, yaw;
            float thrust;
        };
        float normalizedForces[STABILIZER_NR_OF_MOTORS];
    };
    control_mode_t controlMode;
} control_t;

#define RATE_1000_HZ 1000
#define RATE_500_HZ 500
#define RATE_250_HZ 250
#define RATE_100_HZ 100
#define RATE_DO_EXECUTE(rate, step) ((step) % (RATE_1000_HZ / (rate)) == 0)
