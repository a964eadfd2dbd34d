#include "noise.hpp"

#include "order_statistics.hpp"

namespace rwa {
namespace {
// The lowest three quarters of v·χ²₁ have the mean v · P(χ²₃ < q) / 0.75, with q the quantile of χ²₁ at 0.75.
constexpr double KEPT = 0.75, KEPT_MEAN = 0.36852405098355656;
// A statistic beyond 12 v has this probability without a jump; beyond the last share the estimate is not corrected.
constexpr double JUMPED = 12.0, JUMPED_RATE = 0.0005320055051392492, MOST_JUMPED = 0.3;
constexpr double BORROWED = 30.0;    // worth of the next narrower scale's variance, in independent contrasts
constexpr double LEAST_PAIRS = 8.0;  // of 64, at every lag of a block
constexpr std::int64_t LENGTH = BLOCK + LAGS;

// A scale's variance, measured on so many independent contrasts, leaning on the next narrower scale's.
double lean(double measured, double borrowed, double independent) {
    const double share = independent / (independent + BORROWED);
    return std::exp(share * std::log(measured) + (1.0 - share) * std::log(borrowed));
}

// v from the mean of the lowest three quarters of `total` statistics. A first estimate shows how many lie beyond
// JUMPED v; more than the noise's share are jumps, and the three quarters are those of the rest.
double trimmed_variance(Vector<const std::int64_t> counts, std::int64_t total) {
    const auto &edges = STATISTIC_BINS.edges, &widths = STATISTIC_BINS.widths;
    // Counts, and sum of the statistics, of all bins below each one, as far as three quarters of all.
    std::array<double, BINS> before{}, weight_before{};
    double seen = 0.0, weighted = 0.0, jumped = 0.0, variance = 0.0;
    std::int64_t place = -1;
    while (counts[place + 1] == 0) ++place;  // half of all bins, as a rule
    while (seen < KEPT * total) {
        ++place;
        before[place] = seen;
        weight_before[place] = weighted;
        seen += counts[place];
        weighted += counts[place] * (edges[place] + 0.5 * widths[place]);
    }
    for (int round = 0; round < 4; ++round) {
        const double kept = KEPT * (1.0 - jumped) * total;
        while (before[place] >= kept) --place;
        // Within a bin counts are taken as evenly spread.
        const double rest = kept - before[place];
        weighted = weight_before[place] + rest * (edges[place] + 0.5 * rest / counts[place] * widths[place]);
        variance = weighted / kept / KEPT_MEAN;
        seen = before[place];
        std::int64_t end = place;
        for (; end < BINS && edges[end] + widths[end] <= JUMPED * variance; ++end) seen += counts[end];
        if (end < BINS) seen += counts[end] * std::max(JUMPED * variance - edges[end], 0.0) / widths[end];
        const double last = jumped;
        jumped = std::min(std::max(1.0 - seen / total - JUMPED_RATE, 0.0), MOST_JUMPED);
        if (jumped == last) break;  // as nearly always, at once: nothing jumps
    }
    return variance;
}

// The sum of LAGS values, as eight side by side.
double sum_of_lags(const double* row) {
    double part[8];
    for (int i = 0; i < 8; ++i) {
        part[i] = ((row[i] + row[8 + i]) + (row[16 + i] + row[24 + i])) +
                  ((row[32 + i] + row[40 + i]) + (row[48 + i] + row[56 + i]));
    }
    return ((part[0] + part[1]) + (part[2] + part[3])) + ((part[4] + part[5]) + (part[6] + part[7]));
}

// What the block's own level and slope leave of its friction; 0 where not used. Returns the used samples.
VECTORISED double remainders(
    const double* __restrict x, const double* __restrict z, const bool* __restrict used, double slope, double weight,
    double* __restrict good, double* __restrict e) {
    double u[LENGTH], v[LENGTH];
    for (std::int64_t i = 0; i < LENGTH; ++i) {  // without branches: several slots at once
        good[i] = used[i];
        u[i] = (x[i] - x[0]) * good[i];
        v[i] = (z[i] - z[0]) * good[i];
    }
    double n = 0.0, sx = 0.0, sz = 0.0, sxx = 0.0, sxz = 0.0;
    for (std::int64_t i = 0; i < LENGTH; ++i) {
        n += good[i];
        sx += u[i];
        sz += v[i];
        sxx += u[i] * u[i];
        sxz += u[i] * v[i];
    }
    const double share = 1.0 / std::max(n, 1.0);
    const double own = (sxz - sx * sz * share + weight * slope) / (std::max(sxx - sx * sx * share, 0.0) + weight);
    for (std::int64_t i = 0; i < LENGTH; ++i) e[i] = v[i] - own * u[i];
    return n;
}

// Half the squared differences at each lag where every slot is used; four slots in a row for each sum in memory.
VECTORISED void full_differences(const double* __restrict e, double* __restrict sums) {
    double total[LAGS] = {};
    for (std::int64_t i = 0; i < BLOCK; i += 4) {
        const double e0 = e[i], e1 = e[i + 1], e2 = e[i + 2], e3 = e[i + 3];
        const double* __restrict later = e + i + 1;
        for (std::int64_t lag = 0; lag < LAGS; ++lag) {
            const double d0 = later[lag] - e0, d1 = later[lag + 1] - e1;
            const double d2 = later[lag + 2] - e2, d3 = later[lag + 3] - e3;
            total[lag] = (((total[lag] + d0 * d0) + d1 * d1) + d2 * d2) + d3 * d3;
        }
    }
    for (std::int64_t lag = 0; lag < LAGS; ++lag) sums[lag] = 0.5 * total[lag];
}

// The same with gaps, and the pairs of used samples.
VECTORISED void differences_with_gaps(
    const double* __restrict e, const double* __restrict good, double* __restrict sums, double* __restrict pairs) {
    double sum[LAGS] = {}, pair[LAGS] = {};
    for (std::int64_t i = 0; i < BLOCK; ++i) {
        if (!(good[i] > 0.0)) continue;
        const double *__restrict later = e + i + 1, *__restrict counted = good + i + 1;
        for (std::int64_t lag = 0; lag < LAGS; ++lag) {
            const double difference = later[lag] - e[i];
            sum[lag] += counted[lag] * (0.5 * difference * difference);
            pair[lag] += counted[lag];
        }
    }
    std::copy(sum, sum + LAGS, sums);
    std::copy(pair, pair + LAGS, pairs);
}
}  // namespace

// The variance of each scale's contrast, from the lower part of its histogram.
Table<double, 1> scale_variances(
    Matrix<const std::int64_t> histogram, Vector<const std::int64_t> scales, double start_variance) {
    auto variances = Table<double, 1>::zeros(scales.size());
    double borrowed = start_variance;
    for (std::int64_t s = 0; s < scales.size(); ++s) {
        const auto counts = histogram.row(s);
        std::int64_t total = 0;
        for (std::int64_t count : counts) total += count;
        if (total > 0) {
            const double measured = std::max(trimmed_variance(counts, total), SMALLEST_STD * SMALLEST_STD);
            if (std::isnan(borrowed)) borrowed = measured;
            const double rate = static_cast<double>(counted_every(scales[s])) / static_cast<double>(scales[s]);
            borrowed = lean(measured, borrowed, total * rate);
        }
        variances[s] = borrowed;
    }
    return variances;
}

// Sums and pairs of the squared differences of the blocks first … last - 1, at lags 1 … LAGS.
void block_differences(
    Vector<const double> x, Vector<const double> z, Vector<const bool> used, std::int64_t first, std::int64_t last,
    std::int64_t hop, double slope, double weight, Matrix<double> sums, Matrix<double> pairs) {
    double good[LENGTH], e[LENGTH];
    for (std::int64_t b = first; b < last; ++b) {
        const std::int64_t start = b * hop;
        const double n = remainders(&x[start], &z[start], &used[start], slope, weight, good, e);
        if (n == LENGTH) {
            full_differences(e, &sums(b, 0));
            std::fill(&pairs(b, 0), &pairs(b, 0) + LAGS, BLOCK);
        } else {
            differences_with_gaps(e, good, &sums(b, 0), &pairs(b, 0));
        }
    }
}

// γ(0) - γ(l) at the lags 1 … LAGS and the pairs behind it, over the full blocks that do not stand out upwards.
std::tuple<Table<double, 1>, Table<double, 1>> quiet_levels(Matrix<const double> sums, Matrix<const double> pairs) {
    const std::int64_t blocks = sums.extent(0);
    std::vector<double> score(blocks, NAN), full;
    for (std::int64_t b = 0; b < blocks; ++b) {
        const double* row = &pairs(b, 0);
        const double count = sum_of_lags(row);
        if (count == LAGS * BLOCK || *std::min_element(row, row + LAGS) >= LEAST_PAIRS) {
            score[b] = sum_of_lags(&sums(b, 0)) / count;
        }
        if (std::isfinite(score[b])) full.push_back(score[b]);
    }
    auto levels = Table<double, 1>::full(NAN, LAGS), counts = Table<double, 1>::zeros(LAGS);
    if (full.empty()) return {levels, counts};
    const auto middle_of = [&full] { return median({full.data(), {full.size()}}); };
    const double middle = middle_of();
    for (double& value : full) value = std::abs(value - middle);
    const double most = middle + 4.0 * (1.4826 * middle_of());
    double level[LAGS] = {}, count[LAGS] = {};
    for (std::int64_t b = 0; b < blocks; ++b) {
        if (!(score[b] <= most)) continue;
        for (std::int64_t lag = 0; lag < LAGS; ++lag) {
            level[lag] += sums(b, lag);
            count[lag] += pairs(b, lag);
        }
    }
    for (std::int64_t lag = 0; lag < LAGS; ++lag) {
        levels[lag] = level[lag] / count[lag];
        counts[lag] = count[lag];
    }
    return {levels, counts};
}

// The variance of each scale's contrast that the levels imply: v = -w Σ r(l) (γ(0) - γ(l)), r the correlation of its
// weights -1/w and +1/w; 0 where it is longer than the lags reach.
Table<double, 1> contrast_variances(Vector<const double> levels, Vector<const std::int64_t> scales) {
    auto variances = Table<double, 1>::zeros(scales.size());
    for (std::int64_t s = 0; s < scales.size(); ++s) {
        const std::int64_t w = scales[s];
        if (2 * w > LAGS) continue;
        double lacking = 0.0;
        for (std::int64_t lag = 1; lag < 2 * w; ++lag) {
            lacking += (lag < w ? 2 * w - 3 * lag : lag - 2 * w) * levels[lag - 1];  // w² r(l)
        }
        if (std::isfinite(lacking)) variances[s] = std::max(-lacking / w, 0.0);
    }
    return variances;
}

// n·Var(mean of n neighbouring samples) / variance for each count n: 1 + 2 Σ (1 - l/n) ρ(l), and beyond the lags known
// towards the long-run factor.
Table<double, 1> mean_variance_factors(
    Vector<const double> count, Vector<const double> autocovariance, double long_run_factor) {
    std::vector<double> correlation(autocovariance.begin(), autocovariance.end());
    std::int64_t last = 0;  // beyond, the noise remembers nothing
    double missing = long_run_factor - 1.0;
    for (std::size_t lag = 1; lag < correlation.size(); ++lag) {
        correlation[lag] /= autocovariance[0];
        if (correlation[lag] != 0.0) {
            last = lag;
            missing -= 2.0 * correlation[lag];
        }
    }
    auto factors = Table<double, 1>::zeros(count.size());
    for (std::int64_t i = 0; i < count.size(); ++i) {
        const double n = std::max(count[i], 1.0);
        const auto lags = static_cast<std::int64_t>(std::min(n, static_cast<double>(last)));
        double shorter = 1.0;
        for (std::int64_t lag = 1; lag <= lags; ++lag) shorter += 2.0 * (1.0 - lag / n) * correlation[lag];
        // What the autocovariance does not show of the long run comes in once a range is longer than its lags.
        factors[i] = std::max(shorter + missing * n / (n + autocovariance.size()), 1e-3);
    }
    return factors;
}

// Variance, autocovariance (LAGS,) and long-run factor of the noise: see `estimate_noise`.
std::tuple<double, Table<double, 1>, double> combine(
    Vector<const double> levels, Vector<const double> counts, Vector<const std::int64_t> scales,
    Vector<const double> variances, double samples) {
    constexpr std::int64_t TRIED = 3 * LAGS / 4;  // lags at which the noise may remember
    double variance = sum_up(levels.slice(TRIED, LAGS)) / (LAGS - TRIED), terms[LAGS];
    std::int64_t last = 0;  // the last lag whose correlation is certain
    for (int round = 0; round < 2; ++round) {
        const double divisor = std::max(variance, SMALLEST_STD * SMALLEST_STD);
        const auto correlation = [&](std::int64_t lag) { return 1.0 - levels[lag] / divisor; };
        for (std::int64_t lag = 0; lag < last; ++lag) terms[lag] = correlation(lag) * correlation(lag);
        const double spread = 1.0 + 2.0 * sum_up(Vector<const double>{terms, {LAGS}}.slice(0, last));
        for (last = TRIED; last > 0 && !(std::abs(correlation(last - 1)) > 4.0 * std::sqrt(spread / counts[last - 1]));) {
            --last;
        }
        for (std::int64_t lag = last; lag < LAGS; ++lag) terms[lag] = levels[lag] * counts[lag];
        variance = sum_up(Vector<const double>{terms, {LAGS}}.slice(last, LAGS)) / sum_up(counts.slice(last, LAGS));
    }
    variance = std::max(variance, SMALLEST_STD * SMALLEST_STD);
    auto autocovariance = Table<double, 1>::zeros(LAGS);
    autocovariance[0] = variance;
    // Beyond the last certain lag the autocovariance is noise of the estimate: 63 such lags would swamp the long run.
    for (std::int64_t lag = 0; lag < last; ++lag) autocovariance[lag + 1] = variance - levels[lag];
    double factor = 1.0 + 2.0 * sum_up(autocovariance.view().slice(1, LAGS)) / variance;

    // The widest scale with enough independent contrasts bounds the long run from its own side. A short window has only
    // narrow ones, which cannot deny a long memory.
    for (std::int64_t s = scales.size() - 1; s >= 0; --s) {
        const double independent = samples / scales[s];
        if (!std::isfinite(variances[s]) || scales[s] < 8 || independent < (scales[s] > 16 ? 100 : 20)) continue;
        const double error = 3.0 * 1.5 * std::sqrt(2.0 / independent), ratio = variances[s] / variance;
        const double highest = independent >= 100 ? ratio * (1.0 + error) : INFINITY;
        factor = std::min(std::max(factor, ratio * std::max(1.0 - error, 0.5)), highest);
        break;
    }
    return {std::sqrt(variance), autocovariance, std::max(factor, 1e-3)};
}

void bind_noise(nanobind::module_& module) {
    module.attr("LAGS") = LAGS;
    module.attr("BLOCK") = BLOCK;
    module.attr("SMALLEST_STD") = SMALLEST_STD;
    module.attr("KEPT") = KEPT;
    module.attr("KEPT_MEAN") = KEPT_MEAN;
    module.attr("JUMPED") = JUMPED;
    module.attr("JUMPED_RATE") = JUMPED_RATE;
    module.attr("MOST_JUMPED") = MOST_JUMPED;
    kernel(module, "lean", &lean);
    kernel(module, "scale_variances", &scale_variances);
    kernel(module, "block_differences", &block_differences);
    kernel(module, "quiet_levels", &quiet_levels);
    kernel(module, "contrast_variances", &contrast_variances);
    kernel(module, "combine", &combine);
    kernel(module, "mean_variance_factors", &mean_variance_factors);
}

}  // namespace rwa
