// The noise of a window, measured beside its jumps (see rwa_monitor/changepoints/noise.py).
#pragma once

#include "arrays.hpp"
#include "wglr.hpp"

namespace rwa {

constexpr std::int64_t LAGS = 64;    // lags 1 … 64 of the differences; the autocovariance is given at 0 … 63
constexpr std::int64_t BLOCK = 64;   // base slots of a block; a block reads BLOCK + LAGS samples
constexpr double SMALLEST_STD = 1e-9;  // normalised; the rounding errors of noise-free data lie far below

// Lower edge and width of each bin of the statistic's histogram [torque²].
struct Bins {
    std::array<double, BINS> edges{}, widths{};
};
constexpr Bins statistic_bins() {
    Bins bins;
    double octave = 1.0;
    for (std::int64_t i = 0; i > LOWEST_EXPONENT; --i) octave /= 2.0;
    for (std::int64_t i = 0; i < BINS; ++i) {
        const std::int64_t within = i % BINS_PER_OCTAVE;
        if (i > 0 && within == 0) octave *= 2.0;
        bins.widths[i] = octave / BINS_PER_OCTAVE;
        bins.edges[i] = octave + static_cast<double>(within) * bins.widths[i];
    }
    return bins;
}
inline constexpr Bins STATISTIC_BINS = statistic_bins();

Table<double, 1> scale_variances(
    Matrix<const std::int64_t> histogram, Vector<const std::int64_t> scales, double start_variance);
void block_differences(
    Vector<const double> x, Vector<const double> z, Vector<const bool> used, std::int64_t first, std::int64_t last,
    std::int64_t hop, double slope, double weight, Matrix<double> sums, Matrix<double> pairs);
// levels and counts, each (LAGS,)
std::tuple<Table<double, 1>, Table<double, 1>> quiet_levels(Matrix<const double> sums, Matrix<const double> pairs);
Table<double, 1> contrast_variances(Vector<const double> levels, Vector<const std::int64_t> scales);
Table<double, 1> mean_variance_factors(
    Vector<const double> count, Vector<const double> autocovariance, double long_run_factor);

}  // namespace rwa
