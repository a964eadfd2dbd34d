#include "running_sums.hpp"

#include "order_statistics.hpp"

namespace rwa {

// Centre sums that hold nothing yet on the medians of the first used slots of [start, stop), about to be added: one wild
// first sample must not become the origin of all sums.
void find_centre(const SumArrays& arrays, Vector<const double> running, std::int64_t start, std::int64_t stop) {
    if (running[0] > 0.0) return;
    for (std::int64_t begin = start; begin < stop; ++begin) {
        if (!arrays.used[begin]) continue;
        const std::int64_t end = std::min(stop, begin - begin % CENTRE_BLOCK + CENTRE_BLOCK);
        std::vector<double> x, z;
        for (std::int64_t k = begin; k < end; ++k) {
            if (arrays.used[k]) {
                x.push_back(arrays.x[k]);
                z.push_back(arrays.z[k]);
            }
        }
        arrays.centre[0] = median_in_place(x);
        arrays.centre[1] = median_in_place(z);
        return;
    }
}

// Add the slots [start, stop) to the running sums and keep them at every checkpoint passed.
void extend_checkpoints(const SumArrays& arrays, Vector<double> running, std::int64_t start, std::int64_t stop) {
    const double* __restrict x = arrays.x.data;
    const double* __restrict z = arrays.z.data;
    const bool* __restrict used = arrays.used.data;
    const double x_centre = arrays.centre[0], z_centre = arrays.centre[1];
    double sums[6];  // in one array: as six variables GCC makes half of them a vector, at twice the time
    for (int i = 0; i < 6; ++i) sums[i] = running[i];
    for (std::int64_t k = start; k < stop;) {
        const std::int64_t checkpoint = k - k % STRIDE + STRIDE;
        for (; k < std::min(checkpoint, stop); ++k) {
            if (!used[k]) continue;
            const double u = x[k] - x_centre, v = z[k] - z_centre;
            const double terms[6] = {1.0, u, v, u * u, u * v, v * v};
            for (int i = 0; i < 6; ++i) sums[i] += terms[i];
        }
        if (k == checkpoint) {
            double* row = &arrays.checkpoints(k / STRIDE, 0);
            for (int i = 0; i < 6; ++i) row[i] = sums[i];
        }
    }
    for (int i = 0; i < 6; ++i) running[i] = sums[i];
}

// Write the statistics of each range [start, stop), not centred, to `out` (6, m). Returns the samples read, or -1 if a
// slot
// lies outside [0, slots].
std::int64_t range_moments(
    Vector<const std::int64_t> start, Vector<const std::int64_t> stop, std::int64_t slots, const SumArrays& arrays,
    Matrix<double> out) {
    std::int64_t read = 0;
    for (std::int64_t i = 0; i < start.size(); ++i) {
        if (std::min(start[i], stop[i]) < 0 || std::max(start[i], stop[i]) > slots) return -1;
        Sums sums{};
        if (stop[i] > start[i]) {
            sums = moments_between(prefix_moments(start[i], arrays), prefix_moments(stop[i], arrays), arrays.centre);
            read += start[i] % STRIDE + stop[i] % STRIDE;
        }
        out(0, i) = sums.n, out(1, i) = sums.x, out(2, i) = sums.z;
        out(3, i) = sums.xx, out(4, i) = sums.xz, out(5, i) = sums.zz;
    }
    return read;
}

void bind_running_sums(nanobind::module_& module) {
    module.attr("STRIDE") = STRIDE;
    module.attr("CENTRE_BLOCK") = CENTRE_BLOCK;
    kernel(module, "find_centre", &find_centre);
    kernel(module, "extend_checkpoints", &extend_checkpoints);
    kernel(module, "range_moments", &range_moments);
}

}  // namespace rwa
