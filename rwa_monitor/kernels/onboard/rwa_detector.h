/* Jumps of a reaction wheel's friction, as soon as they are certain: stage 1 of rwa-monitor, for flight software.
 *
 * All memory is the caller's: one block, given at rwa_detector_open. Nothing is allocated, nothing is thrown, nothing
 * is locked. The same samples give the same jumps as the monitor's provisional changepoints, however they are cut.
 */
#ifndef RWA_DETECTOR_H
#define RWA_DETECTOR_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define RWA_TAIL_NODES 257

/* Of one wheel, as `rwa-monitor export WHEEL.toml --to detector` writes them; NaN where nothing is known. */
typedef struct {
    int64_t slots;          /* of a window */
    double speed_unit;      /* [rad/s] */
    double torque_unit;     /* [N m] */
    double dead_band;       /* of the speed's unit */
    int64_t block_hop;
    double start_std, prior_mean, prior_std, nominal_slope;
    double outlier, sure_outlier, sure_margin, sure_statistic, jump_share;
    /* Largest outliers of noise with heavy tails, in robust standard deviations, by the ratio of two quantiles. */
    double tail_ratio[RWA_TAIL_NODES], tail_outlier[RWA_TAIL_NODES], tail_sure[RWA_TAIL_NODES];
} rwa_detector_settings;

typedef struct {
    int64_t slot;      /* of the window, from 0: the first of the new level */
    double jump_Nm;
    double std_Nm;
} rwa_jump;

typedef struct rwa_detector rwa_detector;

/* The bytes that a detector needs. */
size_t rwa_detector_bytes(const rwa_detector_settings *settings);

/* Begin a window in `memory`, aligned as by malloc; NULL where `bytes` are too few. A window that is full, or no longer
 * wanted, ends with the next call of this. */
rwa_detector *rwa_detector_open(const rwa_detector_settings *settings, void *memory, size_t bytes);

/* Take `count` consecutive samples: speed [rad/s], friction torque [N m], NaN where there is none. Writes up to `most`
 * jumps that became certain, and returns how many there are, the rest of which is lost; -1, and nothing is taken, where
 * the window cannot hold so many samples. */
int64_t rwa_detector_add(rwa_detector *detector, const double *speed_rad_s, const double *friction_Nm, int64_t count,
                         rwa_jump *jumps, int64_t most);

/* The most bytes of its memory that were in use. */
size_t rwa_detector_most_used(const rwa_detector *detector);

#ifdef __cplusplus
}
#endif
#endif
