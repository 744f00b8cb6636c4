/* PX4: adds what was learned to the motors' set-points, and to accelerations. Written by a program. */
#ifndef @UPPER@_PX4_H
#define @UPPER@_PX4_H

#include <uORB/topics/actuator_motors.h>
#include <uORB/topics/trajectory_setpoint.h>

#include "@NAME@_flight.h"

#ifdef __cplusplus
extern "C" {
#endif

/* What PX4 knows beside the set-point. */
typedef struct {
    uint64_t now;       /* us, hrt_absolute_time() */
    uint8_t nav_state;  /* of vehicle_status: only offboard mode (14) follows set-points from outside */
    float hover_thrust; /* of hover_thrust_estimate, else MPC_THR_HOVER; none of 0 to 1, or NaN: the model's own */
    float battery;      /* V, or 0 where the model does not read it */
    int leans;          /* 1: set-points that Etude wrote, which hold against the drag; 0: others */
    int decoupled;      /* MPC_ACC_DECOUPLE, 1 by default */
} @NAME@_px4;

/* Of a trajectory_setpoint (north, east, down), dt s after the last call. PX4 turns its acceleration into collective
   thrust itself, hover thrust for g: that is taken off, so that no force is commanded twice. Motors that PX4
   stopped (NaN) stay stopped. Returns flags as @NAME@_flight_ask. */
unsigned @NAME@_px4_add(@NAME@_flight *own, const struct trajectory_setpoint_s *asked, const @NAME@_px4 *beside,
                        float dt, struct actuator_motors_s *motors);

/* Lets a set-point that Etude did not write hold against the learned drag, and allow for delay and damping of
   PX4's cascade, better with its jerk: call it before PositionControl takes it, and say leans = 0 above. Returns 0
   where nothing was added. */
int @NAME@_px4_lean(struct trajectory_setpoint_s *asked);

#ifdef __cplusplus
}
#endif

#endif
