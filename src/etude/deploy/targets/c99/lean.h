/* How a vehicle leans against the drag that was learned: for trajectories that are not known before. Written by
   a program. World: z up, heading from the world's x towards its y, rad. SI units. */
#ifndef @UPPER@_LEAN_H
#define @UPPER@_LEAN_H

#include "@NAME@.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Lateral force of the air per mass, m/s^2, along the body's x and y, at this velocity in the body's frame, m/s. */
void @NAME@_drag(const @NAME@_real *body_velocity, @NAME@_real *force);

/* Axes x, y, z of the body (three numbers each, one axis after the other) of a vehicle that moves like this and
   looks along the first axis of the frame of these vectors, and its rates, rad/s; jerk may be 0: rates are then
   0. Returns 0 where thrust has no sure direction: less than 0.3 of the weight upwards. */
int @NAME@_axes(const @NAME@_real *velocity, const @NAME@_real *acceleration, const @NAME@_real *jerk,
                @NAME@_real *axes, @NAME@_real *rates);

/* What is to be added to the acceleration set-point of a motion, m/s^2, world frame, so that a feedback that makes
   thrust of accelerations holds against the drag. Returns 0, and nothing is to be added, where an input is no
   number or thrust has no sure direction. */
int @NAME@_lean(const @NAME@_real *velocity, const @NAME@_real *acceleration, @NAME@_real yaw, @NAME@_real *lean);

#ifdef __cplusplus
}
#endif

#endif
