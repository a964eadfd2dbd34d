/* Reads samples from a pipe, "speed [rad/s] friction [N m]" a line, and prints each jump as soon as it is certain:
 * slot since the first sample, jump [N m], standard deviation [N m]. Samples of a slot that lacks one are "nan nan". Built with the settings of one wheel (rwa_detector_settings.h). */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "rwa_detector.h"
#include "rwa_detector_settings.h"

int main(void) {
    const size_t bytes = rwa_detector_bytes(&rwa_detector_of_wheel);
    void *memory = malloc(bytes);
    rwa_detector *detector = rwa_detector_open(&rwa_detector_of_wheel, memory, bytes);
    double speed, friction;
    rwa_jump jumps[64];
    int64_t begin = 0, slot = 0; /* of the window; of the sample */
    if (detector == NULL) return 1;
    while (scanf("%lf %lf", &speed, &friction) == 2) {
        int64_t found = rwa_detector_add(detector, &speed, &friction, 1, jumps, 64);
        if (found < 0) { /* the window is full: the next one begins in the same memory */
            begin = slot;
            detector = rwa_detector_open(&rwa_detector_of_wheel, memory, bytes);
            found = rwa_detector_add(detector, &speed, &friction, 1, jumps, 64);
        }
        ++slot;
        for (int64_t i = 0; i < found; ++i) {
            printf("%lld %.17g %.17g\n", (long long)(begin + jumps[i].slot), jumps[i].jump_Nm, jumps[i].std_Nm);
        }
    }
    fprintf(stderr, "memory: %zu bytes given, %zu used\n", bytes, rwa_detector_most_used(detector));
    free(memory);
    return 0;
}
