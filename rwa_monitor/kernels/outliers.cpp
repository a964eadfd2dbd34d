#include "outliers.hpp"

#include "noise.hpp"

#include <cmath>

namespace rwa {
namespace {
constexpr double FEWEST = 200.0;                   // counted statistics below which nothing follows of tails
constexpr double CHI_MEDIAN = 0.4549364231195728;  // median of χ²₁
constexpr double LATTICE = 0.5;                    // of the median that the variance lets expect
constexpr double GAUSSIAN_RATIO = 17.32;  // 99.5 % quantile over the median of squared Gaussian differences
constexpr double LIGHT_TAIL = 1.05;  // a ratio this close to it is Gaussian: its standard error is 1.5 %

double bin_middle(std::int64_t bin) { return STATISTIC_BINS.edges[bin] + 0.5 * STATISTIC_BINS.widths[bin]; }
}  // namespace

Quantiles quantiles_of(Vector<const std::int64_t> counts) {
    std::int64_t sum = 0, seen = 0, middle = 0, end = 0;
    for (auto count : counts) sum += count;
    const double total = static_cast<double>(sum);
    for (std::int64_t place = 0; place < counts.size(); ++place) {
        seen += counts[place];
        middle += static_cast<double>(seen) < 0.5 * total;
        if (static_cast<double>(seen) >= 0.995 * total) {
            end = place;
            break;
        }
    }
    return {total, bin_middle(middle), bin_middle(end)};
}

// Whether the tails are heavier than a Gaussian's: from quantiles of the statistic at scale 1, and the robust variance
// of a sample.
bool are_heavy(const Quantiles& quantiles, double variance) {
    const auto [total, median, far] = quantiles;
    if (total < FEWEST) return false;
    // Neighbours that are mostly equal: coarse quantisation, whose quantiles show nothing of tails.
    if (median < LATTICE * variance * CHI_MEDIAN) return false;
    // The 99.5 % quantile has a relative standard error of about 0.225/√(0.005 n).
    return far > GAUSSIAN_RATIO * (LIGHT_TAIL + 3 * 0.225 / std::sqrt(0.005 * total)) * median;
}

void bind_outliers(nanobind::module_& module) {
    module.attr("CHI_MEDIAN") = CHI_MEDIAN;
    module.attr("GAUSSIAN_RATIO") = GAUSSIAN_RATIO;
    kernel(module, "quantiles_of", &quantiles_of);
    kernel(module, "are_heavy", &are_heavy);
}

}  // namespace rwa
