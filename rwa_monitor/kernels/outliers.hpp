// How heavy the tails of a window's noise are (see rwa_monitor/changepoints/noise.py).
#pragma once

#include "arrays.hpp"

namespace rwa {

// How many statistics are counted, their median and 99.5 % quantile: the middles of bins of the histogram.
using Quantiles = std::tuple<double, double, double>;

Quantiles quantiles_of(Vector<const std::int64_t> counts);
bool are_heavy(const Quantiles& quantiles, double variance);

}  // namespace rwa
