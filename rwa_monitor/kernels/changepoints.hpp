// From the peaks of all scales to the candidates of a window (see rwa_monitor/changepoints/candidates.py).
#pragma once

#include "running_sums.hpp"

namespace rwa {

// The wGLR's statistic [torque²] and jump at slot k and scale w, with any centre and weight of the slope (see wglr.pyi).
// Both 0 where a half has no used sample.
std::tuple<double, double> contrast(
    std::int64_t k, std::int64_t w, double slope, double weight, const SumArrays& sums);

// The order in which peaks are tried, which come in the order of their slots: narrow scales and large statistics first.
std::vector<std::int64_t> order_in_turn(Vector<const std::int64_t> scale, Vector<const double> statistic);

// The slots of peaks, taken in turn, with no kept one within ±w; sorted.
std::vector<std::int64_t> kept_apart(Vector<const std::int64_t> index, Vector<const std::int64_t> scale);

}  // namespace rwa
