// The noise of a window, estimated in the presence of jumps (see rwa_monitor/changepoints/noise.py).
#include "detection.hpp"

namespace rwa {
namespace {
// The lowest three quarters of v·χ²₁ have the mean v · P(χ²₃ < q) / 0.75, with q the quantile of χ²₁ at 0.75.
constexpr double KEPT = 0.75, KEPT_MEAN = 0.36852405098355656;
// A statistic beyond 12 v has this probability without a jump; the correction for jumps is at most the last share.
constexpr double JUMPED = 12.0, JUMPED_RATE = 0.0005320055051392492, MOST_JUMPED = 0.3;
constexpr double BORROWED = 30.0;    // weight of the next narrower scale's variance, in independent contrasts
constexpr int64_t LONG_LAGS = 8;     // the longest lags: across a jump near the edge of a block lie few other pairs
constexpr double LEAST_PAIRS = 8.0;  // of 64, at every lag of a block
constexpr int64_t LENGTH = BLOCK + LAGS;
constexpr double FEWEST = 200.0;          // statistics that a test of the tails needs
constexpr double LATTICE = 0.5;           // of the median expected from the variance
constexpr double GAUSSIAN_RATIO = 17.32;  // 99.5 % quantile over the median of squared Gaussian differences
constexpr double LIGHT_TAIL = 1.05;       // a ratio this close to it is Gaussian: its standard error is 1.5 %
constexpr double LEAST_SHARE = 0.8;  // of the variance by mean squares: with heavy tails a robust one is smaller

// The edges of the bins of the statistic's histogram [torque²].
constexpr auto bin_edges = [] {
    array<double, BINS + 1> edges{};
    for (int64_t i : range(BINS + 1)) edges[i] = std::bit_cast<double>((FIRST_BIN + i) << BIN_SHIFT);
    return edges;
}();
double width_of(int64_t bin) { return bin_edges[bin + 1] - bin_edges[bin]; }
double middle_of(int64_t bin) { return 0.5 * (bin_edges[bin] + bin_edges[bin + 1]); }

// A variance from so many independent contrasts, shrunk to the next narrower scale's (`borrowed`).
double lean(double measured, double borrowed, double independent) {
    const double share = independent / (independent + BORROWED);
    return exp(share * log(measured) + (1.0 - share) * log(borrowed));
}

// v from the mean of the lowest three quarters of `total` statistics. A first estimate gives how many lie beyond
// JUMPED v; those in excess of the noise's share are jumps, and the three quarters are taken of the others.
double trimmed_variance(Integers counts, int64_t total) {
    double jumped = 0.0, variance = 0.0;
    int64_t first = 0;
    while (counts[first] == 0) ++first;  // half of all bins, as a rule
    for (int round = 0; round < 4; ++round) {
        const double kept = KEPT * (1.0 - jumped) * total;
        double seen = 0.0, weighted = 0.0;  // in all bins below `end`
        int64_t end = first;
        for (; seen + counts[end] < kept; ++end) {
            seen += counts[end];
            weighted += counts[end] * middle_of(end);
        }
        // Counts are taken as uniform within a bin.
        const double rest = kept - seen;
        weighted += rest * (bin_edges[end] + 0.5 * rest / counts[end] * width_of(end));
        variance = weighted / kept / KEPT_MEAN;
        for (; end < BINS && bin_edges[end + 1] <= JUMPED * variance; ++end) seen += counts[end];
        if (end < BINS) seen += counts[end] * max(JUMPED * variance - bin_edges[end], 0.0) / width_of(end);
        const double last = jumped;
        jumped = min(max(1.0 - seen / total - JUMPED_RATE, 0.0), MOST_JUMPED);
        if (jumped == last) break;  // nearly always in the first round: no jumps
    }
    return variance;
}

// The sum of LAGS values, as eight partial sums.
double sum_of_lags(const double* row) {
    double part[8] = {}, total = 0.0;
    for (int64_t lag = 0; lag < LAGS; lag += 8) {
        for (int64_t i : range(8)) part[i] += row[lag + i];
    }
    for (double sum : part) total += sum;
    return total;
}

// Friction of a block relative to its first sample, less the block's own slope; 0 where not used.
VECTORISED void remainders(
    const double* __restrict x, const double* __restrict z, const bool* __restrict used, double slope, double weight,
    double* __restrict good, double* __restrict e) {
    double u[LENGTH], v[LENGTH];
    for (int64_t i : range(LENGTH)) {  // without branches: vectorised
        good[i] = used[i];
        u[i] = (x[i] - x[0]) * good[i];
        v[i] = (z[i] - z[0]) * good[i];
    }
    double n = 0.0, sx = 0.0, sz = 0.0, sxx = 0.0, sxz = 0.0;
    for (int64_t i : range(LENGTH)) {
        n += good[i];
        sx += u[i];
        sz += v[i];
        sxx += u[i] * u[i];
        sxz += u[i] * v[i];
    }
    const double share = 1.0 / max(n, 1.0);
    const double own = (sxz - sx * sz * share + weight * slope) / (max(sxx - sx * sx * share, 0.0) + weight);
    for (int64_t i : range(LENGTH)) e[i] = v[i] - own * u[i];
}

// Sum of half the squared differences of used samples at each lag, and the number of pairs.
VECTORISED void differences(
    const double* __restrict e, const double* __restrict good, double* __restrict sums, double* __restrict pairs) {
    double sum[LAGS] = {}, pair[LAGS] = {};
    for (int64_t i : range(BLOCK)) {
        if (!(good[i] > 0.0)) continue;
        const double *__restrict later = e + i + 1, *__restrict counted = good + i + 1;
        for (int64_t lag : range(LAGS)) {
            const double difference = later[lag] - e[i];
            sum[lag] += counted[lag] * (0.5 * difference * difference);
            pair[lag] += counted[lag];
        }
    }
    copy(sum, sum + LAGS, sums);
    copy(pair, pair + LAGS, pairs);
}
}  // namespace

// The variance of each scale's contrast, from the lower part of its histogram.
NewFloats scale_variances(IntegerMatrix histogram, Integers scales, double start_variance) {
    NewFloats variances(scales.size());
    double borrowed = start_variance;
    for (int64_t s : range(scales.size())) {
        const auto counts = histogram.row(s);
        int64_t total = 0;
        for (int64_t count : counts) total += count;
        if (total > 0) {
            const double measured = max(trimmed_variance(counts, total), SMALLEST_STD * SMALLEST_STD);
            if (isnan(borrowed)) borrowed = measured;
            const double rate = static_cast<double>(counted_every(scales[s])) / scales[s];
            borrowed = lean(measured, borrowed, total * rate);
        }
        variances[s] = borrowed;
    }
    return variances;
}

// Sums and pairs of the squared differences of the blocks first … last - 1, at lags 1 … LAGS.
void block_differences(
    Floats x, Floats z, Flags used, int64_t first, int64_t last, int64_t hop, double slope, double weight,
    Matrix<double> sums, Matrix<double> pairs) {
    double good[LENGTH], e[LENGTH];
    for (int64_t b : range(first, last)) {
        const int64_t start = b * hop;
        remainders(&x[start], &z[start], &used[start], slope, weight, good, e);
        differences(e, good, &sums(b, 0), &pairs(b, 0));
    }
}

// γ(0) - γ(l) at the lags 1 … LAGS and its number of pairs, over the full blocks without those of high variance. Where
// jumps are so frequent that most blocks hold one, quiet blocks are the lowest, of the share expected without a jump.
tuple<NewFloats, NewFloats> quiet_levels(FloatMatrix sums, FloatMatrix pairs, double jump_share) {
    const int64_t blocks = sums.shape[0];
    NewFloats score(blocks, NAN), full;
    const auto tail = [](const double* row) { return std::accumulate(row + LAGS - LONG_LAGS, row + LAGS, 0.0); };
    for (int64_t b : range(blocks)) {
        const double* row = &pairs(b, 0);
        const double count = sum_of_lags(row);
        if (count == LAGS * BLOCK || *min_element(row, row + LAGS) >= LEAST_PAIRS) {
            score[b] = sum_of_lags(&sums(b, 0)) / count;
            if (jump_share > 0.0) score[b] = tail(&sums(b, 0)) / tail(row);
        }
        if (isfinite(score[b])) full.push_back(score[b]);
    }
    NewFloats levels(LAGS, NAN), counts(LAGS);
    if (full.empty()) return {levels, counts};
    double middle = 0.0, deviation = 0.0;
    if (jump_share > 0.0) {
        sort(full);
        const double quiet = exp(-jump_share * LENGTH) * full.size();
        middle = full[static_cast<int64_t>(0.5 * quiet)];
        deviation = middle - full[static_cast<int64_t>(0.25 * quiet)];
    } else {
        middle = median_in_place(full);
        for (double& value : full) value = abs(value - middle);
        deviation = median_in_place(full);
    }
    const double most = middle + (jump_share > 0.0 ? 3.0 : 4.0) * (1.4826 * deviation);
    fill(levels, 0.0);
    for (int64_t b : range(blocks)) {
        if (!(score[b] <= most)) continue;
        for (int64_t lag : range(LAGS)) {
            levels[lag] += sums(b, lag);
            counts[lag] += pairs(b, lag);
        }
    }
    for (int64_t lag : range(LAGS)) levels[lag] /= counts[lag];
    return {levels, counts};
}

// The variance of each scale's contrast that the levels imply: v = -w Σ r(l) (γ(0) - γ(l)), r the autocorrelation of
// its weights -1/w and +1/w; 0 where the contrast is longer than the lags.
NewFloats contrast_variances(Floats levels, Integers scales) {
    NewFloats variances(scales.size());
    for (int64_t s : range(scales.size())) {
        const int64_t w = scales[s];
        if (2 * w > LAGS) continue;
        double lacking = 0.0;
        for (int64_t lag : range(1, 2 * w)) {
            lacking += (lag < w ? 2 * w - 3 * lag : lag - 2 * w) * levels[lag - 1];  // w² r(l)
        }
        if (isfinite(lacking)) variances[s] = max(-lacking / w, 0.0);
    }
    return variances;
}

// ---- tails of the noise ----

// Of the statistics without a jump: the largest ones, a share `jump_share` of all, are left out of the 99.5 % quantile.
Quantiles quantiles_of(Integers counts, double jump_share) {
    int64_t sum = 0, seen = 0, middle = 0, end = 0;
    for (auto count : counts) sum += count;
    const double total = sum;
    for (int64_t place : range(counts.size())) {
        seen += counts[place];
        middle += seen < 0.5 * total;
        if (seen >= 0.995 * (1.0 - jump_share) * total) {
            end = place;
            break;
        }
    }
    return {total, middle_of(middle), middle_of(end)};
}

// Whether the tails are heavier than a Gaussian's: from quantiles of the statistic at scale 1, and the robust variance
// of a sample.
bool are_heavy(const Quantiles& quantiles, double variance) {
    const auto [total, median, far] = quantiles;
    if (total < FEWEST) return false;
    // Neighbours are mostly equal: with coarse quantisation the quantiles carry no information on the tails.
    if (median < LATTICE * variance * CHI_MEDIAN) return false;
    // The 99.5 % quantile has a relative standard error of about 0.225/√(0.005 n).
    return far > GAUSSIAN_RATIO * (LIGHT_TAIL + 3 * 0.225 / sqrt(0.005 * total)) * median;
}

// ---- all estimates of the noise ----

Noise learn_noise(
    FloatMatrix block_sums, FloatMatrix block_pairs, IntegerMatrix histogram, Integers scales,
    double start_variance, double jump_share) {
    auto [levels, counts] = quiet_levels(block_sums, block_pairs, jump_share);
    auto variances = scale_variances(histogram, scales, start_variance);
    auto implied = contrast_variances(levels, scales);
    for (int64_t s : range(scales.size())) {
        // With coarse quantisation neighbours are mostly equal: quantiles are too small, mean squares are not.
        variances[s] = max(variances[s], LEAST_SHARE * implied[s]);
    }
    return {levels, counts, variances, quantiles_of(histogram.row(0), jump_share)};
}

// ---- how long residuals remember ----

// Sums of the products of values that are one of the `lags`, ascending, apart and in one interval, (intervals, lags).
NewMatrix lagged_products(Floats value, Integers interval, int64_t intervals, Integers lags) {
    NewMatrix sums({intervals, lags.size()});
    for (int64_t i : range(value.size())) {
        for (int64_t l : range(lags.size())) {
            const int64_t before = i - lags[l];
            if (before < 0 || interval[before] != interval[i]) break;
            sums(interval[i], l) += value[i] * value[before];
        }
    }
    return sums;
}

STAGE(noise, LAGS, SMALLEST_STD, KEPT, KEPT_MEAN, JUMPED, JUMPED_RATE, MOST_JUMPED, lean,
      scale_variances, block_differences, quiet_levels, contrast_variances, CHI_MEDIAN, GAUSSIAN_RATIO, quantiles_of,
      are_heavy, lagged_products)

}  // namespace rwa
