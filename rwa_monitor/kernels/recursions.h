/* Recursions of effects with memory, one sample a call, in C99. The kernels loop over them, and an exported model holds
 * those that it needs: each is written once. A part between two lines of dashes stands alone.
 * `state` is changed in place; NaN in state[0] is the start of a record. */
#include <math.h>

/* ---- rwa_sign ---------------------------------------------------------------------------------------------------- */
/* -1, 0 or 1; NaN for NaN. */
static double rwa_sign(double value)
{
    return (value > 0.0) ? 1.0 : ((value < 0.0) ? -1.0 : value);
}

/* ---- rwa_dahl_bristle -------------------------------------------------------------------------------------------- */
/* A bristle's deflection z/z_c after sliding by an angle in one direction [rad]. */
static double rwa_slide(double bristle, double angle_rad, double scale_rad)
{
    const double side = rwa_sign(angle_rad);
    return side + ((bristle - side) * exp(-fabs(angle_rad) / scale_rad));
}

/* Dahl's bristle dz/dt = w - |w| z/z_c by its exact step in angle; state: z/z_c and the last speed [rad/s]. */
static double rwa_dahl_bristle(double *state, double speed_rad_s, double dt_s, double scale_rad)
{
    const double before = state[1];
    double bristle = state[0];
    if (isnan(bristle) != 0) {
        bristle = rwa_sign(speed_rad_s);
    } else if ((before * speed_rad_s) < 0.0) { /* a step in which the speed changes its sign is two */
        const double crossing_s = dt_s * before / (before - speed_rad_s);
        bristle = rwa_slide(bristle, 0.5 * before * crossing_s, scale_rad);
        bristle = rwa_slide(bristle, 0.5 * speed_rad_s * (dt_s - crossing_s), scale_rad);
    } else {
        bristle = rwa_slide(bristle, 0.5 * (before + speed_rad_s) * dt_s, scale_rad);
    }
    state[0] = bristle;
    state[1] = speed_rad_s;
    return bristle;
}

/* ---- rwa_first_order_lag ----------------------------------------------------------------------------------------- */
/* Weights of the new value, the last one, and the lagged one, for a step. */
static void rwa_lag_weights(double *weights, double dt_s, double time_constant_s)
{
    const double ratio = dt_s / time_constant_s;
    const double keep = exp(-ratio);
    const double mean = (ratio > 0.0) ? (-expm1(-ratio) / ratio) : 1.0;
    weights[0] = 1.0 - mean;
    weights[1] = mean - keep;
    weights[2] = keep;
}

/* First-order lag dx/dt = (u - x)/T, exact for u that is linear between samples; state: x and the last u. */
static double rwa_lag_step(double *state, double value, const double *weights)
{
    if (isnan(state[0]) != 0) {
        state[0] = value;
        state[1] = value;
    }
    state[0] = (weights[0] * value) + ((weights[2] * state[0]) + (weights[1] * state[1]));
    state[1] = value;
    return state[0];
}

static double rwa_first_order_lag(double *state, double value, double dt_s, double time_constant_s)
{
    double weights[3];
    rwa_lag_weights(weights, dt_s, time_constant_s);
    return rwa_lag_step(state, value, weights);
}

/* ---- rwa_time_since ---------------------------------------------------------------------------------------------- */
/* Time since |value| was above a threshold [s]; state: that time, infinite before. */
static double rwa_time_since(double *state, double value, double dt_s, double threshold)
{
    state[0] = (fabs(value) > threshold) ? 0.0 : (state[0] + dt_s);
    return state[0];
}
