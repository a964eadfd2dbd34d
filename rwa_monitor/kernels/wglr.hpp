// The windowed generalised likelihood ratio at several scales, and its peaks (see wglr.pyi).
#pragma once

#include "arrays.hpp"

namespace rwa {

constexpr std::int64_t CHUNK = 1024;   // slots after which the prefix sums begin anew: a quarter more work for 50 kB
constexpr std::int64_t STEP = 64;      // slots after which peaks are confirmed
constexpr std::int64_t STRETCH = 512;  // slots that are evaluated in one go at most; a multiple of STEP
constexpr std::int64_t MAX_SCALE = 128;
constexpr std::int64_t HISTORY = 2 * MAX_SCALE;  // slots before a chunk that its first statistics reach back to
constexpr std::int64_t PREFIXES = 5;             // n, x, e, xx, xe
constexpr double NOT_EVALUATED = -1.0;           // a half holds too few used samples

// Histogram of the statistic: 16 bins an octave, straight from the bits of the float, from 2⁻⁶⁰ to 2³⁶ torque².
constexpr std::int64_t BINS_PER_OCTAVE = 16;
constexpr std::int64_t LOWEST_EXPONENT = -60;
constexpr std::int64_t BINS = 96 * BINS_PER_OCTAVE;

// Columns of PeakArrays::slots and ::values, entries of ::counters.
constexpr std::int64_t PEAK_SCALE = 0, PEAK_INDEX = 1, PEAK_CONFIRMED = 2;
constexpr std::int64_t PEAK_STATISTIC = 0, PEAK_JUMP = 1;
constexpr std::int64_t COUNT_PEAKS = 0, COUNT_SETTLED = 1, COUNT_CONFIRMED = 2;

struct PeakArrays {
    Matrix<std::int64_t> slots;
    Matrix<double> values;
    Matrix<std::int64_t> open;
    Vector<std::int64_t> counters, confirmed, told;
    Matrix<double> told_values;
    auto fields() { return std::tie(slots, values, open, counters, confirmed, told, told_values); }
};

struct ScanState {
    Matrix<double> prefix;
    Matrix<std::int64_t> histogram;
    auto fields() { return std::tie(prefix, histogram); }
};

struct ScanSettings {
    Vector<const std::int64_t> scales;
    double weight, slope;
    Vector<const double> floors, sure;
    bool runs;
    auto fields() { return std::tie(scales, weight, slope, floors, sure, runs); }
};

// The slots from one statistic of scale w that goes into the histogram to the next.
inline std::int64_t counted_every(std::int64_t w) { return w < 4 ? 1 : w / 4; }

// index, scale, statistic and jump of chosen peaks
using Peaks = std::tuple<Table<std::int64_t, 1>, Table<std::int64_t, 1>, Table<double, 1>, Table<double, 1>>;

std::int64_t scan(
    Vector<const double> x, Vector<const double> z, Vector<const bool> used, std::int64_t start, std::int64_t stop,
    bool counting, const ScanSettings& settings, const ScanState& state, const PeakArrays& peaks,
    std::int64_t chunk_peaks);
Peaks peaks_above(
    Matrix<const std::int64_t> slots, Matrix<const double> values, std::int64_t count,
    Vector<const std::int64_t> scales, Vector<const double> variances, double threshold);

}  // namespace rwa
