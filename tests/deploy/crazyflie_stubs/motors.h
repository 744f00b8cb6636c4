#pragma once
#include <stdint.h>
float motorsCompensateBatteryVoltage(uint32_t id, float iThrust, float supplyVoltage);
