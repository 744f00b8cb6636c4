/* Runs the controller as the stabilizer would: lines of the PID's wishes and a set-point in, forces out. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "app.h"
#include "controller.h"
#include "controller_pid.h"
#include "pm.h"
#include "task.h"

static control_t wished;

void vTaskDelay(unsigned ticks) { exit((int)ticks); }
float pmGetBatteryVoltage(void) { return 3.9f; }
void controllerPidInit(void) {}
bool controllerPidTest(void) { return true; }

void controllerPid(control_t *control, const setpoint_t *setpoint, const sensorData_t *sensors, const state_t *state,
                   const stabilizerStep_t stabilizerStep)
{
    (void)setpoint, (void)sensors, (void)state, (void)stabilizerStep;
    *control = wished;
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

int main(void)
{
    setpoint_t asked;
    control_t control;
    const sensorData_t sensors = {0};
    const state_t state = {0};
    stabilizerStep_t step = 0;
    int i, rows = (int)number();
    memset(&asked, 0, sizeof asked);
    controllerOutOfTreeInit();
    if (!controllerOutOfTreeTest())
        return 1;
    while (rows-- > 0) {
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
        for (i = 0; i < 10; ++i)  /* ten steps of the stabilizer for one of the model's */
            controllerOutOfTree(&control, &asked, &sensors, &state, step++);
        printf("%d ", (int)control.controlMode);
        for (i = 0; i < 4; ++i)
            printf("%.9g ", (double)control.normalizedForces[i]);
        printf("\n");
    }
    return 0;
}
