#include "estimation.hpp"

#include <algorithm>
#include <cmath>

namespace rwa {
namespace {
using std::int64_t;

// First slot and end of the m + 1 intervals, without `exclude` slots on each side of each changepoint, but at most a
// quarter of an interval at each end.
std::tuple<Table<int64_t, 1>, Table<int64_t, 1>> interval_bounds(
    int64_t slots, Vector<const int64_t> index, Vector<const int64_t> exclude) {
    const int64_t changes = index.size();
    auto start = Table<int64_t, 1>::zeros(changes + 1), stop = start;
    for (int64_t i = 0; i <= changes; ++i) {
        start[i] = i > 0 ? index[i - 1] : 0;
        stop[i] = i < changes ? index[i] : slots;
        const int64_t most = floor_divide(stop[i] - start[i], 4);
        if (i > 0) start[i] += std::min(exclude[i - 1], most);
        if (i < changes) stop[i] -= std::min(exclude[i], most);
    }
    return {std::move(start), std::move(stop)};
}

// The sufficient statistics (6, m + 1) of the intervals; one whose kept part has no used sample gets all its slots.
Table<double, 2> interval_moments(
    int64_t slots, Vector<const int64_t> index, Vector<const int64_t> exclude, const SumArrays& sums) {
    auto [start, stop] = interval_bounds(slots, index, exclude);
    auto table = Table<double, 2>::zeros(6, index.size() + 1);
    range_moments(start.view(), stop.view(), slots, sums, table.view());
    auto whole = Table<double, 2>::zeros(6, 1);
    for (int64_t i = 0; i <= index.size(); ++i) {
        if (table(0, i) != 0.0) continue;
        const int64_t first = i > 0 ? index[i - 1] : 0, last = i < index.size() ? index[i] : slots;
        range_moments({&first, {1}}, {&last, {1}}, slots, sums, whole.view());
        for (int64_t k = 0; k < 6; ++k) table(k, i) = whole(k, 0);
    }
    return table;
}
}  // namespace

std::tuple<double, double> slope_within(
    int64_t slots, Vector<const int64_t> index, Vector<const int64_t> exclude, const SumArrays& sums, double variance,
    double prior_mean, double prior_std) {
    auto moments = interval_moments(slots, index, exclude, sums);
    double sxx = 0.0, sxz = 0.0, xx = 0.0;  // about the intervals' own means, but the last
    for (int64_t i = 0; i <= index.size(); ++i) {
        const double share = 1.0 / std::max(moments(0, i), 1.0), x = moments(1, i);
        sxx += std::max(moments(3, i) - x * x * share, 0.0);
        sxz += moments(4, i) - x * moments(2, i) * share;
        xx += moments(3, i);
    }
    if (!(sxx > 1e-11 * xx)) sxx = sxz = 0.0;  // below this, S_xx is the rounding of Σx²
    if (!std::isnan(prior_std)) {
        const double weight = variance / (prior_std * prior_std);
        sxx += weight;
        sxz += weight * prior_mean;
    }
    if (sxx == 0.0) return {0.0, std::numeric_limits<double>::infinity()};
    return {sxz / sxx, std::sqrt(variance / sxx)};
}

void bind_estimation(nanobind::module_& module) {
    kernel(module, "interval_bounds", &interval_bounds);
    kernel(module, "interval_moments", &interval_moments);
    kernel(module, "slope_within", &slope_within);
}

}  // namespace rwa
