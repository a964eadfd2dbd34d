// Friction of the intervals between changepoints (see rwa_monitor/changepoints/estimation.py).
#pragma once

#include "running_sums.hpp"

namespace rwa {

// Slope that all intervals share, and its standard deviation, from the slots so far.
std::tuple<double, double> slope_within(
    std::int64_t slots, Vector<const std::int64_t> index, Vector<const std::int64_t> exclude, const SumArrays& sums,
    double variance, double prior_mean, double prior_std);

}  // namespace rwa
