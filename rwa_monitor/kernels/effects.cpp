#include "arrays.hpp"

namespace rwa {
namespace {

double sign(double value) { return value > 0.0 ? 1.0 : value < 0.0 ? -1.0 : value; }

// The bristle's deflection z/z_c after sliding by an angle in one direction.
double slide(double bristle, double angle_rad, double scale_rad) {
    const double side = sign(angle_rad);
    return side + (bristle - side) * exp(-abs(angle_rad) / scale_rad);
}

// Dahl's bristle dz/dt = ω − |ω| z/z_c by its exact step in angle; `state` is z/z_c and the last ω.
NewFloats dahl_bristle(Floats speed_rad_s, Flags usable, double period_s, double scale_rad, Vector<double> state) {
    NewFloats bristle(speed_rad_s.size());
    double z = state[0], before = state[1];
    for (int64_t k = 0; k < speed_rad_s.size(); ++k) {
        if (usable[k]) {
            const double after = speed_rad_s[k];
            if (isnan(z)) {
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

// The log-likelihood of a burst chain but for its constant, by the forward recursion (Rabiner 1989); writes each slot's
// probability of a burst given the past.
double forward(
    Floats squares, Flags inside, double quiet, double shaking, double freedom, double on, double off,
    Vector<double> probability) {
    const double half = 0.5 * (freedom + 1.0);
    const double of_quiet = exp(-2.0 * quiet) / freedom, of_shaking = exp(-2.0 * shaking) / freedom;
    double burst = on / (on + off), total = 0.0;
    for (int64_t k = 0; k < squares.size(); ++k) {
        if (k > 0) burst = burst * (1.0 - off) + (1.0 - burst) * on;
        if (isfinite(squares[k])) {
            if (inside[k]) {
                const double log_quiet = -quiet - half * log1p(squares[k] * of_quiet);
                const double log_shaking = -shaking - half * log1p(squares[k] * of_shaking);
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

STAGE(effects, dahl_bristle, forward, smooth)

}  // namespace rwa
