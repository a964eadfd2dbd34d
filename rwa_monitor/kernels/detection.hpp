// Declarations shared by the sources of stages 1 and 3, in the order of the data flow, and the running sums.
#pragma once

#include "arrays.hpp"

namespace rwa {

// Slots of a block, in which a window is processed, a multiple of STRIDE: the sums are centred on the first used block,
// and peaks are confirmed, differences (over the LAGS after it, too) and directions of rotation stored block by block.
constexpr int64_t BLOCK = 64;

// ---- running sums (running_sums.cpp): the sufficient statistics of any range of slots -------------------------------

constexpr int64_t STRIDE = 16;  // slots from one checkpoint to the next

struct SumArrays {
    Matrix<double> checkpoints;
    Vector<double> x, z;
    Vector<bool> used;
    Vector<double> centre;
    FIELDS(checkpoints, x, z, used, centre)
};

// n, Σx, Σz, Σx², Σxz, Σz²
struct Sums {
    double n = 0.0, x = 0.0, z = 0.0, xx = 0.0, xz = 0.0, zz = 0.0;

    Sums operator-(const Sums& first) const {
        return {n - first.n, x - first.x, z - first.z, xx - first.xx, xz - first.xz, zz - first.zz};
    }
    double level(double slope) const { return (z - slope * x) / n; }
    // To or from one column of a table with a row for each sum, or one row of a table with a column for each.
    void write(double* at, int64_t apart) const {
        for (double sum : {n, x, z, xx, xz, zz}) *at = sum, at += apart;
    }
    static Sums read(const double* at, int64_t apart) {
        return {at[0], at[apart], at[2 * apart], at[3 * apart], at[4 * apart], at[5 * apart]};
    }
};

// The centred sums over the slots [0, k); reads at most 15 samples.
inline Sums prefix_moments(int64_t k, const SumArrays& arrays) {
    Sums sums = Sums::read(&arrays.checkpoints(k / STRIDE, 0), 1);
    for (int64_t i : range(k - k % STRIDE, k)) {
        if (!arrays.used[i]) continue;
        const double u = arrays.x[i] - arrays.centre[0], v = arrays.z[i] - arrays.centre[1];
        sums = {sums.n + 1.0, sums.x + u, sums.z + v, sums.xx + u * u, sums.xz + u * v, sums.zz + v * v};
    }
    return sums;
}

// The statistics, not centred, of the slots between two results of `prefix_moments`.
inline Sums moments_between(const Sums& first, const Sums& last, const Vector<double>& centre) {
    const double cx = centre[0], cz = centre[1];
    const auto [n, sx, sz, sxx, sxz, szz] = last - first;
    return {n, sx + n * cx, sz + n * cz, sxx + 2.0 * cx * sx + n * cx * cx, sxz + cx * sz + cz * sx + n * cx * cz,
            szz + 2.0 * cz * sz + n * cz * cz};
}

// Add the slots [start, stop) to the running sums and keep them at every checkpoint passed.
void extend_sums(const SumArrays& arrays, Vector<double> running, int64_t start, int64_t stop);

// Slope that all intervals share, and its standard deviation, from the slots so far.
tuple<double, double> slope_within(
    int64_t slots, Integers index, Integers exclude, const SumArrays& sums, double variance, double prior_mean,
    double prior_std);

// ---- the windowed generalised likelihood ratio at several scales, and its peaks (wglr.cpp) --------------------------

constexpr int64_t CHUNK = 1024;   // slots after which the prefix sums restart: a quarter more work for 50 kB
constexpr int64_t MAX_SCALE = 128;
constexpr int64_t HISTORY = 2 * MAX_SCALE;  // slots before a chunk that its first statistics use
constexpr int64_t PREFIXES = 5;             // n, x, e, xx, xe

// Histogram of the statistic: 16 bins per octave, from 2⁻⁶⁰ to 2³⁶ torque². The leading bits of a float are the number
// of its bin, counted from FIRST_BIN.
constexpr int64_t BINS_PER_OCTAVE = 16;
constexpr int64_t LOWEST_EXPONENT = -60;
constexpr int64_t BINS = 96 * BINS_PER_OCTAVE;
constexpr int64_t BIN_SHIFT = 48;  // of 52 mantissa bits, 4 stay
constexpr int64_t FIRST_BIN = (1023 + LOWEST_EXPONENT) * BINS_PER_OCTAVE;

// Every how many slots a statistic of scale w is counted in the histogram.
inline int64_t counted_every(int64_t w) { return w < 4 ? 1 : w / 4; }

// Settings of a scan: W_b and f̃_v; of each scale the variance of its contrast, and the statistics [torque²] above which
// a peak is kept (infinite to keep none), and above which it is reported at once.
struct ScanSettings {
    double weight, slope;
    Floats variances, floors, sure;
    FIELDS(weight, slope, variances, floors, sure)
};

// A peak in the scan, with the number of its scale; final when no later slot can replace it.
struct ScannedPeak {
    int64_t scale, index;
    double statistic, jump;
    bool final;
};

// A peak, or the candidate derived from it: the first slot of a new level, the half-width that detected it, and the
// statistic over the variance of its scale.
struct Peak {
    int64_t index, scale;
    double statistic, jump;
};

// The state of the detection in a window.
struct Detector {
    explicit Detector(Integers half_widths);

