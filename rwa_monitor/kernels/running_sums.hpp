// Running sums of a window (see rwa_monitor/changepoints/running_sums.py): the sufficient statistics of any range of slots.
#pragma once

#include "arrays.hpp"

namespace rwa {

constexpr std::int64_t STRIDE = 16;        // slots from one checkpoint to the next
constexpr std::int64_t CENTRE_BLOCK = 64;  // slots whose median is the origin of the sums

struct SumArrays {
    Matrix<double> checkpoints;
    Vector<const double> x, z;
    Vector<const bool> used;
    Vector<double> centre;
    auto fields() { return std::tie(checkpoints, x, z, used, centre); }
};

// n, Σx, Σz, Σx², Σxz, Σz²
struct Sums {
    double n, x, z, xx, xz, zz;
};

// The centred sums over the slots [0, k); reads at most 15 samples.
inline Sums prefix_moments(std::int64_t k, const SumArrays& arrays) {
    const double* row = &arrays.checkpoints(k / STRIDE, 0);
    Sums sums{row[0], row[1], row[2], row[3], row[4], row[5]};
    for (std::int64_t i = k - k % STRIDE; i < k; ++i) {
        if (!arrays.used[i]) continue;
        const double u = arrays.x[i] - arrays.centre[0];
        const double v = arrays.z[i] - arrays.centre[1];
        sums.n += 1.0;
        sums.x += u;
        sums.z += v;
        sums.xx += u * u;
        sums.xz += u * v;
        sums.zz += v * v;
    }
    return sums;
}

// The statistics, not centred, of the slots between two of `prefix_moments`.
inline Sums moments_between(const Sums& first, const Sums& last, const Vector<double>& centre) {
    const double cx = centre[0], cz = centre[1];
    const double n = last.n - first.n, sx = last.x - first.x, sz = last.z - first.z;
    return {n,
            sx + n * cx,
            sz + n * cz,
            last.xx - first.xx + 2.0 * cx * sx + n * cx * cx,
            last.xz - first.xz + cx * sz + cz * sx + n * cx * cz,
            last.zz - first.zz + 2.0 * cz * sz + n * cz * cz};
}

void find_centre(const SumArrays& arrays, Vector<const double> running, std::int64_t start, std::int64_t stop);
void extend_checkpoints(const SumArrays& arrays, Vector<double> running, std::int64_t start, std::int64_t stop);
std::int64_t range_moments(
    Vector<const std::int64_t> start, Vector<const std::int64_t> stop, std::int64_t slots, const SumArrays& arrays,
    Matrix<double> out);

}  // namespace rwa
