/* Runs the controller as the firmware would: lines of the PID's wishes and a set-point in; out the mode, forces,
   the duty that the firmware makes of them, and of the PID's alone, and the attitude that the PID was given.

   The app's task runs between two steps of the stabilizer: its delay is where these are. Duty: the curve of the
   2.1+ as platform_defaults_cf2.h of August 2026 has it, solved here by halving; without COMPENSATED none. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "FreeRTOS.h"
#include "app.h"
#include "controller.h"
#include "controller_pid.h"
#include "motors.h"
#include "pm.h"
#include "task.h"

static control_t wished;
static setpoint_t asked;
static state_t given;
static stabilizerStep_t step;
static float supply = 4.2f;
static int rows = -1;

uint32_t xTaskGetTickCount(void) { return step; }
float pmGetBatteryVoltage(void) { return 3.9f; }
void controllerPidInit(void) {}
bool controllerPidTest(void) { return true; }

void controllerPid(control_t *control, const setpoint_t *setpoint, const sensorData_t *sensors, const state_t *state,
                   const stabilizerStep_t stabilizerStep)
{
    (void)setpoint, (void)sensors, (void)stabilizerStep;
    given = *state;
    *control = wished;
}

float motorsCompensateBatteryVoltage(uint32_t id, float iThrust, float supplyVoltage)
{
#ifdef COMPENSATED
    const double force = (double)iThrust / 65535.0 * 0.12;
    double low = 0.5, high = 6.0;
    (void)id;
    if (force < 0.0128175784)
        return 0.0f;
    while (high - low > 1e-7) {
        const double v = 0.5 * (low + high);
        if (-0.0247653792 + v * (0.0652379353 + v * (-0.026792505 + v * 0.0067767893)) < force)
            low = v;
        else
            high = v;
    }
    return (float)(65535.0 * low / (double)supplyVoltage);
#else
    (void)id, (void)supplyVoltage;
    return iThrust;
#endif
}

static float number(void)
{
    char word[64];
    return scanf("%63s", word) == 1 ? strtof(word, NULL) : 0.0f;
}

static void read3(vec3_t *own)
{
    own->x = number();
    own->y = number();
    own->z = number();
}

static void run(control_t *control)
{
    static const sensorData_t sensors = {0};
    static const state_t state = {{1.0f, 2.0f, 3.0f}};
    supply += 0.01f * (pmGetBatteryVoltage() - supply);
    controllerOutOfTree(control, &asked, &sensors, &state, step++);
}

static void show(const control_t *control)
{
    const float roll = (float)(int16_t)(wished.roll / 2.0f), pitch = (float)(int16_t)(wished.pitch / 2.0f);
    const float pid[4] = {wished.thrust - roll + pitch + wished.yaw, wished.thrust - roll - pitch - wished.yaw,
                          wished.thrust + roll - pitch + wished.yaw, wished.thrust + roll + pitch - wished.yaw};
    int i;
    printf("%d ", (int)control->controlMode);
    for (i = 0; i < 4; ++i)
        printf("%.9g ", (double)control->normalizedForces[i]);
    for (i = 0; i < 4; ++i)
        printf("%.9g ", (double)(motorsCompensateBatteryVoltage((uint32_t)i, 65535.0f * control->normalizedForces[i],
                                                                 supply) / 65535.0f));
    for (i = 0; i < 4; ++i)
        printf("%.9g ", (double)(motorsCompensateBatteryVoltage((uint32_t)i, pid[i], supply) / 65535.0f));
    printf("%.9g %.9g\n", (double)given.attitude.roll, (double)given.attitude.pitch);
}

void vTaskDelay(unsigned ticks)
{
    control_t control;
    if (rows >= 0) {
        run(&control);
        show(&control);
    } else {
        rows = (int)number();
    }
    if (rows-- == 0)
        exit(0);
    wished.controlMode = controlModeLegacy;
    wished.roll = (int16_t)number();
    wished.pitch = (int16_t)number();
    wished.yaw = (int16_t)number();
    wished.thrust = number();
    asked.mode.x = asked.mode.y = asked.mode.z = number() > 0.0f ? modeAbs : modeDisable;
    read3(&asked.position);
    read3(&asked.velocity);
    read3(&asked.acceleration);
    read3(&asked.jerk);
    asked.attitude.yaw = number();
    asked.timestamp = step - (uint32_t)(1000.0f * number());
    while (ticks-- > 1)
        run(&control);
}

int main(void)
{
    memset(&asked, 0, sizeof asked);
    step = 100000;
    controllerOutOfTreeInit();
    if (!controllerOutOfTreeTest())
        return 1;
    appMain();
    return 0;
}
