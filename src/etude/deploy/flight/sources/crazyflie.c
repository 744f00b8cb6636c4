/* Crazyflie: the PID controller, with what was learned added to each motor. Written by a program.
   An out-of-tree controller of the app layer; select it with the parameter stabilizer.controller. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#include "FreeRTOS.h"
#include "app.h"
#include "controller.h"
#include "controller_pid.h"
@PM@#include "stabilizer_types.h"
#include "task.h"

#include "@NAME@_flight.h"

#define RATE @RATE@ /* Hz at which the model is asked */
#define FULL 65535.0f

static const int motor_of[@UPPER@_COMMANDS] = {@MOTORS@};
static @NAME@_flight own;
static @NAME@_real extra[@UPPER@_COMMANDS];

void appMain(void)
{
    while (1)
        vTaskDelay(M2T(2000));
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

static void ask(const setpoint_t *setpoint)
{
    const float nowhere = NAN;
    const bool whole = setpoint->mode.x == modeAbs && setpoint->mode.y == modeAbs && setpoint->mode.z == modeAbs;
    @NAME@_setpoint point = {
        .altitude = whole ? setpoint->position.z : nowhere,
        .velocity = {setpoint->velocity.x, setpoint->velocity.y, setpoint->velocity.z},
        .acceleration = {setpoint->acceleration.x, setpoint->acceleration.y, setpoint->acceleration.z},
        .jerk = {setpoint->jerk.x, setpoint->jerk.y, setpoint->jerk.z},
        .yaw = setpoint->attitude.yaw * 0.017453293f,
        .battery = @BATTERY@,
    };
    (void)@NAME@_flight_ask(&own, &point, 1.0f / RATE, extra);
}

void controllerOutOfTree(control_t *control, const setpoint_t *setpoint, const sensorData_t *sensors,
                         const state_t *state, const stabilizerStep_t stabilizerStep)
{
    int j;
    controllerPid(control, setpoint, sensors, state, stabilizerStep);
    if (RATE_DO_EXECUTE(RATE, stabilizerStep))
        ask(setpoint);
    if (control->controlMode != controlModeLegacy || !(control->thrust > 0.0f))
        return;
    {
        /* as power_distribution_quadrotor.c distributes the PID's wishes; a union, so read first */
        const float thrust = control->thrust, yaw = control->yaw;
        const float roll = (float)(int16_t)(control->roll / 2.0f), pitch = (float)(int16_t)(control->pitch / 2.0f);
        const float pid[STABILIZER_NR_OF_MOTORS] = {thrust - roll + pitch + yaw, thrust - roll - pitch - yaw,
                                                    thrust + roll - pitch + yaw, thrust + roll + pitch - yaw};
        for (j = 0; j < STABILIZER_NR_OF_MOTORS; ++j)
            control->normalizedForces[j] = pid[j] / FULL;
        for (j = 0; j < @UPPER@_COMMANDS; ++j)
            control->normalizedForces[motor_of[j]] += (float)extra[j];
        control->controlMode = controlModeForce;
    }
}