    // Advance the detection over the slots [start, stop), and the histogram where it is `counting`.
    void scan(Floats x, Floats z, Flags used, int64_t start, int64_t stop, bool counting, const ScanSettings& settings);

    // The peaks whose statistic, over its scale's variance, reaches `threshold`; by slot, then narrow scales first.
    vector<Peak> above(double threshold, Floats variances) const;

    NewIntegers scales;                  // half-widths w [slots], ascending
    Table<int64_t, 2> histogram;         // (S, BINS), of the statistic at every `counted_every`-th slot
    vector<ScannedPeak> confirmed;  // the sure peaks that became final in the last scan

    void keep(const double* statistic, const double* jump, int64_t first, int64_t count, int64_t scale, double floor);
    void confirm(int64_t stop, Floats sure);
    void prune(Floats variances);

    NewMatrix prefix;  // column HISTORY + k - chunk holds the sums of (n, x, e, xx, xe) before slot k
    vector<ScannedPeak> peaks;
    vector<array<int64_t, 2>> open;  // of each scale the last peak of each sign; -1 for none
    size_t settled = 0;                   // peaks before this one are final
    size_t chunk_peaks;                   // that a chunk can give at most
};

// The fields of `Candidates`.
using Columns = tuple<NewIntegers, NewIntegers, NewFloats, NewFloats>;
template <typename Peaks>
Columns columns_of(const Peaks& peaks) {
    Columns columns;
    auto& [index, scale, statistic, jump] = columns;
    for (const Peak& peak : peaks) {
        index.push_back(peak.index);
        scale.push_back(peak.scale);
        statistic.push_back(peak.statistic);
        jump.push_back(peak.jump);
    }
    return columns;
}

// ---- the noise of a window, estimated in the presence of jumps (noise.cpp) ------------------------------------------

constexpr int64_t LAGS = 64;        // lags 1 … 64 of the differences; the autocovariance is given at 0 … 63
constexpr double SMALLEST_STD = 1e-9;    // normalised; far above the rounding errors of noise-free data

void block_differences(
    Floats x, Floats z, Flags used, int64_t first, int64_t last, int64_t hop, double slope, double weight,
    Matrix<double> sums, Matrix<double> pairs);

// Number of statistics, their median and 99.5 % quantile, as middles of bins of the histogram.
using Quantiles = tuple<double, double, double>;
constexpr double CHI_MEDIAN = 0.4549364231195728;  // median of χ²₁
bool are_heavy(const Quantiles& quantiles, double variance);

// Levels and counts of the complete blocks (`quiet_levels`), the variance of each scale's contrast, and the quantiles
// of the narrowest scale's statistic.
using Noise = tuple<NewFloats, NewFloats, NewFloats, Quantiles>;
Noise learn_noise(
    FloatMatrix block_sums, FloatMatrix block_pairs, IntegerMatrix histogram, Integers scales,
    double start_variance, double jump_share);

// ---- direction, dead band and wheel angle (running_sums.cpp) --------------------------------------------------------

struct StructureArrays {
    Vector<int64_t> signs, counts;
    Matrix<double> near_zero;
    Vector<double> zeros;
    Matrix<double> ripple;
    FIELDS(signs, counts, near_zero, zeros, ripple)
};

// Number of pieces of `length` slots, one every `hop` slots from 0 on, that end by `slot`.
inline int64_t pieces_before(int64_t slot, int64_t length, int64_t hop) {
    return slot < length ? 0 : (slot - length) / hop + 1;
}

void count_signs(int64_t first, Floats speed, Flags good, Vector<int64_t> signs, Vector<int64_t> counts);
void extend_structure(
    Floats motion, Floats x, Floats z, Flags good, Flags used, int64_t start, int64_t stop, double certain,
    double angle_per_x, int64_t hop, const StructureArrays& arrays);

// ---- from the peaks of all scales to the candidates of a window (changepoints.cpp) ----------------------------------

// The wGLR's statistic [torque²] and jump at slot k and scale w, with any centre and weight of the slope (see wglr.pyi).
// Both 0 where a half has no used sample.
tuple<double, double> contrast(int64_t k, int64_t w, double slope, double weight, const SumArrays& sums);

// Sort peaks into the order in which they are tried: narrow scales and large statistics first.
void sort_in_turn(vector<Peak>& peaks);

// The slots of the peaks, in order, that have no earlier kept one within ±w; sorted.
NewIntegers kept_apart(const vector<Peak>& peaks);

// ---- a switching path as a linear model with a Gaussian prior (friction.cpp) ----------------------------------------

// See stage_results.SwitchingPath.
template <typename Slots>
struct PathOf {
    Slots configurations, starts, sojourns, unattributed;
    FIELDS(configurations, starts, sojourns, unattributed)
};
using SwitchingPath = PathOf<Integers>;

// See friction_model.Cases.
struct Cases {
    FloatCube laws, states;
    IntegerMatrix choice;
    Floats log_prior, rest;
    FIELDS(laws, states, choice, log_prior, rest)
};

// The log evidence of `solve_cases` alone, without the posterior.
double evidence_of_cases(
    const SwitchingPath& path, Integers borders, FloatMatrix statistics, const Cases& cases, double variance,
    double scatter);

}  // namespace rwa
