/* Crazyflie: the PID controller, with what was learned added to its attitude and to each motor. Written by a
   program. An out-of-tree controller of the app layer; select it with the parameter stabilizer.controller.

   The model is asked in the app's own task, which the stabilizer interrupts: a call takes longer than the
   stabilizer has. The stabilizer only adds what was found last. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#include "FreeRTOS.h"
#include "app.h"
#include "controller.h"
#include "controller_pid.h"
#include "motors.h"
#include "pm.h"
#include "stabilizer_types.h"
#include "task.h"

#include "@NAME@_flight.h"

#define RATE @RATE@ /* Hz at which the model is asked */
#define FULL 65535.0f
#define DEGREES 57.29578f
#define HALVINGS 16

static const int motor_of[@UPPER@_COMMANDS] = {@MOTORS@};
static @NAME@_flight own;

/* Shared by the stabilizer and the app, within critical sections. */
static setpoint_t newest;
static float wished[STABILIZER_NR_OF_MOTORS];  /* the PID's shares, 0 to 1 */
static float added[STABILIZER_NR_OF_MOTORS];   /* to those shares */
static float roll_offset, pitch_offset;        /* deg, as the PID counts them */
static float supply = 4.2f;                    /* V, filtered as stabilizer.c does it */
static uint32_t found_at;

/* Part of full duty that the firmware makes of a share: its thrust curve and battery compensation, if it was
   built with them. That is what motor.m1 .. m4 log, and what the model learned. */
static float duty(uint32_t motor, float share, float volts)
{
    return motorsCompensateBatteryVoltage(motor, share * FULL, volts) / FULL;
}

/* The share of which the firmware makes that duty; `duty` rises with the share. */
static float share_of(uint32_t motor, float wanted, float volts)
{
    float low = 0.0f, high = 1.0f;
    int i;
    for (i = 0; i < HALVINGS; ++i) {
        const float middle = 0.5f * (low + high);
        if (duty(motor, middle, volts) < wanted)
            low = middle;
        else
            high = middle;
    }
    return 0.5f * (low + high);
}

static void ask(void)
{
    setpoint_t asked;
    @NAME@_real extra[@UPPER@_COMMANDS];
    @NAME@_setpoint point;
    float base[STABILIZER_NR_OF_MOTORS], more[STABILIZER_NR_OF_MOTORS] = {0.0f}, volts, trust;
    uint32_t now;
    int j;
    taskENTER_CRITICAL();
    asked = newest;
    volts = supply;
    for (j = 0; j < STABILIZER_NR_OF_MOTORS; ++j)
        base[j] = wished[j];
    taskEXIT_CRITICAL();
    now = xTaskGetTickCount();
    point.altitude = asked.position.z;
    point.velocity[0] = asked.velocity.x;
    point.velocity[1] = asked.velocity.y;
    point.velocity[2] = asked.velocity.z;
    point.acceleration[0] = asked.acceleration.x;
    point.acceleration[1] = asked.acceleration.y;
    point.acceleration[2] = asked.acceleration.z;
    point.jerk[0] = asked.jerk.x;
    point.jerk[1] = asked.jerk.y;
    point.jerk[2] = asked.jerk.z;
    point.yaw = asked.attitude.yaw / DEGREES;
    point.battery = volts;
    point.age = (float)(now - asked.timestamp) / (float)M2T(1000);
    point.followed = asked.mode.x == modeAbs && asked.mode.y == modeAbs && asked.mode.z == modeAbs;
    point.leans = 0;
    (void)@NAME@_flight_ask(&own, &point, 1.0f / RATE, extra);
    trust = (float)own.trust;
    for (j = 0; j < @UPPER@_COMMANDS; ++j) {
        const int motor = motor_of[j];
        more[motor] = share_of((uint32_t)motor, duty((uint32_t)motor, base[motor], volts) + (float)extra[j], volts)
                      - base[motor];
    }
    taskENTER_CRITICAL();
    for (j = 0; j < STABILIZER_NR_OF_MOTORS; ++j)
        added[j] = more[j];
    /* the PID makes no attitude of accelerations: it is given one that lacks the lean of the set-point.
       Its pitch is positive nose up, against the right hand */
    roll_offset = trust * asinf((float)own.good.axes[7]) * DEGREES;
    pitch_offset = trust * atan2f((float)own.good.axes[6], (float)own.good.axes[8]) * DEGREES;
    found_at = now;
    taskEXIT_CRITICAL();
}

void appMain(void)
{
    while (1) {
        vTaskDelay(M2T(1000 / RATE));
        ask();
    }
}

void controllerOutOfTreeInit(void)
{
    controllerPidInit();
    @NAME@_flight_init(&own);
}

bool controllerOutOfTreeTest(void)
{
    return controllerPidTest();
}

void controllerOutOfTree(control_t *control, const setpoint_t *setpoint, const sensorData_t *sensors,
                         const state_t *state, const stabilizerStep_t stabilizerStep)
{
    const bool late = xTaskGetTickCount() - found_at > M2T(200); /* the app's task does not get to run */
    state_t leaned = *state;
    int j;
    supply += 0.01f * (pmGetBatteryVoltage() - supply);
    if (!late) {
        leaned.attitude.roll += roll_offset;
        leaned.attitude.pitch += pitch_offset;
    }
    controllerPid(control, setpoint, sensors, &leaned, stabilizerStep);
    taskENTER_CRITICAL();
    newest = *setpoint;
    taskEXIT_CRITICAL();
    if (control->controlMode != controlModeLegacy || !(control->thrust > 0.0f))
        return;
    {
        /* as power_distribution_quadrotor.c distributes the PID's wishes; a union, so read first */
        const float thrust = control->thrust, yaw = control->yaw;
        const float roll = (float)(int16_t)(control->roll / 2.0f), pitch = (float)(int16_t)(control->pitch / 2.0f);
        const float pid[STABILIZER_NR_OF_MOTORS] = {thrust - roll + pitch + yaw, thrust - roll - pitch - yaw,
                                                    thrust + roll - pitch + yaw, thrust + roll + pitch - yaw};
        for (j = 0; j < STABILIZER_NR_OF_MOTORS; ++j) {
            wished[j] = pid[j] / FULL;
            control->normalizedForces[j] = wished[j] + (late ? 0.0f : added[j]);
        }
        control->controlMode = controlModeForce;
    }
}
