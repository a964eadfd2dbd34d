// Does the friction model fit the window? (see rwa_monitor/diagnosis/adequacy.py, residual_blocks.py)
#include "order_statistics.hpp"
#include "running_sums.hpp"

namespace rwa {
namespace {
constexpr double MIN_INTERVAL = 30.0;         // samples: the slope of a shorter interval is not known
constexpr std::int64_t SIDE_BLOCKS = 4;
constexpr double FEWEST_NEAR_ZERO = 4.0;      // samples of a crossing
constexpr std::int64_t FEWEST_INTERVALS = 3;  // from which one may be left out
constexpr std::int64_t FEWEST_BLOCKS = 40;    // with fewer, the value is not yet normal
constexpr double LARGEST_BLOCK = 4.0;         // standard deviations that one block counts at most
constexpr double MEDIAN_TO_STD = 1.482602218505602;  // of a Gaussian's absolute value

using Floats = Vector<const double>;
using Integers = Vector<const std::int64_t>;
using Booleans = Vector<const bool>;

// The inner product, as four sums side by side: none of its additions waits for the one before it.
double product(const double* first, const double* second, std::int64_t size) {
    double a = 0.0, b = 0.0, c = 0.0, d = 0.0;
    const std::int64_t fours = size - size % 4;
    for (std::int64_t i = 0; i < fours; i += 4) {
        a += first[i] * second[i];
        b += first[i + 1] * second[i + 1];
        c += first[i + 2] * second[i + 2];
        d += first[i + 3] * second[i + 3];
    }
    for (std::int64_t i = fours; i < size; ++i) a += first[i] * second[i];
    return (a + b) + (c + d);
}

// In how many places both are true.
VECTORISED std::int64_t both(const bool* first, const bool* second, std::int64_t size) {
    std::int64_t count = 0;
    for (std::int64_t i = 0; i < size; ++i) count += first[i] & second[i];
    return count;
}
}  // namespace

// n, x, friction, residual, interval and usable of `Blocks`, from the running sums; `index` are the changepoints.
auto cut(std::int64_t size, std::int64_t blocks, Integers index, double slope, const SumArrays& sums) {
    auto n = Table<double, 1>::zeros(blocks), x = n, friction = n, residual = n;
    auto interval = Table<std::int64_t, 1>::zeros(blocks);
    auto usable = Table<std::uint8_t, 1>::zeros(blocks);
    const std::int64_t changepoints = index.size();
    std::vector<double> weight(changepoints + 1), total(changepoints + 1);
    std::int64_t own = 0;
    Sums begin = prefix_moments(0, sums);
    for (std::int64_t b = 0; b < blocks; ++b) {
        // The first block that begins at or after each changepoint begins its interval.
        while (own < changepoints && index[own] <= b * size) ++own;
        interval[b] = own;
        const Sums end = prefix_moments((b + 1) * size, sums), block = moments_between(begin, end, sums.centre);
        begin = end;
        const double count = std::max(block.n, 1.0), mean = (block.z - slope * block.x) / count;
        const bool counts = block.n >= size / 2 && (own == changepoints || index[own] >= (b + 1) * size);
        n[b] = count;
        x[b] = block.x / count;
        friction[b] = mean;
        usable[b] = counts;
        if (counts) {
            weight[own] += block.n;
            total[own] += block.n * mean;
        }
    }
    // The level is the blocks' own: an estimate leaves out samples beside the jumps, and a difference would look alike
    // in all blocks.
    for (std::int64_t i = 0; i <= changepoints; ++i) total[i] /= std::max(weight[i], 1.0);
    for (std::int64_t b = 0; b < blocks; ++b) residual[b] = friction[b] - total[interval[b]];
    return std::make_tuple(
        std::move(n), std::move(x), std::move(friction), std::move(residual), std::move(interval), std::move(usable));
}

// Each interval's slope less the common one in standard deviations, and its mean speed, from the moments (6, intervals)
// and the variance of the noise of a long mean.
std::tuple<Table<double, 1>, Table<double, 1>> deviations_of_slopes(Matrix<const double> moments, double variance) {
    std::vector<double> deviation, spread, speed;
    double information = 0.0, pull = 0.0;
    for (std::int64_t i = 0; i < moments.extent(1) && variance > 0.0; ++i) {
        const double n = moments(0, i), x = moments(1, i), xx = moments(3, i), own = xx - x * x / std::max(n, 1.0);
        // The slope must be known to a tenth of what speed spans: else rounding is read as a slope.
        if (!(n >= MIN_INTERVAL && own > 1e-9 * std::max(xx, 1e-300))) continue;
        const double cross = moments(4, i) - x * moments(2, i) / n;
        deviation.push_back(cross / own);
        spread.push_back(own);
        speed.push_back(x / n);
        information += own;
        pull += cross;
    }
    if (deviation.size() < 2) return {};
    for (std::size_t i = 0; i < deviation.size(); ++i) {
        deviation[i] = (deviation[i] - pull / information) * std::sqrt(spread[i] / variance);
    }
    return {Table<double, 1>::from(std::move(deviation)), Table<double, 1>::from(std::move(speed))};
}

// Half the difference of friction between the directions at each crossing, in standard deviations, each side's mean
// over the blocks of the same interval and direction.
Table<double, 1> side_differences(
    Floats direction, Floats n, Floats friction, Integers interval, Booleans usable, double variance, double smallest) {
    const auto mean_beside = [&](std::int64_t first, std::int64_t stop, std::int64_t own) {
        double total = 0.0, count = 0.0;
        for (std::int64_t b = first; b < stop; ++b) {
            if (usable[b] && interval[b] == interval[own] && direction[b] == direction[own]) {
                total += n[b] * friction[b];
                count += n[b];
            }
        }
        return std::make_pair(total / count, count);
    };
    std::vector<double> found;
    std::int64_t left = -1;  // the last block before that turns one way only
    for (std::int64_t right = 0; right < n.size(); ++right) {
        if (!usable[right] || std::abs(direction[right]) != 1.0) continue;
        if (left >= 0 && direction[right] * direction[left] < 0.0) {
            const std::int64_t begin = std::max<std::int64_t>(left - SIDE_BLOCKS + 1, 0);
            const auto [before, before_n] = mean_beside(begin, left + 1, left);
            const auto [after, after_n] = mean_beside(right, std::min(right + SIDE_BLOCKS, n.size()), right);
            const double std = 0.5 * std::sqrt(variance * (1.0 / before_n + 1.0 / after_n));
            found.push_back(0.5 * (after - before) * direction[right] / std::max(std, smallest));
        }
        left = right;
    }
    return Table<double, 1>::from(std::move(found));
}

// Mean squared deviation and mean deviation of the dead band's friction at each crossing. Each block is compared with
// the best of the levels beside it. Where a jump lies in or next to the crossing, the worst block holds it and is left
// out.
std::tuple<Table<double, 1>, Table<double, 1>> crossing_deviations(
    Matrix<const double> near_zero, Floats direction, Integers index, Floats level, double viscous,
    std::int64_t block) {
    struct Error {
        double n, square, deviation;
    };
    const std::int64_t blocks = direction.size();
    const auto interval_at = [&](std::int64_t slot) {
        return std::lower_bound(index.begin(), index.end(), slot) - index.begin();
    };
    std::vector<double> squares, deviations;
    std::int64_t stop = 0;
    for (std::int64_t first = 0; first < blocks; ++first) {
        if (first < stop || near_zero(0, first) == 0.0) continue;
        for (stop = first; stop < blocks && near_zero(0, stop) != 0.0;) ++stop;
        if (first == 0 || stop == blocks || !(direction[first - 1] * direction[stop] < 0.0)) continue;
        const std::int64_t low = interval_at((first - 1) * block), high = interval_at((stop + 1) * block);
        Error total{}, worst{};  // the worst is held back so far
        const auto add = [&total](const Error& error) {
            total.n += error.n;
            total.square += error.square;
            total.deviation += error.deviation;
        };
        for (std::int64_t b = first; b < stop; ++b) {
            const double n = near_zero(0, b), x = near_zero(1, b), z = near_zero(2, b), zz = near_zero(3, b);
            Error least{n, INFINITY, 0.0};
            for (std::int64_t i = low; i <= high; ++i) {
                const double expected = level[i] + viscous * x / n;
                const double square = std::max(zz - 2.0 * expected * z + n * (expected * expected), 0.0);
                if (square < least.square) least = {n, square, z - n * expected};
            }
            if (least.square > worst.square || worst.n == 0.0) std::swap(least, worst);
            add(least);
        }
        if (high == low) add(worst);
        if (total.n >= FEWEST_NEAR_ZERO) {
            squares.push_back(total.square / total.n);
            deviations.push_back(total.deviation / total.n);
        }
    }
    return {Table<double, 1>::from(std::move(squares)), Table<double, 1>::from(std::move(deviations))};
}

// Σ over the lags of (Σ products)² / pairs of the blocks' residuals, and the largest mean product per sample. Expected
// is the correlation of the means of two blocks at each lag, the first of which is `first`.
std::tuple<double, double> lasting(
    Floats residual, Floats n, Booleans usable, Integers interval, std::int64_t intervals, Floats expected,
    std::int64_t first) {
    const std::int64_t blocks = residual.size(), lags = expected.size();
    std::vector<double> value(blocks), size;
    for (std::int64_t b = 0; b < blocks; ++b) {
        value[b] = residual[b] * std::sqrt(n[b]);
        if (usable[b]) size.push_back(std::abs(value[b]));
    }
    if (static_cast<std::int64_t>(size.size()) < FEWEST_BLOCKS) return {0.0, 0.0};
    const double scale = MEDIAN_TO_STD * median({size.data(), {size.size()}});
    if (!(scale > 0.0)) return {0.0, 0.0};
    for (std::int64_t b = 0; b < blocks; ++b) {
        value[b] = usable[b] ? std::min(std::max(value[b] / scale, -LARGEST_BLOCK), LARGEST_BLOCK) : 0.0;
    }
    auto products = Table<double, 2>::zeros(intervals, lags), pairs = products;
    std::int64_t end = blocks, told = 0, worst = 0;
    double largest = -1.0;
    for (std::int64_t i = intervals - 1; i >= 0; --i) {  // blocks are in the order of their intervals
        std::int64_t begin = end;
        while (begin > 0 && interval[begin - 1] == i) --begin;
        const bool* own = usable.data + begin;
        const auto there = static_cast<double>(std::max<std::int64_t>(both(own, own, end - begin), 1));
        double squares = 0.0;
        for (std::int64_t row = 0; row < lags; ++row) {
            const std::int64_t lag = first + row, count = std::max<std::int64_t>(end - lag - begin, 0);
            const double both_used = both(own, own + lag, count);
            // Taking out the level of an interval of m blocks correlates any two of them by -1/m.
            const double correlated = both_used * (expected[row] - 1.0 / there);
            products(i, row) = product(value.data() + begin, value.data() + begin + lag, count) - correlated;
            pairs(i, row) = both_used;
            squares += products(i, row) * products(i, row);
        }
        told += pairs(i, 0) != 0.0;
        if (squares >= largest) {
            largest = squares;
            worst = i;
        }
        end = begin;
    }
    double significance = 0.0, most = 0.0;
    for (std::int64_t row = 0; row < lags; ++row) {
        double total = 0.0, count = 0.0;
        for (std::int64_t i = 0; i < intervals; ++i) {
            const bool left_out = told >= FEWEST_INTERVALS && i == worst;
            total += left_out ? 0.0 : products(i, row);
            count += left_out ? 0.0 : pairs(i, row);
        }
        count = std::max(count, 1.0);
        significance += total * total / count;
        most = std::max(most, std::abs(total / count));
    }
    return {significance, scale * scale * most};
}

void bind_adequacy(nanobind::module_& module) {
    module.attr("FEWEST_BLOCKS") = FEWEST_BLOCKS;
    module.attr("LARGEST_BLOCK") = LARGEST_BLOCK;
    kernel(module, "cut", &cut);
    kernel(module, "deviations_of_slopes", &deviations_of_slopes);
    kernel(module, "side_differences", &side_differences);
    kernel(module, "crossing_deviations", &crossing_deviations);
    kernel(module, "lasting", &lasting);
}

}  // namespace rwa
