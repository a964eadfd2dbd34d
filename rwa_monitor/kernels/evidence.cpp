// A window's new samples: normalisation, detection and running sums; and the window's own estimates so far: noise,
// thresholds of peaks, slope, certain jumps. A batch is one call of `gather`, which every message of the live monitor
// passes through, too.
#include "detection.hpp"

namespace rwa {
namespace {
constexpr double LARGEST_VALUE = 1e4;  // normalised; speed or friction beyond is a corrupted word of telemetry
constexpr double SPEED_NOISES = 5.0;  // dead band in standard deviations of the speed's noise, where it is not given
constexpr double KEPT_STATISTIC = 12.0;     // peaks below are not kept: no threshold at the window's close is as low
constexpr double CERTAIN_STATISTIC = 30.0;  // of peaks that split the window while its slope is first estimated
constexpr double SMALLEST_WEIGHT = 1e-12;   // W_b without prior knowledge of the slope: only avoids 0/0 (errata 3)
constexpr double SMALLEST_SLOPE_SPREAD = 0.05;  // [of the slope] least standard deviation of the slope so far
constexpr double ANY_SLOPE = 3.0;  // times the slope learned or nominal: larger than in any viscous anomaly
constexpr double SMALLEST_SLOPE = 0.1;  // of the dry torque at nominal speed, where viscous friction is almost zero

// The median of the absolute values; 0 if there are none.
double median_size(NewFloats values) {
    for (double& value : values) value = abs(value);
    return values.empty() ? 0.0 : median_in_place(values);
}

NewFloats differences(const NewFloats& values) {
    NewFloats steps;
    for (int64_t i : range(1, values.size())) steps.push_back(values[i] - values[i - 1]);
    return steps;
}

// Truth values as bytes: loops over `bool` are not vectorised.
inline const unsigned char* bytes(const bool* values) { return reinterpret_cast<const unsigned char*>(values); }
inline unsigned char* bytes(bool* values) { return reinterpret_cast<unsigned char*>(values); }

// |ω|/unit, z = sign(ω)·torque/unit and whether the slot is good; both are zero where it is not. Returns the number of
// good slots. The comparisons are false for NaN.
VECTORISED int64_t normalise(
    const double* __restrict speed, const double* __restrict torque, const bool* good, int64_t n, double speed_unit,
    double torque_unit, double* __restrict motion, double* __restrict z, bool* is_good) {
    const double most_speed = LARGEST_VALUE * speed_unit, most_torque = LARGEST_VALUE * torque_unit;
    const unsigned char* __restrict there = bytes(good);
    unsigned char* __restrict fits = bytes(is_good);
    int64_t count = 0;
    for (int64_t k : range(n)) {
        int64_t fit = there[k];
        fit = abs(speed[k]) <= most_speed ? fit : 0;
        fit = abs(torque[k]) <= most_torque ? fit : 0;
        fits[k] = static_cast<unsigned char>(fit);
        count += fit;
    }
    for (int64_t k : range(n)) {
        const double turning = fits[k] != 0 ? speed[k] : 0.0, friction = fits[k] != 0 ? torque[k] : 0.0;
        motion[k] = abs(turning) / speed_unit;
        z[k] = ((turning > 0.0) - (turning < 0.0)) * friction / torque_unit;
    }
    return count;
}

// Mark the slots [first, stop) of `filled` that are good and turn faster than the dead band. Not those in which the
// speed halves or doubles, so that it would pass zero within a slot: a sample may be a mean over both directions.
VECTORISED void mark_used(
    const double* __restrict motion, const bool* good, double band, int64_t first, int64_t stop, int64_t filled,
    bool* used) {
    const unsigned char* __restrict there = bytes(good);
    unsigned char* __restrict out = bytes(used);
    for (int64_t k : range(first, stop)) {
        const double faster = max(motion[max<int64_t>(k - 1, 0)], motion[min(k + 1, filled - 1)]);
        const int64_t turns = motion[k] >= band && 2.0 * motion[k] >= faster ? there[k] : 0;
        out[k] = static_cast<unsigned char>(motion[k] > 0.0 ? turns : 0);
    }
}

// Viscous friction is proportional to the sums' `x`: |ω|/unit, the same array as `motion`, or a separate array.
struct WindowArrays {
    Vector<double> motion;
    Vector<bool> good;
    SumArrays sums;
    Vector<double> running;
    Matrix<double> block_sums, block_pairs;  // see `block_differences`
    StructureArrays structure;
    FIELDS(motion, good, sums, running, block_sums, block_pairs, structure)
};

struct WindowSettings {
    double speed_unit, torque_unit, angle_per_x;
    int64_t block_hop, stretch_hop;
    double dead_band, start_std, prior_mean, prior_std, nominal_slope;
    double outlier, sure_outlier, sure_margin, sure_statistic, jump_share;
    FIELDS(speed_unit, torque_unit, angle_per_x, block_hop, stretch_hop, dead_band, start_std, prior_mean, prior_std,
           nominal_slope, outlier, sure_outlier, sure_margin, sure_statistic, jump_share)
};

// A window: the arrays that Python made, converted once (in every call that would cost as much as 100 samples), and the
// window's own estimates.
struct Window {
    Window(const WindowArrays& arrays, const WindowSettings& settings, Integers scales)
        : a(arrays), by(settings), slope(settings.nominal_slope), detector(scales), variances(scales.size(), NAN),
          floors(scales.size(), INFINITY), sure(scales.size(), INFINITY) {}

