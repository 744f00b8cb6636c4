#pragma once
#include <stdint.h>
#define taskENTER_CRITICAL()
#define taskEXIT_CRITICAL()
void vTaskDelay(unsigned ticks);
uint32_t xTaskGetTickCount(void);
