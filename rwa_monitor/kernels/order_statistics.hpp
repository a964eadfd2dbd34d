// Medians, and sums in an order of their own: the same on every machine.
#pragma once

#include "arrays.hpp"

#include <algorithm>
#include <cmath>

namespace rwa {

// The mean of the two values in the middle, as numpy.median, in linear time; the values are reordered.
inline double median_in_place(std::vector<double>& values) {
    const std::size_t n = values.size(), half = n / 2;
    std::nth_element(values.begin(), values.begin() + half, values.end());
    const double above = values[half];
    if (n % 2 == 1) return above;
    const double below = *std::max_element(values.begin(), values.begin() + half);
    return 0.5 * (below + above);
}

// Of many finite numbers, by counting in bins before few are compared: no comparison of noise can be foretold, and each
// that was guessed wrong costs as much as ten additions.
double median(Vector<const double> values);

// The sum, as eight side by side: none of its additions waits for the one before it.
double sum_up(Vector<const double> values);

}  // namespace rwa
