// What levels and slope leave of short blocks, and how long it lasts (see rwa_monitor/diagnosis/adequacy.py).
#include "order_statistics.hpp"
#include "running_sums.hpp"

namespace rwa {
namespace {
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
    kernel(module, "lasting", &lasting);
}

}  // namespace rwa
