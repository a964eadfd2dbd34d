// The windowed generalised likelihood ratio at several scales, and its peaks (see wglr.pyi).
#include "detection.hpp"

#include <cstring>

namespace rwa {
namespace {
constexpr int64_t STRETCH = 512;   // slots that are evaluated in one go at most; a multiple of STEP
constexpr double NOT_EVALUATED = -1.0;  // a half holds too few used samples
constexpr std::uint64_t BIN_SHIFT = 48;  // of 52 mantissa bits, 4 stay
constexpr std::uint64_t FIRST_BIN = (1023 + LOWEST_EXPONENT) * BINS_PER_OCTAVE;

// Extend the prefix sums of a chunk by its slots [start, stop); they begin anew where start is the chunk's first slot.
void fill_prefix(
    Matrix<double> prefix, Floats x, Floats z, Flags used, int64_t chunk, int64_t start, int64_t stop, double slope) {
    int64_t begin = start;
    const int64_t earliest = std::max<int64_t>(0, chunk - HISTORY);
    if (start == chunk) {
        begin = earliest;
        for (int64_t row = 0; row < PREFIXES; ++row) {
            std::fill_n(&prefix(row, 0), HISTORY + begin - chunk + 1, 0.0);
        }
    }
    // The centre is the first used sample that the sums of this chunk may hold.
    double x_centre = 0.0, z_centre = 0.0;
    for (int64_t k = earliest; k < stop; ++k) {
        if (used[k]) {
            x_centre = x[k];
            z_centre = z[k];
            break;
        }
    }
    double* at[PREFIXES];
    double sums[PREFIXES];
    for (int64_t row = 0; row < PREFIXES; ++row) {
        at[row] = &prefix(row, HISTORY + begin - chunk);
        sums[row] = *at[row];
    }
    for (int64_t k = begin; k < stop; ++k) {
        if (used[k]) {
            const double u = x[k] - x_centre, e = (z[k] - z_centre) - slope * u;
            const double terms[PREFIXES] = {1.0, u, e, u * u, u * e};
            for (int64_t row = 0; row < PREFIXES; ++row) sums[row] += terms[row];
        }
        for (int64_t row = 0; row < PREFIXES; ++row) *++at[row] = sums[row];
    }
}

// `evaluate`; where every slot is used the counts need not be read, and the operations are the same.
template <bool AllUsed>
ALWAYS_INLINE void evaluate_slots(
    const double* __restrict n, int64_t width, int64_t w, double weight, int64_t count, double* __restrict statistic,
    double* __restrict jump) {
    const double* __restrict x = n + width;
    const double* __restrict e = x + width;
    const double* __restrict xx = e + width;
    const double* __restrict xe = xx + width;
    const double all = static_cast<double>(w), need = std::max(1.0, 0.5 * all);
    for (int64_t j = 0; j < count; ++j) {
        const double nl = AllUsed ? all : n[j] - n[j - w], nr = AllUsed ? all : n[j + w] - n[j];
        const double left_share = 1.0 / std::max(nl, 1.0), right_share = 1.0 / std::max(nr, 1.0);
        const double xl = x[j] - x[j - w], xr = x[j + w] - x[j];
        const double el = e[j] - e[j - w], er = e[j + w] - e[j];
        const double dx = xr * right_share - xl * left_share;
        const double spread = (xx[j + w] - xx[j - w]) - xl * (xl * left_share) - xr * (xr * right_share);
        const double tilt = (xe[j + w] - xe[j - w]) - xl * (el * left_share) - xr * (er * right_share);
        const double inverse = 1.0 / (std::max(spread, 0.0) + weight);
        const double difference = (er * right_share - el * left_share) - dx * (tilt * inverse);
        jump[j] = difference;
        const double value = difference * difference / (left_share + right_share + dx * dx * inverse);
        statistic[j] = AllUsed || ((nl >= need) & (nr >= need)) ? value : NOT_EVALUATED;
    }
}

// Statistic and jump of one scale at neighbouring slots, `column` the first one's end k + w; NOT_EVALUATED where a half
// has fewer than max(1, w/2) used samples.
VECTORISED void evaluate(
    Matrix<const double> prefix, int64_t column, int64_t w, double weight, int64_t count, double* statistic,
    double* jump) {
    const double* middle = &prefix(0, column - w);
    const bool all_used = middle[w + count - 1] - middle[-w] == static_cast<double>(2 * w + count - 1);
    if (all_used) {
        evaluate_slots<true>(middle, prefix.shape[1], w, weight, count, statistic, jump);
    } else {
        evaluate_slots<false>(middle, prefix.shape[1], w, weight, count, statistic, jump);
    }
}

// Whether any value is above the floor.
VECTORISED bool exceeds(const double* values, int64_t count, double floor) {
    int64_t above = 0;
    for (int64_t j = 0; j < count; ++j) above |= values[j] > floor;
    return above != 0;
}

// Count the statistics of the slots first … first + count - 1 that are multiples of `stride`.
void count_bins(int64_t* histogram, const double* statistic, int64_t first, int64_t count, int64_t stride) {
    for (int64_t j = modulo(-first, stride); j < count; j += stride) {
        std::uint64_t pattern;
        std::memcpy(&pattern, statistic + j, sizeof pattern);
        const std::uint64_t place = (pattern >> BIN_SHIFT) - FIRST_BIN;
        if (place < BINS) {
            ++histogram[place];
        } else if (pattern >> 63 == 0) {  // the sign bit marks what was not evaluated
            ++histogram[(pattern >> BIN_SHIFT) < FIRST_BIN ? 0 : BINS - 1];
        }
    }
}

// Add local maxima above `floor` to the list of peaks. A slot belongs to the last peak of its sign when it lies within
// ±w of it: the larger of the two stays.
void keep_peaks(
    const double* statistic, const double* jump, int64_t first, int64_t count, int64_t scale, int64_t w, double floor,
    const PeakArrays& peaks) {
    for (int64_t j = 0; j < count; ++j) {
        if (statistic[j] <= floor) continue;
        const int64_t k = first + j;
        int64_t& open = peaks.open(scale, jump[j] > 0.0 ? 1 : 0);
        int64_t last = open;
        if (last < 0 || k - peaks.slots(last, PEAK_INDEX) > w) {
            last = open = peaks.counters[COUNT_PEAKS]++;
            peaks.slots(last, PEAK_SCALE) = scale;
            peaks.slots(last, PEAK_CONFIRMED) = 0;
        } else if (statistic[j] <= peaks.values(last, PEAK_STATISTIC)) {
            continue;
        }
        peaks.slots(last, PEAK_INDEX) = k;
        peaks.values(last, PEAK_STATISTIC) = statistic[j];
        peaks.values(last, PEAK_JUMP) = jump[j];
    }
}

// List the sure peaks that no later slot can replace, each once; `stop` ends what was scanned.
void confirm_peaks(int64_t stop, const ScanSettings& settings, const PeakArrays& peaks) {
    int64_t settled = peaks.counters[COUNT_SETTLED];
    const int64_t count = peaks.counters[COUNT_PEAKS];
    for (int64_t p = settled; p < count; ++p) {
        if (peaks.slots(p, PEAK_CONFIRMED) != 0) continue;
        const int64_t scale = peaks.slots(p, PEAK_SCALE), w = settings.scales[scale];
        if (peaks.slots(p, PEAK_INDEX) + w > stop - w) continue;  // the last slot with a statistic
        peaks.slots(p, PEAK_CONFIRMED) = 1;
        if (peaks.values(p, PEAK_STATISTIC) > settings.sure[scale]) {
            peaks.confirmed[peaks.counters[COUNT_CONFIRMED]++] = p;
        }
    }
    while (settled < count && peaks.slots(settled, PEAK_CONFIRMED) == 1) ++settled;
    peaks.counters[COUNT_SETTLED] = settled;
}

// What `scan` has evaluated of one scale.
struct Evaluated {
    int64_t first_right = 0;  // the first slot's end k + w
    bool above = false;            // whether any statistic is above the floor
};

}  // namespace

// Advance the detection over the slots [start, stop), as far as there is room for peaks; returns where it ended.
int64_t scan(
    Floats x, Floats z, Flags used, int64_t start, int64_t stop, bool counting, const ScanSettings& settings,
    const ScanState& state, const PeakArrays& peaks, int64_t chunk_peaks) {
    peaks.counters[COUNT_CONFIRMED] = 0;
    const auto scales = settings.scales;
    const int64_t room = std::min(STRETCH, std::max<int64_t>(stop - start, 0));
    NewFloats values(2 * scales.size() * room);
    std::vector<Evaluated> evaluated(scales.size());
    for (int64_t begin = start; begin < stop;) {
        const int64_t chunk = begin - begin % CHUNK;
        if (begin == chunk && begin > start && peaks.counters[COUNT_PEAKS] + chunk_peaks > peaks.slots.shape[0]) {
            return begin;
        }
        const int64_t end = std::min({begin + STRETCH, chunk + CHUNK, stop});
        fill_prefix(state.prefix, x, z, used, chunk, begin, end, settings.slope);
        for (int64_t s = 0; s < scales.size(); ++s) {
            const int64_t w = scales[s], right = std::max(begin + 1, 2 * w), count = end - right + 1;
            evaluated[s] = {right, false};
            if (count <= 0) continue;
            double* const statistic = &values[2 * s * room];
            evaluate(state.prefix, HISTORY + right - chunk, w, settings.weight, count, statistic, statistic + room);
            evaluated[s].above = exceeds(statistic, count, settings.floors[s]);  // in few stretches
            if (counting) count_bins(&state.histogram(s, 0), statistic, right - w, count, counted_every(w));
        }
        for (int64_t step = begin; step < end; step += STEP) {
            const int64_t step_end = std::min(step + STEP, end);
            for (int64_t s = 0; s < scales.size(); ++s) {
                if (!evaluated[s].above) continue;
                const int64_t w = scales[s], right = std::max(step + 1, evaluated[s].first_right);
                const double* statistic = &values[2 * s * room] + (right - evaluated[s].first_right);
                keep_peaks(
                    statistic, statistic + room, right - w, step_end + 1 - right, s, w, settings.floors[s], peaks);
            }
            confirm_peaks(step_end, settings, peaks);
        }
        begin = end;
    }
    return stop;
}

// Statistic and jump of one scale at every slot of a whole array; NaN where a half leaves the array or lacks samples.
std::tuple<NewFloats, NewFloats> wglr(Floats x, Floats z, Flags used, int64_t scale, double weight, double slope) {
    const int64_t slots = x.size();
    Table<double, 2> prefix({PREFIXES, HISTORY + CHUNK + 1});
    NewFloats statistic(slots, NAN), jump(slots, NAN);
    for (int64_t chunk = 0; chunk < slots; chunk += CHUNK) {
        const int64_t stop = std::min(chunk + CHUNK, slots), right = std::max(chunk + 1, 2 * scale);
        fill_prefix(prefix, x, z, used, chunk, chunk, stop, slope);
        if (right > stop) continue;
        const int64_t first = right - scale, count = stop + 1 - right;
        evaluate(prefix, HISTORY + right - chunk, scale, weight, count, &statistic[first], &jump[first]);
        for (int64_t k = first; k < first + count; ++k) {
            if (statistic[k] == NOT_EVALUATED) statistic[k] = jump[k] = NAN;
        }
    }
    return {std::move(statistic), std::move(jump)};
}

std::vector<Peak> peaks_above(
    Matrix<const int64_t> slots, Matrix<const double> values, int64_t count, Integers scales, Floats variances,
    double threshold) {
    std::vector<Peak> found;
    for (int64_t p = 0; p < count; ++p) {
        const int64_t s = slots(p, PEAK_SCALE);
        const double statistic = values(p, PEAK_STATISTIC) / variances[s];
        if (statistic >= threshold) found.push_back({slots(p, PEAK_INDEX), scales[s], statistic, values(p, PEAK_JUMP)});
    }
    std::stable_sort(found.begin(), found.end(), [](const Peak& a, const Peak& b) {
        return std::tie(a.index, a.scale) < std::tie(b.index, b.scale);
    });
    return found;
}

void bind_wglr(nanobind::module_& module) {
    CONSTANT(CHUNK);
    CONSTANT(STEP);
    CONSTANT(MAX_SCALE);
    CONSTANT(HISTORY);
    CONSTANT(PREFIXES);
    CONSTANT(BINS);
    CONSTANT(BINS_PER_OCTAVE);
    CONSTANT(LOWEST_EXPONENT);
    CONSTANT(PEAK_SCALE);
    CONSTANT(PEAK_CONFIRMED);
    CONSTANT(PEAK_STATISTIC);
    CONSTANT(COUNT_PEAKS);
    CONSTANT(COUNT_SETTLED);
    KERNEL(scan);
    KERNEL(wglr);
    module.def("peaks_above", [](Matrix<const int64_t> slots, Matrix<const double> values, int64_t count, Integers scales,
                                 Floats variances, double threshold) {
        return columns_of(peaks_above(slots, values, count, scales, variances, threshold));
    });
}

}  // namespace rwa
