// A window's samples on their way in: normalised, through detection, into all that the window keeps of them; and what
// it learns of itself meanwhile: noise, what counts as a peak, the slope, certain jumps. A batch is one call of
// `gather`, the path of every message of the live monitor.
#include "detection.hpp"

namespace rwa {
namespace {
constexpr double LARGEST_VALUE = 1e4;  // normalised; speed or friction beyond is a broken word of telemetry
constexpr double CONFIRMED_STATISTIC = 37.324893051362324;  // χ²₁ exceeds it with probability 1e-9, as in the paper
constexpr double KEPT_STATISTIC = 12.0;     // peaks below are not kept: no threshold at the close is as low
constexpr double CERTAIN_STATISTIC = 30.0;  // peaks that split the window while its slope is first estimated
constexpr double SMALLEST_WEIGHT = 1e-12;   // W_b where nothing is known of the slope: only keeps 0/0 away (errata 3)
constexpr double SMALLEST_SLOPE_SPREAD = 0.05;  // [of the slope] the slope so far is never trusted further than that
constexpr double ANY_SLOPE = 3.0;  // times the slope learned or nominal: no anomaly of viscous friction is further off
constexpr double SMALLEST_SLOPE = 0.1;  // of the dry torque at nominal speed, for next to no viscous friction

// Why `gather` ended: all is done; the first chunk is there, of which Python learns dead band and noise; there is no
// room for the peaks of the next chunk; or the tails of the noise look heavy: only Python has Student's t, and so the
// size of an outlier then.
enum Why : int64_t { ALL_DONE, FIRST_CHUNK, NO_ROOM, HEAVY_TAILS };
enum Bar : int64_t { VARIANCE, FLOOR, SURE };  // rows of Learned::bars
enum Number : int64_t { SLOPE, WEIGHT, BAND, CERTAIN, COUNTED, MEDIAN, FAR, OUTLIER };  // of Learned::numbers

struct Learned {
    Matrix<double> bars;
    Vector<int64_t> announced;
    Vector<double> numbers;
    auto fields() { return std::tie(bars, announced, numbers); }
};

struct WindowArrays {
    Vector<double> x, z;
    Vector<bool> good, used;
    SumArrays sums;
    Vector<double> running;
    StructureArrays structure;
    Matrix<double> block_sums, block_pairs;
    ScanState state;
    Integers scales;
    Learned learned;
    auto fields() {
        return std::tie(x, z, good, used, sums, running, structure, block_sums, block_pairs, state, scales, learned);
    }
};

struct WindowSettings {
    double speed_unit, torque_unit, angle_per_x;
    int64_t block_hop, stretch_hop;
    double start_std, prior_mean, prior_std, nominal_slope, outlier;
    int64_t chunk_peaks;
    auto fields() {
        return std::tie(
            speed_unit, torque_unit, angle_per_x, block_hop, stretch_hop, start_std, prior_mean, prior_std,
            nominal_slope, outlier, chunk_peaks);
    }
};

// A window as Python made it, its arrays looked up once: in every call that would cost as much as 100 samples do (3 µs).
struct Window : WindowArrays {
    WindowSettings by;
    PeakArrays peaks;
    Window(const WindowArrays& arrays, const WindowSettings& settings, const PeakArrays& peak_arrays)
        : WindowArrays(arrays), by(settings), peaks(peak_arrays) {}
    void fields() = delete;  // an object of its own, no tuple
};

// ---- noise ----------------------------------------------------------------------------------------------------------

// The statistics from which a peak of each scale is sure, and from which it is kept. A tail is known to a factor: twice
// the largest outlier by chance is sure, half of it is worth keeping.
void set_bars(const Window& window, double outlier) {
    const auto& bars = window.learned.bars;
    for (int64_t s = 0; s < window.scales.size(); ++s) {
        const double variance = bars(VARIANCE, s);
        if (!std::isfinite(variance)) {
            bars(FLOOR, s) = bars(SURE, s) = INFINITY;
            continue;
        }
        const double by_chance = outlier * outlier / (2.0 * static_cast<double>(window.scales[s]));
        bars(FLOOR, s) = std::max(KEPT_STATISTIC * variance, 0.25 * by_chance);
        bars(SURE, s) = std::max(CONFIRMED_STATISTIC * variance, 4.0 * by_chance);
    }
}

// The blocks of the noise that end by `slot`.
int64_t blocks_before(int64_t slot, const Window& window) {
    return pieces_before(slot, NOISE_BLOCK + LAGS, window.by.block_hop, window.block_sums.shape[0]);
}

// Bring the variance of each scale, and what is kept and sure, up to date. Returns whether the tails of the noise look
// heavy: then the thresholds, made for Gaussian ones, are to be set again.
bool refresh(int64_t done, const Window& window) {
    const auto whole = [&](Matrix<double> table) -> Matrix<const double> {
        return {table.data, {blocks_before(done, window), table.shape[1]}};
    };
    const double start_std = window.by.start_std;
    const auto [levels, counts, variances, quantiles] = learn_noise(
        whole(window.block_sums), whole(window.block_pairs), window.state.histogram, window.scales,
        start_std * start_std);
    const Floats variance = variances;
    std::copy(variance.begin(), variance.end(), window.learned.bars.row(VARIANCE).begin());
    const auto& numbers = window.learned.numbers;
    std::tie(numbers[COUNTED], numbers[MEDIAN], numbers[FAR]) = quantiles;
    if (!std::isfinite(variance[0])) {
        set_bars(window, 0.0);
        return false;
    }
    set_bars(window, window.by.outlier * std::sqrt(variance[0]));
    return are_heavy(quantiles, variance[0]);
}

// ---- slope ----------------------------------------------------------------------------------------------------------

// Centre the slope's prior on what the window has shown so far; takes effect with the next slot.
void learn_slope(int64_t slots, const Window& window) {
    const Floats variances = window.learned.bars.row(VARIANCE);
    double variance = 0.0;
    for (double v : variances) {
        if (std::isfinite(v)) variance = std::max(variance, v);
    }
    if (variance == 0.0) return;
    const auto& peaks = window.peaks;
    std::vector<Peak> certain = peaks_above(
        peaks.slots, peaks.values, peaks.counters[COUNT_PEAKS], window.scales, variances, CERTAIN_STATISTIC);
    sort_in_turn(certain);
    const NewIntegers index = kept_apart(certain), exclude(index.size(), STEP / 4);
    const auto [slope, error] =
        slope_within(slots, index, exclude, window.sums, variance, window.by.prior_mean, window.by.prior_std);
    if (!std::isfinite(error)) return;
    const double spread = std::max({error, SMALLEST_SLOPE_SPREAD * std::abs(slope), SMALLEST_STD});
    window.learned.numbers[SLOPE] = slope;
    window.learned.numbers[WEIGHT] = std::max(variance / (spread * spread), SMALLEST_WEIGHT);
}

// ---- jumps ----------------------------------------------------------------------------------------------------------

// Report, behind the first `told` rows, which of the peaks that the last scan confirmed are new, and sure whatever the
// slope is; returns how many rows there are now.
//
// In a slew, a slope that is off by some per cent looks like jumps: that of the nominal wheel while viscous friction is
// anomalous, that of an earlier part of the window while the anomaly grows. Only a peak that stays one for any slope is
// certain while the window is open; at its close the window's own slope decides.
int64_t report_confirmed(const Window& window, int64_t told) {
    const auto& [bars, announced, numbers] = window.learned;
    const auto& peaks = window.peaks;
    const double slope = numbers[SLOPE];
    const double largest = std::max({std::abs(slope), std::abs(window.by.nominal_slope), SMALLEST_SLOPE});
    const double most_slope = ANY_SLOPE * largest;
    for (int64_t row = 0; row < peaks.counters[COUNT_CONFIRMED]; ++row) {
        const int64_t p = peaks.confirmed[row], s = peaks.slots(p, PEAK_SCALE), index = peaks.slots(p, PEAK_INDEX);
        const int64_t w = window.scales[s];
        const double variance = bars(VARIANCE, s);
        const auto near = [&](int64_t other) { return std::abs(other - index) <= w; };
        if (std::any_of(announced.begin(), announced.begin() + STEP, near)) continue;
        const double weight = std::min(numbers[WEIGHT], variance / (most_slope * most_slope));
        const auto [statistic, jump] = contrast(index, w, slope, weight, window.sums);
        if (!(statistic > bars(SURE, s))) continue;
        announced[announced[STEP]++ % STEP] = index;
        const double normalised = statistic / variance;
        peaks.told[told] = index;
        peaks.told_values(0, told) = jump;
        peaks.told_values(1, told) = std::abs(jump) / std::sqrt(normalised);
        peaks.told_values(2, told) = normalised;
        ++told;
    }
    return told;
}

// ---- samples in -----------------------------------------------------------------------------------------------------

// Truth values as bytes: loops over `bool` are not vectorised.
inline const unsigned char* bytes(const bool* values) { return reinterpret_cast<const unsigned char*>(values); }
inline unsigned char* bytes(bool* values) { return reinterpret_cast<unsigned char*>(values); }

// x = |ω|/unit, z = sign(ω)·torque/unit and whether the slot is good; x and z are zero where it is not. Returns the
// number of good slots. Written so that NaN fails.
VECTORISED int64_t normalise(
    const double* __restrict speed, const double* __restrict torque, const bool* good, int64_t n, double speed_unit,
    double torque_unit, double* __restrict x, double* __restrict z, bool* is_good) {
    const double most_speed = LARGEST_VALUE * speed_unit, most_torque = LARGEST_VALUE * torque_unit;
    const unsigned char* __restrict there = bytes(good);
    unsigned char* __restrict fits = bytes(is_good);
    int64_t count = 0;
    for (int64_t k = 0; k < n; ++k) {
        int64_t fit = there[k];
        fit = std::abs(speed[k]) <= most_speed ? fit : 0;
        fit = std::abs(torque[k]) <= most_torque ? fit : 0;
        fits[k] = static_cast<unsigned char>(fit);
        count += fit;
    }
    for (int64_t k = 0; k < n; ++k) {
        const double turning = fits[k] != 0 ? speed[k] : 0.0, friction = fits[k] != 0 ? torque[k] : 0.0;
        x[k] = std::abs(turning) / speed_unit;
        z[k] = static_cast<double>((turning > 0.0) - (turning < 0.0)) * friction / torque_unit;
    }
    return count;
}

// Mark the slots that are good and turn faster than the dead band.
VECTORISED void mark_used(const double* __restrict x, const bool* good, double band, int64_t n, bool* used) {
    const unsigned char* __restrict there = bytes(good);
    unsigned char* __restrict out = bytes(used);
    for (int64_t k = 0; k < n; ++k) {
        const int64_t turns = x[k] >= band ? there[k] : 0;
        out[k] = static_cast<unsigned char>(x[k] > 0.0 ? turns : 0);
    }
}

void mark_used(const Window& window, int64_t start, int64_t stop) {
    mark_used(
        window.x.data + start, window.good.data + start, window.learned.numbers[BAND], stop - start,
        window.used.data + start);
}

int64_t scan_window(const Window& window, int64_t start, int64_t stop, bool count_bins) {
    const auto& [bars, announced, numbers] = window.learned;
    const ScanSettings settings{
        window.scales, numbers[WEIGHT], numbers[SLOPE], bars.row(FLOOR), bars.row(SURE)};
    return scan(
        window.x, window.z, window.used, start, stop, count_bins, settings, window.state, window.peaks,
        window.by.chunk_peaks);
}

// Detect in the slots [start, stop) and add them to all sums, as far as there is room for peaks; returns the end.
int64_t detect(int64_t start, int64_t stop, const Window& window) {
    if (start >= CHUNK) mark_used(window, start, stop);
    const auto& [bars, announced, numbers] = window.learned;
    const int64_t end = scan_window(window, start, stop, start >= CHUNK);
    find_centre(window.sums, window.running, start, end);
    extend_checkpoints(window.sums, window.running, start, end);
    extend_structure(
        window.x, window.z, window.good, window.used, start, end, numbers[CERTAIN], window.by.angle_per_x,
        window.by.stretch_hop, window.structure);
    const int64_t first = blocks_before(start, window), last = blocks_before(end, window);
    if (last > first) {
        block_differences(
            window.x, window.z, window.used, first, last, window.by.block_hop, numbers[SLOPE], numbers[WEIGHT],
            window.block_sums, window.block_pairs);
    }
    return end;
}

// Whether a power of two is 2, 8, 32 …: after so many chunks the slope is learned.
bool is_odd_power(int64_t chunks) {
    while (chunks > 2) chunks /= 4;
    return chunks == 2;
}

// Take new slots into a window that holds `filled`, and detect in all that are there, from `done` on. Returns how many
// are good, where detection ended, how many jumps are reported, and why it ended.
std::tuple<int64_t, int64_t, int64_t, int64_t> gather(
    const Window& window, Floats speed, Floats torque, Flags good, int64_t filled, int64_t done, bool last) {
    const auto& by = window.by;
    const auto& numbers = window.learned.numbers;
    const auto& counters = window.peaks.counters;
    const int64_t n = speed.size();
    const int64_t count = normalise(
        speed.data, torque.data, good.data, n, by.speed_unit, by.torque_unit, window.x.data + filled,
        window.z.data + filled, window.good.data + filled);
    count_signs(filled, speed, window.good.slice(filled, filled + n), window.structure.signs, window.structure.counts);
    filled += n;
    int64_t told = 0;
    const int64_t ready = last ? filled : filled - filled % STEP;
    if (std::isnan(numbers[COUNTED])) {
        if (ready < CHUNK && !last) return {count, done, told, ALL_DONE};
        if (std::isnan(numbers[BAND])) return {count, done, told, FIRST_CHUNK};
        // The first chunk is scanned twice: for the histogram alone, and when it is known what to look for.
        scan_window(window, 0, std::min(ready, CHUNK), true);
        if (refresh(0, window)) return {count, done, told, HEAVY_TAILS};
    }
    if (!std::isnan(numbers[OUTLIER])) {
        set_bars(window, numbers[OUTLIER]);
        numbers[OUTLIER] = NAN;
    }
    while (done < ready) {
        if (done % CHUNK == 0 && counters[COUNT_PEAKS] + by.chunk_peaks > window.peaks.slots.shape[0]) {
            return {count, done, told, NO_ROOM};
        }
        int64_t change = CHUNK;  // variances, floors and slope change after 1, 2, 4, 8 … chunks
        while (change <= done) change *= 2;
        done = detect(done, std::min(ready, change), window);
        if (counters[COUNT_CONFIRMED] > 0) told = report_confirmed(window, told);
        if (done == change && done > CHUNK) {
            const bool heavy = refresh(done, window);
            const bool enough = window.running[0] >= static_cast<double>(CHUNK);
            if (enough && is_odd_power(done / CHUNK)) learn_slope(done, window);
            if (heavy) return {count, done, told, HEAVY_TAILS};
        }
    }
    return {count, done, told, ALL_DONE};
}
}  // namespace

void bind_evidence(nanobind::module_& module) {
    CONSTANT(KEPT_STATISTIC);
    CONSTANT(SMALLEST_WEIGHT);
    CONSTANT(ALL_DONE);
    CONSTANT(FIRST_CHUNK);
    CONSTANT(NO_ROOM);
    CONSTANT(VARIANCE);
    CONSTANT(WEIGHT);
    CONSTANT(COUNTED);
    CONSTANT(OUTLIER);
    using nanobind::keep_alive;
    nanobind::class_<Window>(module, "Window")
        .def(nanobind::init<WindowArrays, WindowSettings, PeakArrays>(), keep_alive<1, 2>(), keep_alive<1, 4>());
    KERNEL(gather);
}

}  // namespace rwa
