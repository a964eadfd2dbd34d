#include "arrays.hpp"
#include "recursions.h"

namespace rwa {
namespace {

// Apply a recursion to each usable value; elsewhere the result is its first state variable.
template <typename Step>
NewFloats recursion(Floats values, Flags usable, Floats state, Step step) {
    NewFloats found(values.size());
    for (int64_t k : range(values.size())) found[k] = usable[k] ? step(values[k]) : state[0];
    return found;
}

// Dahl's bristle dz/dt = ω − |ω| z/z_c by its exact step in angle; `state` is z/z_c and the last ω.
NewFloats dahl_bristle(Floats speed_rad_s, Flags usable, double period_s, double scale_rad, Vector<double> state) {
    return recursion(speed_rad_s, usable, state, [&](double speed) {
        return rwa_dahl_bristle(state.data, speed, period_s, scale_rad);
    });
}

// A first-order lag, exact for values that are linear between slots; `state` is x and the last value.
NewFloats first_order_lag(Floats values, Flags usable, double period_s, double time_constant_s, Vector<double> state) {
    double weights[3];
    rwa_lag_weights(weights, period_s, time_constant_s);
    return recursion(values, usable, state, [&](double value) { return rwa_lag_step(state.data, value, weights); });
}

// Time since |value| was above a threshold; `state` is that time.
NewFloats time_since(Floats values, Flags usable, double period_s, double threshold, Vector<double> state) {
    return recursion(values, usable, state, [&](double value) {
        return rwa_time_since(state.data, value, period_s, threshold);
    });
}

// The log-likelihood of a burst chain up to a constant, by the forward recursion (Rabiner 1989); writes each block's
// probability of a burst given the past.
double forward(
    Floats squares, Flags inside, int64_t contrasts, double quiet, double shaking, double freedom, double on,
    double off, Vector<double> probability) {
    const double half = 0.5 * (freedom + contrasts);
    const double of_quiet = exp(-2.0 * quiet) / freedom, of_shaking = exp(-2.0 * shaking) / freedom;
    double burst = on / (on + off), total = 0.0;
    for (int64_t k : range(squares.size())) {
        if (k > 0) burst = burst * (1.0 - off) + (1.0 - burst) * on;
        if (isfinite(squares[k])) {
            if (inside[k]) {
                const double log_quiet = -contrasts * quiet - half * log1p(squares[k] * of_quiet);
                const double log_shaking = -contrasts * shaking - half * log1p(squares[k] * of_shaking);
                const double largest = max(log_quiet, log_shaking);
                const double weight = burst * exp(log_shaking - largest);
                const double both = weight + (1.0 - burst) * exp(log_quiet - largest);
                total += largest + log(both);
                burst = weight / both;
            } else {
                total -= half * log1p(squares[k] / freedom);
            }
        }
        probability[k] = burst;
    }
    return total;
}

// Turn probabilities of a burst given the past, in place, into those given the whole record (backward recursion).
void smooth(Vector<double> probability, double on, double off) {
    for (int64_t k = probability.size() - 2; k >= 0; --k) {
        double& now = probability[k];
        const double next = probability[k + 1], ahead = now * (1.0 - off) + (1.0 - now) * on;
        const double to_burst = ahead > 0.0 ? next / ahead : 0.0;
        const double to_quiet = ahead < 1.0 ? (1.0 - next) / (1.0 - ahead) : 0.0;
        now *= (1.0 - off) * to_burst + off * to_quiet;
    }
}

}  // namespace

STAGE(effects, dahl_bristle, first_order_lag, forward, smooth, time_since)

}  // namespace rwa
