// Running sums; slope and residuals of friction over them (rwa_monitor/changepoints/running_sums.py, estimation.py).
#include "detection.hpp"

namespace rwa {
namespace {
// The statistics, not centred, of the slots [start, stop).
Sums moments(int64_t start, int64_t stop, const SumArrays& arrays) {
    if (stop <= start) return {};
    return moments_between(prefix_moments(start, arrays), prefix_moments(stop, arrays), arrays.centre);
}

// Centre sums that hold nothing yet on the medians of the first used slots of [start, stop), about to be added: one wild
// first sample must not become the origin of all sums. Not inlined: that costs the loop of `extend_sums` half its speed.
[[gnu::noinline]] void find_centre(const SumArrays& arrays, Floats running, int64_t start, int64_t stop) {
    if (running[0] > 0.0) return;
    const bool* const first = find(arrays.used.data + start, arrays.used.data + stop, true);
    const int64_t begin = first - arrays.used.data;
    if (begin >= stop) return;
    NewFloats x, z;
    for (int64_t k : range(begin, min(stop, begin - begin % BLOCK + BLOCK))) {
        if (!arrays.used[k]) continue;
        x.push_back(arrays.x[k]);
        z.push_back(arrays.z[k]);
    }
    arrays.centre[0] = median_in_place(x);
    arrays.centre[1] = median_in_place(z);
}

}  // namespace

void extend_sums(const SumArrays& arrays, Vector<double> running, int64_t start, int64_t stop) {
    find_centre(arrays, running, start, stop);
    const double* __restrict x = arrays.x.data;
    const double* __restrict z = arrays.z.data;
    const bool* __restrict used = arrays.used.data;
    const double x_centre = arrays.centre[0], z_centre = arrays.centre[1];
    double sums[6];  // in one array: as six variables GCC makes half of them a vector, at twice the time
    copy(running, sums);
    for (int64_t k = start; k < stop;) {
        const int64_t checkpoint = k - k % STRIDE + STRIDE;
        for (; k < min(checkpoint, stop); ++k) {
            if (!used[k]) continue;
            const double u = x[k] - x_centre, v = z[k] - z_centre;
            const double terms[6] = {1.0, u, v, u * u, u * v, v * v};
            for (int64_t i : range(6)) sums[i] += terms[i];
        }
        if (k == checkpoint) copy(sums, sums + 6, &arrays.checkpoints(k / STRIDE, 0));
    }
    copy(sums, running.begin());
}

// Write the statistics of each range [start, stop), not centred, to `out` (6, m); returns whether all slots lie in
// [0, slots].
bool range_moments(Integers start, Integers stop, int64_t slots, const SumArrays& arrays, Matrix<double> out) {
    for (int64_t i : range(start.size())) {
        if (min(start[i], stop[i]) < 0 || max(start[i], stop[i]) > slots) return false;
        moments(start[i], stop[i], arrays).write(&out(0, i), start.size());
    }
    return true;
}

// An interval is left without `exclude` slots on each side of each changepoint, at most a quarter of it at each end; one
// whose kept part has no used sample counts with all its slots.
tuple<double, double> slope_within(
    int64_t slots, Integers index, Integers exclude, const SumArrays& arrays, double variance, double prior_mean,
    double prior_std) {
    double sxx = 0.0, sxz = 0.0, xx = 0.0;  // about the intervals' own means, but the last
    for (int64_t i : range(index.size() + 1)) {
        const int64_t first = i > 0 ? index[i - 1] : 0, last = i < index.size() ? index[i] : slots;
        const int64_t most = (last - first) / 4;
        Sums sum = moments(
            first + (i > 0 ? min(exclude[i - 1], most) : 0),
            last - (i < index.size() ? min(exclude[i], most) : 0), arrays);
        if (sum.n == 0.0) sum = moments(first, last, arrays);
        const double share = 1.0 / max(sum.n, 1.0);
        sxx += max(sum.xx - sum.x * sum.x * share, 0.0);
        sxz += sum.xz - sum.x * sum.z * share;
        xx += sum.xx;
    }
    if (!(sxx > 1e-11 * xx)) sxx = sxz = 0.0;  // below this, S_xx is the rounding of Σx²
    if (!isnan(prior_std)) {
        const double weight = variance / (prior_std * prior_std);
        sxx += weight;
        sxz += weight * prior_mean;
    }
    if (sxx == 0.0) return {0.0, INFINITY};
    return {sxz / sxx, sqrt(variance / sxx)};
}

// The sums of products of values that lie `first` places apart and more, in the order of their intervals and within one:
// (intervals, lags).
NewMatrix lagged_products(Floats value, Integers interval, int64_t intervals, int64_t first, int64_t lags) {
    NewMatrix products({intervals, lags});
    for (int64_t begin = 0, end = 0; begin < value.size(); begin = end) {
        while (end < value.size() && interval[end] == interval[begin]) ++end;
        double* __restrict sums = &products(interval[begin], 0);
        for (int64_t b : range(begin, end)) {
            const double* later = value.data + b + first;
            for (int64_t row : range(min(lags, end - b - first))) sums[row] += value[b] * later[row];
        }
    }
    return products;
}

STAGE(running_sums, STRIDE, extend_sums, range_moments, slope_within, lagged_products)

}  // namespace rwa
