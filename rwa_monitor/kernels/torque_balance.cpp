#include "arrays.hpp"

namespace rwa {
namespace {

constexpr double CERTAIN_STDS = 1.0;  // of derived friction's noise: an error with a smaller uncertainty is corrected
constexpr double OVER_NOISE = 4.0;  // standard deviations of the torque's own noise, or of derived friction's
constexpr size_t FEWEST_DIFFERENCES = 5;     // of the torque, for an estimate of its noise
constexpr double NORMAL_QUARTILE = 0.31864;  // lower quartile of |N(0, 1)|
constexpr double MOVES_THE_ROTOR = 0.5;  // share of a step of torque that must be in the speed: half way to all
constexpr double CLEAR_STDS = 3.0;       // by which that share must exceed zero: one slot in a thousand of noise

// The coefficient of a shape in a speed given a polynomial, its standard deviation, that of the residual.
struct Share {
    double share = 0.0, std = INFINITY, left_over = 0.0;
};

// Fill in `result` where the parabola through the available samples determines the slope well enough.
void bridge(Floats speed, Vector<double> result, int64_t half, double period_s, double max_variance_ratio) {
    const double full = (half * (half + 1) * (2 * half + 1)) / 3.0;  // Σ j² of a whole stencil: 1 / variance
    for (int64_t k : range(half, speed.size() - half)) {
        if (!isnan(result[k]) || isnan(speed[k])) continue;
        double n = 0.0, s1 = 0.0, s2 = 0.0, s3 = 0.0, s4 = 0.0, y = 0.0, jy = 0.0, jjy = 0.0;
        for (int64_t i : range(-half, half + 1)) {
            const double value = speed[k + i] - speed[k], j = i;
            if (isnan(value)) continue;
            n += 1.0, s1 += j, s2 += j * j, s3 += j * j * j, s4 += j * j * j * j;
            y += value, jy += j * value, jjy += j * j * value;
        }
        // Second row of the inverse of the normal equations of y = a + b·j + c·j².
        const double determinant = n * (s2 * s4 - s3 * s3) - s1 * (s1 * s4 - s2 * s3) + s2 * (s1 * s3 - s2 * s2);
        const double variance = n * s4 - s2 * s2;
        if (n > 2.0 && variance * full <= max_variance_ratio * determinant) {
            const double slope = ((s2 * s3 - s1 * s4) * y + variance * jy + (s1 * s2 - n * s3) * jjy) / determinant;
            result[k] = slope / period_s;
        }
    }
}

// The noise of a torque from its fourth differences: from their median or, where a ramp may affect more than half of them,
// from their lower quartile.
double noise_of(Floats torque, bool may_be_ramp) {
    NewFloats differences;
    for (int64_t i : range(torque.size() - 4)) {
        const double outer = torque[i + 4] + torque[i], inner = torque[i + 3] + torque[i + 1];
        const double difference = abs(outer - 4.0 * inner + 6.0 * torque[i + 2]);
        if (!isnan(difference)) differences.push_back(difference);
    }
    if (differences.size() < FEWEST_DIFFERENCES) return 0.0;
    // The variance of a fourth difference is 70σ².
    if (!may_be_ramp) return median_in_place(differences) / (0.6745 * sqrt(70.0));
    const auto quartile = differences.begin() + differences.size() / 4;
    std::nth_element(differences.begin(), quartile, differences.end());
    return *quartile / (NORMAL_QUARTILE * sqrt(70.0));
}

// The error of friction for the least-squares parabola through a torque, and its std; zeros where a torque is NaN.
// Of a torque c·j² at slot j the filter's average is c·Σ W_i·(i² + (i + 1)²), and its value at slot 0 is 0.
std::pair<double, double> error_of_parabola(Floats torque, Floats weights) {
    const int64_t half = weights.size();
    const double n = torque.size(), mean_square = (half * (half + 1)) / 3.0;  // of j
    double level = 0.0, slope = 0.0, curvature = 0.0, squares = 0.0, spread = 0.0, average = 0.0;
    for (int64_t i : range(-half, half + 1)) {
        const double j = i, off_mean = j * j - mean_square;
        const double value = torque[half + i] - torque[half];
        level += value, slope += j * value, curvature += off_mean * value;
        squares += value * value, spread += off_mean * off_mean;
    }
    for (int64_t i : range(half)) average += weights[i] * (i * i + (i + 1) * (i + 1));
    if (isnan(curvature) || n < 5.0) return {0.0, 0.0};
    const double left =
        squares - level * level / n - slope * slope / (n * mean_square) - curvature * curvature / spread;
    return {-average * curvature / spread, average * sqrt(max(left, 0.0) / (n - 3.0) / spread)};
}

// The slope of the least-squares line through the available samples of a speed, of which the middle one must be one.
double slope_of(Floats speed) {
    const int64_t middle = speed.size() / 2;
    double n = 0.0, j1 = 0.0, j2 = 0.0, v0 = 0.0, v1 = 0.0;
    for (int64_t i : range(speed.size())) {
        const double value = speed[i] - speed[middle], j = i - middle;
        if (isnan(value)) continue;
        n += 1.0, j1 += j, j2 += j * j;
        v0 += value, v1 += j * value;
    }
    const double determinant = n * j2 - j1 * j1;
    return n < 4.0 || determinant <= 0.0 ? 0.0 : (n * v1 - j1 * v0) / determinant;
}

double dot(const NewFloats& a, const NewFloats& b) {
    return std::inner_product(a.begin(), a.end(), b.begin(), 0.0);
}

// Subtract from `values` their projection on a unit vector.
void project_out(const NewFloats& unit, NewFloats& values) {
    const double amount = dot(unit, values);
    for (int64_t i : range(unit.size())) values[i] -= amount * unit[i];
}

// The coefficient of a shape in a speed, fitted together with a polynomial of this degree.
Share share_beside(int degree, Floats shape, Floats speed) {
    NewFloats place, bent, beside;
    double origin = 0.0;
    for (int64_t i : range(speed.size())) {
        if (isnan(speed[i])) continue;
        if (place.empty()) origin = speed[i];
        place.push_back((i - 0.5 * (shape.size() - 1)) / shape.size());
        bent.push_back(shape[i]);
        beside.push_back(speed[i] - origin);
    }
    const double freedom = place.size() - degree - 2.0;
    if (freedom < 1.0) return {};
    vector<NewFloats> powers;  // orthonormal
    for (int64_t exponent : range(degree + 1)) {
        NewFloats power;
        for (double p : place) power.push_back(pow(p, exponent));
        for (const auto& lower : powers) project_out(lower, power);
        const double length = sqrt(dot(power, power));
        for (auto& value : power) value /= length;
        project_out(power, bent);
        project_out(power, beside);
        powers.push_back(move(power));
    }
    const double energy = dot(bent, bent);
    if (energy <= 0.0) return {};
    const double share = dot(bent, beside) / energy;
    for (int64_t i : range(bent.size())) beside[i] -= share * bent[i];
    const double left_over = sqrt(dot(beside, beside) / freedom);
    return {share, left_over / sqrt(energy), left_over};
}

// Set the error of derived friction where the derivative smooths a bend of the speed: see the Python function.
// `least_Nm` is NaN where the wheel's nominal friction is not known; then the limit is a share of friction itself.
void rounding_error(
    Floats speed, Floats torque, Floats weights, double per_torque, double noise_gain, double least_Nm,
    double least_share, int64_t reach, int64_t noise_slots, bool masks, Vector<double> error) {
    const int64_t half = weights.size(), n = speed.size();
    NewFloats shape(2 * reach + 1);  // the speed that the torque alone would give [rad/s]
    const Vector<double> bend(shape);
    for (int64_t k : range(half, n - half)) {
        const double here = torque[k];
        if (isnan(here) || isnan(speed[k])) continue;
        const double* const t = torque.data + k;
        const Floats near_torque = torque.slice(k - half, k + half + 1);
        double off = 0.0, slope = 0.0;  // the torque less its average, by trapezoids; its mean step from slot to slot
        for (int64_t i : range(half)) {
            const double far = t[i + 1] + t[-i - 1], near = t[i] + t[-i], steps = t[i + 1] - t[i] + t[-i] - t[-i - 1];
            if (isnan(steps)) continue;
            off += weights[i] * (2.0 * here - 0.5 * (far + near));
            slope += weights[i] * steps;
        }
        // The time of a step of torque between its two samples is not known: half a slot to either side.
        double uncertain = 0.0;
        for (int64_t i : range(half)) {
            const double right = t[i + 1] - t[i], left = t[-i] - t[-i - 1];
            if (isnan(right + left)) continue;
            const double most = max(abs(right - slope), abs(left - slope));
            uncertain = max(uncertain, 0.5 * weights[i] * most);
        }
        double enough = least_Nm;
        if (isnan(least_Nm)) {
            enough = least_share * abs(here - off - slope_of(speed.slice(k - half, k + half + 1)) / per_torque);
        }
        if (abs(off) + uncertain <= enough) continue;
        const double noise = noise_of(torque.slice(max<int64_t>(k - noise_slots, 0), k + half + 1), masks);
        const bool sudden = abs(off) > OVER_NOISE * noise;
        if (!sudden) {
            // A bend as long as the window is significant in a parabola through the torque long before it is in a
            // sample.
            tie(off, uncertain) = error_of_parabola(near_torque, weights);
            if (abs(off) <= max(enough, OVER_NOISE * uncertain)) continue;
        }
        const int64_t aside = min({reach, k, n - 1 - k});
        bend[aside] = 0.0;
        for (int64_t i : range(aside)) {
            const double right = 0.5 * (t[i] + t[i + 1]) - here, left = 0.5 * (t[-i] + t[-i - 1]) - here;
            bend[aside + i + 1] = bend[aside + i] + (isnan(right) ? 0.0 : per_torque * right);
            bend[aside - i - 1] = bend[aside - i] - (isnan(left) ? 0.0 : per_torque * left);
        }
        const auto bent = bend.slice(0, 2 * aside + 1);
        const auto around = speed.slice(k - aside, k + aside + 1);
        const Share line = share_beside(1, bent, around);
        if (line.share <= max(MOVES_THE_ROTOR, CLEAR_STDS * line.std)) continue;
        bool known = uncertain <= max(enough, CERTAIN_STDS * noise_gain * line.left_over);
        if (known && abs(off) > OVER_NOISE * max(noise, noise_gain * line.left_over)) {
            // Friction may jump while the torque bends smoothly. The speed follows the bend and not the jump:
            // its residual from a cubic, the speed under a torque that is a parabola, separates the two.
            const Share cubic = share_beside(3, bent, around);
            known = cubic.share > max(MOVES_THE_ROTOR, CLEAR_STDS * cubic.std);
        }
        error[k] = known && !masks ? off : NAN;
    }
    // Within a bend the torque of a slot may be its average by chance.
    for (int64_t k = 0, last = -n; masks && k < n; ++k) {
        if (!isnan(error[k])) continue;
        if (k - last <= 2 * (half + 1)) std::fill(error.data + last + 1, error.data + k, NAN);
        last = k;
    }
}

}  // namespace

STAGE(torque_balance, bridge, rounding_error)

}  // namespace rwa
