/* Set-points in, what motion takes beyond hovering out. Written by a program. */
#ifndef @UPPER@_FLIGHT_H
#define @UPPER@_FLIGHT_H

#include "@NAME@.h"
#include "@NAME@_lean.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A set-point. World: z up. What is not known is NaN: jerk then counts as 0, anything else ends the feedforward. */
typedef struct {
    @NAME@_real altitude;        /* m */
    @NAME@_real velocity[3];     /* m/s */
    @NAME@_real acceleration[3]; /* m/s^2 */
    @NAME@_real jerk[3];         /* m/s^3 */
    @NAME@_real yaw;             /* rad, from the world's x towards its y */
    @NAME@_real battery;         /* V; any number where the model does not read it */
    @NAME@_real age;             /* s since it came; more than @UPPER@_OLD_S ends the feedforward */
    int followed;                /* whether the vehicle is in a flight mode that follows it */
    int leans;                   /* whether the acceleration holds against the learned drag already */
} @NAME@_setpoint;

/* A set-point's states and the model's answer to them. */
typedef struct {
    @NAME@_real rates[3], turning[3];
    @NAME@_real axes[9];  /* of the body, x, y, z, in a world whose x looks where the vehicle does */
    @NAME@_real told[3];  /* the acceleration that holds against the drag, in that world, m/s^2 */
    @NAME@_real extra[@UPPER@_COMMANDS], hover; /* hover: mean command of hovering at that altitude */
} @NAME@_sample;

typedef struct {
    @NAME@_state model, still;
    @NAME@_real input[@UPPER@_INPUTS]; /* what the model was asked last */
    @NAME@_sample good; /* the last that could be used: it is what fades */
    @NAME@_real trust; /* part that is given out, 0 to 1 */
    @NAME@_real since; /* s since it was asked, for those who call more often than they ask */
    unsigned flags;    /* of the last answer */
    int begun, asked;
} @NAME@_flight;

void @NAME@_flight_init(@NAME@_flight *own);

/* Commands to be added to those of a feedback that holds the vehicle's weight itself and makes no thrust of
   accelerations. The last good ones fade out within @UPPER@_FADE_S where set-points are missing or old, where the
   flight mode is another, or where the model is asked far outside its data; an answer from there is never given
   out. dt: s since the last call. Returns the flags of the model, or @UPPER@_NOT_A_NUMBER without a set-point. */
unsigned @NAME@_flight_ask(@NAME@_flight *own, const @NAME@_setpoint *asked, @NAME@_real dt, @NAME@_real *extra);

#define @UPPER@_FADE_S 0.2
#define @UPPER@_OLD_S 0.5 /* PX4 leaves offboard mode, and a Crazyflie levels, after as much */

#ifdef __cplusplus
}
#endif

#endif
