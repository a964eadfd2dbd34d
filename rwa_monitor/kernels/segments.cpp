// Levels between candidates (see rwa_monitor/switching/segments.py).
#include "assignment.hpp"
#include "detection.hpp"

namespace rwa {
namespace {
constexpr double PREFERENCE = 1e-6;     // log-likelihood of a slot nearer to the detected one: decides ties in gaps

// Σ (z - level - slope x)² of a segment about its own level.
double squared_error(const Sums& sum, double slope) {
    const double y = sum.z - slope * sum.x;
    const double yy = sum.zz - 2.0 * slope * sum.xz + slope * slope * sum.xx;
    return max(yy - y * y / max(sum.n, 1.0), 0.0);
}

// The log-likelihood of one level between all pairs of nodes, integrated over a flat prior of width `width`: it charges
// each level log(width √(n / 2π variance)), so that a jump must gain more than its own parameter costs.
NewMatrix fit_table(FloatCube pairs, double slope, double variance, double width) {
    const int64_t count = pairs.shape[1];
    const double log_range = log(width);
    NewMatrix table({count, count});
    for (int64_t i : range(count)) {
        for (int64_t j : range(i + 1, count)) {
            const Sums sum = Sums::read(&pairs(0, i, j), count * count);
            if (!(sum.n > 0.0)) continue;
            const double charge = log_range - 0.5 * log(2.0 * M_PI * variance / sum.n);
            table(i, j) = -squared_error(sum, slope) / (2.0 * variance) - max(charge, 0.0);
        }
    }
    return table;
}

// Each inner node moved to the slot within its reach, and no further than half way to a neighbour, that splits the two
// intervals beside it best.
NewIntegers refine_nodes(Integers nodes, Integers reach, double slope, double variance, const SumArrays& sums) {
    const int64_t count = nodes.size() - 2;
    NewIntegers refined(count);
    vector<Sums> prefix;
    for (const int64_t slot : nodes) prefix.push_back(prefix_moments(slot, sums));
    for (int64_t i : range(count)) {
        const int64_t left = nodes[i], at = nodes[i + 1], right = nodes[i + 2];
        const int64_t low = max(left + (at - left) / 2, at - reach[i]);  // exclusive unless it is `at`
        const int64_t high = min(at + (right - at) / 2, at + reach[i]);
        double best = -INFINITY;
        refined[i] = at;
        for (int64_t trial = min(low + 1, at); trial <= high; ++trial) {
            const Sums here = prefix_moments(trial, sums);
            double error = squared_error(moments_between(prefix[i], here, sums.centre), slope);
            error += squared_error(moments_between(here, prefix[i + 2], sums.centre), slope);
            const double score = -error / (2.0 * variance) - PREFERENCE * abs(trial - at);
            if (score > best) best = score, refined[i] = trial;
        }
    }
    return refined;
}
}  // namespace

NewMatrix chain_of(FloatCube pairs, Integers nodes) {
    NewMatrix chain({pairs.shape[0], nodes.size() - 1});
    for (int64_t k : range(pairs.shape[0])) {
        for (int64_t i = 0; i + 1 < nodes.size(); ++i) chain(k, i) = pairs(k, nodes[i], nodes[i + 1]);
    }
    return chain;
}

STAGE(segments, PREFERENCE, fit_table, refine_nodes)

}  // namespace rwa
