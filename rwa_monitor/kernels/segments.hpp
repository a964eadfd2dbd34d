// Levels between candidates (see rwa_monitor/switching/segments.py).
#pragma once

#include "arrays.hpp"

namespace rwa {

// Of the statistics (6, m + 2, m + 2) of all pairs, those of the segments between consecutive nodes: (6, segments).
Table<double, 2> chain_of(Array<const double, 3> pairs, Vector<const std::int64_t> nodes);

}  // namespace rwa
