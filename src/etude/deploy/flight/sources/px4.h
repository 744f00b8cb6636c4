/* PX4: adds what was learned to the motors' set-points. Written by a program. */
#ifndef @UPPER@_PX4_H
#define @UPPER@_PX4_H

#include <uORB/topics/actuator_motors.h>
#include <uORB/topics/trajectory_setpoint.h>

#include "@NAME@_flight.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Of a trajectory_setpoint (north, east, down), dt s after the last call; battery in V, or 0 where the model does
   not read it. Motors that PX4 stopped (NaN) stay stopped. Returns flags as @NAME@_flight_ask. */
unsigned @NAME@_px4_add(@NAME@_flight *own, const struct trajectory_setpoint_s *asked, float battery, float dt,
                        struct actuator_motors_s *motors);

#ifdef __cplusplus
}
#endif

#endif