    // Estimate from the first chunk, the slots [0, stop): the speed above which its sign is certain, the dead band,
    // which samples are used, and the weight of the slope's prior.
    void learn_first(int64_t stop) {
        const double normal_median = sqrt(CHI_MEDIAN);  // of |N(0, 1)|
        NewFloats speeds, levels;
        for (int64_t k : range(stop)) {
            if (a.good[k]) speeds.push_back(a.motion[k]);
        }
        // The second difference of a smooth speed is noise of √6 times its standard deviation.
        certain = SPEED_NOISES * median_size(differences(differences(speeds))) / (normal_median * sqrt(6.0));
        band = isnan(by.dead_band) ? certain : by.dead_band;
        mark_used(a.motion.data, a.good.data, band, 0, stop, filled, a.sums.used.data);
        weight = SMALLEST_WEIGHT;
        if (isnan(by.prior_std)) return;
        double std = by.start_std;
        if (isnan(std)) {
            for (int64_t k : range(stop)) {
                if (a.sums.used[k]) levels.push_back(a.sums.z[k] - by.prior_mean * a.sums.x[k]);
            }
            std = median_size(differences(levels)) / (normal_median * sqrt(2.0));
        }
        std = max(std, SMALLEST_STD);
        weight = std * std / (by.prior_std * by.prior_std);
    }

    // Set the statistics above which a peak of each scale is sure, and above which it is kept, by the largest outliers
    // by chance. These are uncertain by a factor: peaks from half the largest outlier on are kept.
    void set_outlier(double outlier, double sure_outlier) {
        for (int64_t s : range(variances.size())) {
            floors[s] = sure[s] = INFINITY;
            if (!isfinite(variances[s])) continue;
            const double by_chance = outlier * outlier / (2.0 * detector.scales[s]);
            floors[s] = max(KEPT_STATISTIC * variances[s], 0.25 * by_chance);
            const double lone = sure_outlier / sqrt(2.0 * detector.scales[s]) + by.sure_margin * sqrt(variances[s]);
            sure[s] = max(by.sure_statistic * variances[s], lone * lone);
        }
    }

    // The noise of the slots seen.
    Noise noise() const {
        const int64_t blocks = blocks_before(done);
        return learn_noise(
            {a.block_sums.data, {blocks, LAGS}}, {a.block_pairs.data, {blocks, LAGS}}, detector.histogram, detector.scales,
            by.start_std * by.start_std, by.jump_share);
    }

