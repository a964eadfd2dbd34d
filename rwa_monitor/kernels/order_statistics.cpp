#include "order_statistics.hpp"

#include <cstring>

namespace rwa {
namespace {
constexpr std::int64_t BINS = 512;
constexpr std::int64_t FEW = 64;  // values from which counting them pays
constexpr std::int64_t ALL_BUT_SIGN = INT64_MAX;
}  // namespace

double median(Vector<const double> values) {
    const std::int64_t n = values.size(), first = (n - 1) / 2, last = n / 2;  // ranks of those in the middle
    if (n < FEW) {
        std::vector<double> ascending(values.begin(), values.end());
        std::sort(ascending.begin(), ascending.end());
        return 0.5 * (ascending[first] + ascending[last]);
    }
    // As whole numbers, floats have the order of their values; negative ones the opposite. Halved, so that the distance
    // of any two is a number too.
    std::vector<std::int64_t> place(n);
    std::memcpy(place.data(), values.data, n * sizeof(double));
    std::int64_t low = ALL_BUT_SIGN, high = -ALL_BUT_SIGN;
    for (auto& p : place) {
        p = (p ^ ((p >> 63) & ALL_BUT_SIGN)) >> 1;
        low = std::min(low, p);
        high = std::max(high, p);
    }
    int shift = 0;
    while ((high - low) >> shift >= BINS) ++shift;
    std::int64_t counts[BINS] = {};
    for (auto& p : place) ++counts[p = (p - low) >> shift];
    std::int64_t begin = 0, before = 0;  // the bin that holds the first of the two, and how many are below it
    while (before + counts[begin] <= first) before += counts[begin++];
    std::int64_t end = begin, until = before + counts[begin];
    while (until <= last) until += counts[++end];
    std::vector<double> middle;
    middle.reserve(until - before);
    for (std::int64_t i = 0; i < n; ++i) {
        if (begin <= place[i] && place[i] <= end) middle.push_back(values[i]);
    }
    std::sort(middle.begin(), middle.end());
    return 0.5 * (middle[first - before] + middle[last - before]);
}

double sum_up(Vector<const double> values) {
    const std::int64_t n = values.size(), eights = n - n % 8;
    double total = 0.0;
    if (eights > 0) {
        double s[8];
        for (int j = 0; j < 8; ++j) s[j] = values[j];
        for (std::int64_t i = 8; i < eights; i += 8) {
            for (int j = 0; j < 8; ++j) s[j] += values[i + j];
        }
        total = ((s[0] + s[1]) + (s[2] + s[3])) + ((s[4] + s[5]) + (s[6] + s[7]));
    }
    for (std::int64_t i = eights; i < n; ++i) total += values[i];
    return total;
}

void bind_order_statistics(nanobind::module_& module) {
    kernel(module, "median", &median);
    kernel(module, "sum_up", &sum_up);
}

}  // namespace rwa
