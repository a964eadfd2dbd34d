#include "arrays.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace rwa {
namespace {

using Result = Table<double, 1>;
constexpr double NONE = std::numeric_limits<double>::quiet_NaN();

double sign(double value) { return value > 0.0 ? 1.0 : value < 0.0 ? -1.0 : value; }

// A first-order lag dx/dt = (u − x)/τ, exact for u linear between slots; `state` is x and the last u.
Result first_order_lag(
    Vector<const double> values, Vector<const bool> usable, double period_s, double time_constant_s,
    Vector<double> state) {
    const double ratio = period_s / time_constant_s, keep = std::exp(-ratio), mean_weight = -std::expm1(-ratio) / ratio;
    auto lagged = Result::zeros(values.size());
    double x = state[0], before = state[1];
    for (std::int64_t k = 0; k < values.size(); ++k) {
        if (usable[k]) {
            const double u = values[k];
            x = std::isnan(x) ? u : keep * x + (mean_weight - keep) * before + (1.0 - mean_weight) * u;
            before = u;
        }
        lagged[k] = x;
    }
    state[0] = x, state[1] = before;
    return lagged;
}

// The bristle's deflection z/z_c after sliding by an angle in one direction.
double slide(double bristle, double angle_rad, double scale_rad) {
    const double side = sign(angle_rad);
    return side + (bristle - side) * std::exp(-std::abs(angle_rad) / scale_rad);
}

// Dahl's bristle dz/dt = ω − |ω| z/z_c by its exact step in angle; `state` is z/z_c and the last ω.
Result dahl_bristle(
    Vector<const double> speed_rad_s, Vector<const bool> usable, double period_s, double scale_rad,
    Vector<double> state) {
    auto bristle = Result::zeros(speed_rad_s.size());
    double z = state[0], before = state[1];
    for (std::int64_t k = 0; k < speed_rad_s.size(); ++k) {
        if (usable[k]) {
            const double after = speed_rad_s[k];
            if (std::isnan(z)) {
                z = sign(after);
            } else if (before * after < 0.0) {  // a slot in which ω changes its sign is two steps
                const double crossing_s = period_s * before / (before - after);
                z = slide(z, 0.5 * before * crossing_s, scale_rad);
                z = slide(z, 0.5 * after * (period_s - crossing_s), scale_rad);
            } else {
                z = slide(z, 0.5 * (before + after) * period_s, scale_rad);
            }
            before = after;
        }
        bristle[k] = z;
    }
    state[0] = z, state[1] = before;
    return bristle;
}

// The speed integrated by the trapezoidal rule, also across gaps; `state` is the angle, the last ω, the slots since.
Result turned_angle(
    Vector<const double> speed_rad_s, Vector<const bool> usable, double period_s, Vector<double> state) {
    auto angle = Result::full(NONE, speed_rad_s.size());
    for (std::int64_t k = 0; k < speed_rad_s.size(); ++k) {
        state[2] += 1.0;
        if (!usable[k]) continue;
        if (!std::isnan(state[1])) state[0] += 0.5 * (state[1] + speed_rad_s[k]) * period_s * state[2];
        state[1] = speed_rad_s[k], state[2] = 0.0;
        angle[k] = state[0];
    }
    return angle;
}

// The rate of change since the last usable slot; `state` is the last value and the slots since.
Result backward_difference(
    Vector<const double> values, Vector<const bool> usable, double period_s, Vector<double> state) {
    auto rate = Result::full(NONE, values.size());
    for (std::int64_t k = 0; k < values.size(); ++k) {
        state[1] += 1.0;
        if (!usable[k]) continue;
        rate[k] = std::isnan(state[0]) ? 0.0 : (values[k] - state[0]) / (state[1] * period_s);
        state[0] = values[k], state[1] = 0.0;
    }
    return rate;
}

// x_k = φ x_{k−1} + √(1 − φ²) e_k, begun in its stationary law.
Result autoregress(Vector<const double> innovation, double coefficient) {
    auto coloured = Result::zeros(innovation.size());
    const double fresh = std::sqrt(1.0 - coefficient * coefficient);
    double last = 0.0;
    for (std::int64_t k = 0; k < innovation.size(); ++k) {
        last = k == 0 ? innovation[k] : coefficient * last + fresh * innovation[k];
        coloured[k] = last;
    }
    return coloured;
}

// The log-likelihood of a burst chain but for its constant, by the forward recursion (Rabiner 1989); writes each slot's
// probability of a burst given the past.
double forward(
    Vector<const double> squares, Vector<const bool> inside, double quiet, double shaking, double freedom, double on,
    double off, Vector<double> probability) {
    const double half = 0.5 * (freedom + 1.0);
    const double of_quiet = std::exp(-2.0 * quiet) / freedom, of_shaking = std::exp(-2.0 * shaking) / freedom;
    double burst = on / (on + off), total = 0.0;
    for (std::int64_t k = 0; k < squares.size(); ++k) {
        if (k > 0) burst = burst * (1.0 - off) + (1.0 - burst) * on;
        if (std::isfinite(squares[k])) {
            if (inside[k]) {
                const double log_quiet = -quiet - half * std::log1p(squares[k] * of_quiet);
                const double log_shaking = -shaking - half * std::log1p(squares[k] * of_shaking);
                const double largest = std::max(log_quiet, log_shaking);
                const double weight = burst * std::exp(log_shaking - largest);
                const double both = weight + (1.0 - burst) * std::exp(log_quiet - largest);
                total += largest + std::log(both);
                burst = weight / both;
            } else {
                total -= half * std::log1p(squares[k] / freedom);
            }
        }
        probability[k] = burst;
    }
    return total;
}

// Turn probabilities of a burst given the past, in place, into those given the whole record (backward recursion).
void smooth(Vector<double> probability, double on, double off) {
    for (std::int64_t k = probability.size() - 2; k >= 0; --k) {
        double& now = probability[k];
        const double next = probability[k + 1], ahead = now * (1.0 - off) + (1.0 - now) * on;
        const double to_burst = ahead > 0.0 ? next / ahead : 0.0;
        const double to_quiet = ahead < 1.0 ? (1.0 - next) / (1.0 - ahead) : 0.0;
        now *= (1.0 - off) * to_burst + off * to_quiet;
    }
}

}  // namespace

void bind_effects(nanobind::module_& module) {
    kernel(module, "first_order_lag", &first_order_lag);
    kernel(module, "dahl_bristle", &dahl_bristle);
    kernel(module, "turned_angle", &turned_angle);
    kernel(module, "backward_difference", &backward_difference);
    kernel(module, "autoregress", &autoregress);
    kernel(module, "forward", &forward);
    kernel(module, "smooth", &smooth);
}

}  // namespace rwa