    // Add new slots to the window, and detect up to the last complete block. `viscous_speed` is empty where viscous
    // friction is proportional to the speed itself. Returns the number of good slots, the number of jumps reported, and
    // whether the detection ended early: the noise is heavy-tailed, and `set_outlier` must replace the Gaussian
    // thresholds (only Python has Student's t).
    tuple<int64_t, int64_t, bool> gather(
        Floats speed, Floats torque, Flags good, Floats viscous_speed, bool last) {
        const int64_t n = speed.size();
        const int64_t count = normalise(
            speed.data, torque.data, good.data, n, by.speed_unit, by.torque_unit, a.motion.data + filled,
            a.sums.z.data + filled, a.good.data + filled);
        for (int64_t k : range(viscous_speed.size())) {
            a.sums.x[filled + k] = a.good[filled + k] ? abs(viscous_speed[k]) / by.speed_unit : 0.0;
        }
#ifndef RWA_ONBOARD  // not used before the window's close
        count_signs(filled, speed, a.good.slice(filled, filled + n), a.structure.signs, a.structure.counts);
#endif
        filled += n;
        reported = {};
        // A slot is judged by its neighbours; the last one of a full window has only one.
        const int64_t known = filled == a.sums.x.size() ? filled : max<int64_t>(filled - 1, 0);
        const bool heavy = detect_until(last ? filled : known - known % BLOCK, last);
        return {count, std::get<0>(reported).size(), heavy};
    }

    // Number of the noise's blocks that end by `slot`.
    int64_t blocks_before(int64_t slot) const {
        return pieces_before(slot, BLOCK + LAGS, by.block_hop);
    }

    // Detect until the noise turns out to be heavy-tailed; returns whether it did.
    bool detect_until(int64_t ready, bool last) {
        if (isnan(std::get<0>(quantiles))) {
            if (ready < CHUNK && !last) return false;
            learn_first(min(ready, CHUNK));
            // The first chunk is scanned twice: for the histogram alone, and with the thresholds from it.
            scan(0, min(ready, CHUNK), true);
            if (refresh()) return true;
        }
        while (done < ready) {
            int64_t change = CHUNK;  // variances, floors and slope change after 1, 2, 4, 8 … chunks
            while (change <= done) change *= 2;
            const int64_t stop = min(ready, change);
            detect(done, stop);
            done = stop;
            report_confirmed();
            if (done == change && done > CHUNK) {
                const bool heavy = refresh();
                const auto doublings = std::countr_zero(static_cast<std::uint64_t>(done / CHUNK));
                if (doublings % 2 == 1 && a.running[0] >= CHUNK) learn_slope();
                if (heavy) return true;
            }
        }
        return false;
    }

    void scan(int64_t start, int64_t stop, bool counting) {
        detector.scan(a.sums.x, a.sums.z, a.sums.used, start, stop, counting, {weight, slope, variances, floors, sure});
    }

    // Detect in the slots [start, stop) and add them to all sums.
    void detect(int64_t start, int64_t stop) {
        if (start >= CHUNK) {
            mark_used(a.motion.data, a.good.data, band, start, stop, filled, a.sums.used.data);
        }
        scan(start, stop, start >= CHUNK);
        extend_sums(a.sums, a.running, start, stop);
#ifndef RWA_ONBOARD
        extend_structure(
            a.motion, a.sums.x, a.sums.z, a.good, a.sums.used, start, stop, certain, by.angle_per_x, by.stretch_hop,
            a.structure);
#endif
        block_differences(
            a.sums.x, a.sums.z, a.sums.used, blocks_before(start), blocks_before(stop), by.block_hop, slope, weight,
            a.block_sums, a.block_pairs);
    }

    // Update the variance of each scale, and the statistics of kept and sure peaks. Returns whether the noise is
    // heavy-tailed.
    bool refresh() {
        tie(std::ignore, std::ignore, variances, quantiles) = noise();
        const double variance = variances[0];
        const double std = isfinite(variance) ? sqrt(variance) : 0.0;
        set_outlier(by.outlier * std, by.sure_outlier * std);
        return isfinite(variance) && are_heavy(quantiles, variance);
    }

