/* Time of the onboard detector (`make detector-speed`): a window of noise with jumps, sample by sample and in batches.
 * Prints, for each batch, the median over windows of ns and of cycles of the time stamp counter a sample, and the
 * longest call. Built with the settings of one wheel (rwa_detector_settings.h). */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <x86intrin.h>

#include "rwa_detector.h"
#include "rwa_detector_settings.h"

#define WINDOWS 9

static int ascending(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double gaussian(void) { /* of twelve uniform variables */
    double sum = -6.0;
    for (int i = 0; i < 12; ++i) sum += rand() / (double)RAND_MAX;
    return sum;
}

static double seconds(void) {
    struct timespec now;
    timespec_get(&now, TIME_UTC);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

int main(void) {
    const int64_t slots = (int64_t)rwa_detector_of_wheel.slots;
    const size_t bytes = rwa_detector_bytes(&rwa_detector_of_wheel);
    void *memory = malloc(bytes);
    double *speed = malloc(sizeof(double) * (size_t)slots), *friction = malloc(sizeof(double) * (size_t)slots);
    rwa_jump jumps[64];
    for (int64_t k = 0; k < slots; ++k) {
        speed[k] = 200.0 + 80.0 * sin((double)k / 3000.0);
        friction[k] = 1.6e-3 + 5.3e-6 * speed[k] + 3.9e-5 * gaussian() + (double)((k / 2000) % 2) * 8e-4;
    }
    for (int64_t batch = 1; batch <= 64; batch *= 64) {
        double ns[WINDOWS], cycles[WINDOWS], longest[WINDOWS];
        for (int w = 0; w < WINDOWS; ++w) {
            rwa_detector *detector = rwa_detector_open(&rwa_detector_of_wheel, memory, bytes);
            unsigned long long worst = 0;
            const double begun = seconds();
            const unsigned long long first = __rdtsc();
            for (int64_t k = 0; k + batch <= slots; k += batch) {
                const unsigned long long before = __rdtsc();
                rwa_detector_add(detector, speed + k, friction + k, batch, jumps, 64);
                const unsigned long long took = __rdtsc() - before;
                if (took > worst) worst = took;
            }
            cycles[w] = (double)(__rdtsc() - first) / (double)slots;
            ns[w] = 1e9 * (seconds() - begun) / (double)slots;
            longest[w] = (double)worst;
        }
        qsort(ns, WINDOWS, sizeof *ns, ascending);
        qsort(cycles, WINDOWS, sizeof *cycles, ascending);
        qsort(longest, WINDOWS, sizeof *longest, ascending);
        printf("%2lld a call: %.0f ns, %.0f cycles a sample; longest call %.0f cycles\n", (long long)batch,
            ns[WINDOWS / 2], cycles[WINDOWS / 2], longest[WINDOWS / 2]);
    }
    return 0;
}
