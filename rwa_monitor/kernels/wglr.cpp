// The windowed generalised likelihood ratio at several scales, and its peaks (see wglr.pyi).
#include "detection.hpp"

namespace rwa {
namespace {
constexpr int64_t STRETCH = CHUNK / 2;  // largest number of slots evaluated at once; a multiple of BLOCK
constexpr size_t MOST_PEAKS = 12'288;  // 0.5 MB; a window with more is pruned to the strongest half
constexpr double NOT_EVALUATED = -1.0;  // a half holds too few used samples

// Extend the prefix sums of a chunk by its slots [start, stop); they restart where start is the chunk's first slot.
void fill_prefix(
    Matrix<double> prefix, Floats x, Floats z, Flags used, int64_t chunk, int64_t start, int64_t stop, double slope) {
    int64_t begin = start;
    const int64_t earliest = max<int64_t>(0, chunk - HISTORY);
    if (start == chunk) {
        begin = earliest;
        for (int64_t row : range(PREFIXES)) {
            fill_n(&prefix(row, 0), HISTORY + begin - chunk + 1, 0.0);
        }
    }
    // The centre is the first used sample from the chunk's HISTORY on.
    double x_centre = 0.0, z_centre = 0.0;
    for (int64_t k : range(earliest, stop)) {
        if (used[k]) {
            x_centre = x[k];
            z_centre = z[k];
            break;
        }
    }
    double sums[PREFIXES];
    for (int64_t row : range(PREFIXES)) sums[row] = prefix(row, HISTORY + begin - chunk);
    for (int64_t k : range(begin, stop)) {
        if (used[k]) {
            const double u = x[k] - x_centre, e = (z[k] - z_centre) - slope * u;
            const double terms[PREFIXES] = {1.0, u, e, u * u, u * e};
            for (int64_t row : range(PREFIXES)) sums[row] += terms[row];
        }
        for (int64_t row : range(PREFIXES)) prefix(row, HISTORY + k + 1 - chunk) = sums[row];
    }
}

// See `evaluate`; where every slot is used the counts are not read, and the operations are the same.
template <bool AllUsed>
ALWAYS_INLINE void evaluate_slots(
    const double* __restrict n, int64_t width, int64_t w, double weight, int64_t count, double* __restrict statistic,
    double* __restrict jump) {
    const double* __restrict x = n + width;
    const double* __restrict e = x + width;
    const double* __restrict xx = e + width;
    const double* __restrict xe = xx + width;
    const double all = w, need = max(1.0, 0.5 * all);
    for (int64_t j : range(count)) {
        const double nl = AllUsed ? all : n[j] - n[j - w], nr = AllUsed ? all : n[j + w] - n[j];
        const double left_share = 1.0 / max(nl, 1.0), right_share = 1.0 / max(nr, 1.0);
        const double xl = x[j] - x[j - w], xr = x[j + w] - x[j];
        const double el = e[j] - e[j - w], er = e[j + w] - e[j];
        const double dx = xr * right_share - xl * left_share;
        const double spread = (xx[j + w] - xx[j - w]) - xl * (xl * left_share) - xr * (xr * right_share);
        const double tilt = (xe[j + w] - xe[j - w]) - xl * (el * left_share) - xr * (er * right_share);
        const double inverse = 1.0 / (max(spread, 0.0) + weight);
        const double difference = (er * right_share - el * left_share) - dx * (tilt * inverse);
        jump[j] = difference;
        const double value = difference * difference / (left_share + right_share + dx * dx * inverse);
        statistic[j] = AllUsed || ((nl >= need) & (nr >= need)) ? value : NOT_EVALUATED;
    }
}

// Statistic and jump of one scale at consecutive slots k, with `column` that of k + w for the first one; NOT_EVALUATED
// where a half has fewer than max(1, w/2) used samples.
VECTORISED void evaluate(
    FloatMatrix prefix, int64_t column, int64_t w, double weight, int64_t count, double* statistic,
    double* jump) {
    const double* middle = &prefix(0, column - w);
    const bool all_used = middle[w + count - 1] - middle[-w] == 2 * w + count - 1;
    if (all_used) {
        evaluate_slots<true>(middle, prefix.shape[1], w, weight, count, statistic, jump);
    } else {
        evaluate_slots<false>(middle, prefix.shape[1], w, weight, count, statistic, jump);
    }
}

// Whether any value is above the floor.
VECTORISED bool exceeds(const double* values, int64_t count, double floor) {
    int64_t above = 0;
    for (int64_t j : range(count)) above |= values[j] > floor;
    return above != 0;
}

// Count the statistics of the slots first … first + count - 1 that are multiples of `stride`.
void count_bins(int64_t* histogram, const double* statistic, int64_t first, int64_t count, int64_t stride) {
    for (int64_t j = (stride - first % stride) % stride; j < count; j += stride) {
        const double value = statistic[j];
        const auto place = (std::bit_cast<std::uint64_t>(value) >> BIN_SHIFT) - FIRST_BIN;
        if (place < BINS) {
            ++histogram[place];
        } else if (!std::signbit(value)) {  // negative: not evaluated
            ++histogram[value < 1.0 ? 0 : BINS - 1];
        }
    }
}

}  // namespace

Detector::Detector(Integers half_widths)
    : scales(half_widths.begin(), half_widths.end()), histogram({half_widths.size(), BINS}),
      prefix({PREFIXES, HISTORY + CHUNK + 1}), open(scales.size(), {-1, -1}) {
    // Peaks of one sign at one scale lie more than w apart, so a chunk cannot have more than this.
    double most = 0.0;
    for (int64_t w : scales) most += 2.0 * CHUNK / (w + 1);
    chunk_peaks = static_cast<size_t>(std::ceil(most)) + 2 * scales.size();
#ifdef RWA_ONBOARD
    peaks.reserve(MOST_PEAKS);
#endif
}

// Add local maxima above `floor` to the list of peaks. Of a slot within ±w of the last peak of its sign, and that peak,
// the larger is kept.
void Detector::keep(
    const double* statistic, const double* jump, int64_t first, int64_t count, int64_t scale, double floor) {
    for (int64_t j : range(count)) {
        if (statistic[j] <= floor) continue;
        ScannedPeak peak{scale, first + j, statistic[j], jump[j], false};
        int64_t& last = open[scale][jump[j] > 0.0];
        if (last < 0 || peak.index - peaks[last].index > scales[scale]) {
            last = peaks.size();
            peaks.push_back(peak);
        } else if (peak.statistic > peaks[last].statistic) {
            peak.final = peaks[last].final;
            peaks[last] = peak;
        }
    }
}

// List the sure peaks that no later slot can replace, each once; `stop` is the end of the scanned slots.
void Detector::confirm(int64_t stop, Floats sure) {
    for (int64_t p : range(settled, peaks.size())) {
        ScannedPeak& peak = peaks[p];
        if (peak.final || peak.index + 2 * scales[peak.scale] > stop) continue;  // a later slot may replace it
        peak.final = true;
        if (peak.statistic > sure[peak.scale]) confirmed.push_back(peak);
    }
    while (settled < peaks.size() && peaks[settled].final) ++settled;
}

// Keep half of the peaks: those that are not final or still open, then the strongest.
void Detector::prune(Floats variances) {
    NewFloats strength;
    for (const ScannedPeak& peak : peaks) {
        strength.push_back(peak.final ? peak.statistic / variances[peak.scale] : INFINITY);
    }
    for (const auto& of_scale : open) {
        for (int64_t last : of_scale) {
            if (last >= 0) strength[last] = INFINITY;
        }
    }
    NewIntegers kept(peaks.size()), place(peaks.size(), -1);
    iota(kept.begin(), kept.end(), 0);
    sort(kept, [&](int64_t a, int64_t b) { return tie(strength[b], a) < tie(strength[a], b); });
    kept.resize(peaks.size() / 2);
    sort(kept);
    for (int64_t i : range(kept.size())) {
        peaks[i] = peaks[kept[i]];
        place[kept[i]] = i;
    }
    peaks.resize(kept.size());
    for (auto& of_scale : open) {
        for (int64_t& last : of_scale) last = last >= 0 ? place[last] : -1;
    }
    settled = 0;
}

void Detector::scan(
    Floats x, Floats z, Flags used, int64_t start, int64_t stop, bool counting, const ScanSettings& settings) {
    confirmed.clear();
    const int64_t count_scales = scales.size(), room = min(STRETCH, max<int64_t>(stop - start, 0));
    NewFloats values(2 * count_scales * room);
    vector<char> above(count_scales);  // whether any of the statistics is above the scale's floor
    for (int64_t begin = start, end; begin < stop; begin = end) {
        const int64_t chunk = begin - begin % CHUNK;
        // Only where a chunk begins: the pruning must not depend on how slots arrive.
        if (begin == chunk && peaks.size() + chunk_peaks > MOST_PEAKS) prune(settings.variances);
        end = min({begin + STRETCH, chunk + CHUNK, stop});
        fill_prefix(prefix, x, z, used, chunk, begin, end, settings.slope);
        for (int64_t s : range(count_scales)) {
            const int64_t w = scales[s], right = max(begin + 1, 2 * w), count = end - right + 1;
            above[s] = false;
            if (count <= 0) continue;
            double* const statistic = &values[2 * s * room];
            evaluate(prefix, HISTORY + right - chunk, w, settings.weight, count, statistic, statistic + room);
            above[s] = exceeds(statistic, count, settings.floors[s]);  // rarely true
            if (counting) count_bins(&histogram(s, 0), statistic, right - w, count, counted_every(w));
        }
        for (int64_t step = begin; step < end; step += BLOCK) {
            const int64_t step_end = min(step + BLOCK, end);
            for (int64_t s : range(count_scales)) {
                if (!above[s]) continue;
                const int64_t w = scales[s], first = max(begin + 1, 2 * w), right = max(step + 1, first);
                const double* statistic = &values[2 * s * room] + (right - first);
                keep(statistic, statistic + room, right - w, step_end + 1 - right, s, settings.floors[s]);
            }
            confirm(step_end, settings.sure);
        }
    }
}

vector<Peak> Detector::above(double threshold, Floats variances) const {
    vector<Peak> found;
    for (const auto& [scale, index, value, jump, final] : peaks) {
        const double statistic = value / variances[scale];
        if (statistic >= threshold) found.push_back({index, scales[scale], statistic, jump});
    }
    sort(found, [](const Peak& a, const Peak& b) {
        return tie(a.index, a.scale) < tie(b.index, b.scale);
    });
    return found;
}

// Statistic and jump of one scale at every slot of a whole array; NaN where a half leaves the array or lacks samples.
tuple<NewFloats, NewFloats> wglr(Floats x, Floats z, Flags used, int64_t scale, double weight, double slope) {
    const int64_t slots = x.size();
    NewMatrix prefix({PREFIXES, HISTORY + CHUNK + 1});
    NewFloats statistic(slots, NAN), jump(slots, NAN);
    for (int64_t chunk = 0; chunk < slots; chunk += CHUNK) {
        const int64_t stop = min(chunk + CHUNK, slots), right = max(chunk + 1, 2 * scale);
        fill_prefix(prefix, x, z, used, chunk, chunk, stop, slope);
        if (right > stop) continue;
        const int64_t first = right - scale, count = stop + 1 - right;
        evaluate(prefix, HISTORY + right - chunk, scale, weight, count, &statistic[first], &jump[first]);
        for (int64_t k : range(first, first + count)) {
            if (statistic[k] == NOT_EVALUATED) statistic[k] = jump[k] = NAN;
        }
    }
    return {move(statistic), move(jump)};
}

#ifndef RWA_ONBOARD
const Stage stage_wglr("wglr", [](nanobind::module_& module) {
    EXPORT(CHUNK, MAX_SCALE, MOST_PEAKS, BINS, BINS_PER_OCTAVE, LOWEST_EXPONENT, wglr);
    nanobind::class_<Detector>(module, "Detector")
        .def(nanobind::init<Integers>())
        .def("scan", &Detector::scan);
});
#endif

}  // namespace rwa