    // Centre the slope's prior on the estimate from the window so far, from the next slot on.
    void learn_slope() {
        double variance = 0.0;
        for (double known : variances) variance = max(variance, known);  // NaN is never the larger
        if (variance == 0.0) return;
        vector<Peak> peaks = detector.above(CERTAIN_STATISTIC, variances);
        sort_in_turn(peaks);
        const NewIntegers index = kept_apart(peaks), exclude(index.size(), BLOCK / 4);
        const auto [now, error] = slope_within(done, index, exclude, a.sums, variance, by.prior_mean, by.prior_std);
        if (!isfinite(error)) return;
        const double spread = max({error, SMALLEST_SLOPE_SPREAD * abs(now), SMALLEST_STD});
        slope = now;
        weight = max(variance / (spread * spread), SMALLEST_WEIGHT);
    }

    // Report the peaks confirmed by the last scan that are new and significant for any slope.
    //
    // In a slew, an error of the slope by some per cent mimics jumps: with the nominal slope while viscous friction is
    // anomalous, with that of an earlier part of the window while the anomaly grows. Only a peak that is significant
    // for any slope is certain while the window is open; at its close the window's own slope decides.
    void report_confirmed() {
        const double largest = max({abs(slope), abs(by.nominal_slope), SMALLEST_SLOPE});
        const double most_slope = ANY_SLOPE * largest;
        for (const ScannedPeak& peak : detector.confirmed) {
            const int64_t index = peak.index, w = detector.scales[peak.scale];
            const double variance = variances[peak.scale];
            const auto near = [&](int64_t other) { return abs(other - index) <= w; };
            if (any_of(announced, near)) continue;
            const double least_weight = min(weight, variance / (most_slope * most_slope));
            const auto [statistic, jump] = contrast(index, w, slope, least_weight, a.sums);
            if (!(statistic > sure[peak.scale])) continue;
            announced.push_back(index);
            if (announced.size() > BLOCK) announced.erase(announced.begin());
            auto& [slots, jumps, stds, normalised] = reported;
            slots.push_back(index);
            jumps.push_back(jump);
            normalised.push_back(statistic / variance);
            stds.push_back(abs(jump) / sqrt(normalised.back()));
        }
    }

    WindowArrays a;
    WindowSettings by;
    int64_t filled = 0, done = 0;      // slots that the window holds, and that detection has seen
    double slope, weight = NAN;         // of the slope's prior
    double band = NAN, certain = NAN;  // dead band, and the speed above which its sign is certain
    Detector detector;
    NewFloats variances, floors, sure;          // see `ScanSettings`; NaN and infinite where not known
    Quantiles quantiles{NAN, NAN, NAN};         // of the narrowest scale's statistic
    NewIntegers announced;                   // the last slots reported
    tuple<NewIntegers, NewFloats, NewFloats, NewFloats> reported;  // slot, jump, its std, normalised statistic
};
}  // namespace

#ifndef RWA_ONBOARD
const Stage stage_evidence("evidence", [](nanobind::module_& module) {
    EXPORT(KEPT_STATISTIC, SMALLEST_WEIGHT, SPEED_NOISES);
    nanobind::class_<Window>(module, "Window")
        .def(nanobind::init<WindowArrays, WindowSettings, Integers>(), nanobind::keep_alive<1, 2>())
        .def("gather", &Window::gather, nanobind::call_guard<nanobind::gil_scoped_release>())
        .def("set_outlier", &Window::set_outlier)
        .def("noise", &Window::noise)
        .def("peaks_above", [](const Window& window, double threshold, Floats variances) {
            return columns_of(window.detector.above(threshold, variances));
        })
        .def_rw("filled", &Window::filled)
        .def_ro("done", &Window::done)
        .def_prop_ro("variances", [](const Window& window) { return window.variances; })
        .def_prop_ro("quantiles", [](const Window& window) { return window.quantiles; })
        .def_prop_ro("reported", [](const Window& window) { return window.reported; });
});
#endif

}  // namespace rwa
