// Direction, dead band and wheel angle beside the running sums (see rwa_monitor/changepoints/running_sums.py).
#pragma once

#include "arrays.hpp"

namespace rwa {

struct StructureArrays {
    Vector<std::int64_t> signs, counts;
    Matrix<double> near_zero;
    Vector<double> zeros;
    Matrix<double> ripple;
    auto fields() { return std::tie(signs, counts, near_zero, zeros, ripple); }
};

// The pieces of `length` slots, one every `hop` slots from 0 on, `most` of them, that end by `slot`.
inline std::int64_t pieces_before(std::int64_t slot, std::int64_t length, std::int64_t hop, std::int64_t most) {
    if (slot < length) return 0;
    const std::int64_t pieces = (slot - length) / hop + 1;
    return pieces < most ? pieces : most;
}

void count_signs(
    std::int64_t first, Vector<const double> speed, Vector<const bool> good, Vector<std::int64_t> signs,
    Vector<std::int64_t> counts);
void extend_structure(
    Vector<const double> x, Vector<const double> z, Vector<const bool> good, Vector<const bool> used,
    std::int64_t start, std::int64_t stop, double certain, double angle_per_x, std::int64_t hop,
    const StructureArrays& arrays);

}  // namespace rwa
