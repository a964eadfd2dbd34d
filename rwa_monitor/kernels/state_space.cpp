#include "arrays.hpp"

#include <algorithm>
#include <cmath>

namespace rwa {

// Variances of the parts of the noise.
struct NoiseLaw {
    double white;        // of the measurement noise of each sample
    double coloured;     // stationary variance of the AR(1) part
    double correlation;  // its φ from slot to slot
    double differenced;  // of the noise whose first difference enters (friction derived from speed)
    auto fields() { return std::tie(white, coloured, correlation, differenced); }
};

// Whiten friction and regressors: the innovations of the Kalman filter of
//
//   y_k = s_k l_k + a_k + (v_k - v_{k-1}) + w_k,   l_k = l_{k-1} + N(0, drift_k),   a_k = φ^gap a_{k-1} + N(0, ·)
//
// divided by their standard deviations; the gains are the same for all columns (de Jong 1991, "The diffuse Kalman
// filter"; Harvey 1989, section 3.4). Row 0 of `columns` (p, n) is y, the others regressors; each is replaced by its
// innovations. `gap` counts the slots since the sample before, 0 where a recording begins: there all begins anew, and
// drift_k is the variance of the recording's level about the common one. An infinite drift_k is a jump: a level of which
// nothing is known, so that the sample only sets it; its innovation is zero, and its log S_k is left out (de Jong, too).
// Returns Σ log S_k.
double whiten(
    Matrix<double> columns, Vector<const double> sign, Vector<const double> drift, Vector<const std::int64_t> gap,
    const NoiseLaw& law) {
    const std::int64_t n = columns.extent(1), p = columns.extent(0);
    std::vector<double> state(3 * p, 0.0);  // l, a and v_{k-1} of each column
    double ll = 0.0, la = 0.0, lv = 0.0, aa = 0.0, av = 0.0, vv = 0.0;  // their covariance
    double log_determinant = 0.0, power = law.correlation;
    std::int64_t last_gap = 1;
    for (std::int64_t k = 0; k < n; ++k) {
        if (gap[k] == 0) {
            ll = la = lv = av = 0.0;
            aa = law.coloured;
            vv = law.differenced;
            std::fill(state.begin(), state.end(), 0.0);
        } else {
            if (gap[k] != last_gap) {
                power = gap[k] == 1 ? law.correlation : std::pow(law.correlation, static_cast<double>(gap[k]));
                last_gap = gap[k];
            }
            la *= power;
            av *= power;
            aa = power * power * aa + law.coloured * (1.0 - power * power);
            if (gap[k] > 1) {  // the sample before shares no noise with this one
                lv = av = 0.0;
                vv = law.differenced;
            }
            for (std::int64_t j = 0; j < p; ++j) {
                state[3 * j + 1] *= power;
                if (gap[k] > 1) state[3 * j + 2] = 0.0;
            }
        }
        const double s = sign[k], fresh = law.differenced;
        if (std::isinf(drift[k])) {
            const double ga = aa - av, gv = av - vv;  // with the noise of the sample before its fresh part
            for (std::int64_t j = 0; j < p; ++j) {
                double* column = &state[3 * j];
                column[0] = (columns(j, k) - column[1] + column[2]) / s;
                column[2] = 0.0;
                columns(j, k) = 0.0;
            }
            ll = (ga - gv + fresh + law.white) / (s * s);
            la = -ga / s;
            lv = -fresh / s;
            av = 0.0;
            vv = fresh;
            continue;
        }
        ll += drift[k];
        const double gl = s * ll + la - lv, ga = s * la + aa - av, gv = s * lv + av - vv;
        const double variance = s * gl + ga - gv + fresh + law.white;
        const double scale = 1.0 / std::sqrt(variance), kl = gl / variance, ka = ga / variance, kv = fresh / variance;
        log_determinant += std::log(variance);
        for (std::int64_t j = 0; j < p; ++j) {
            double* column = &state[3 * j];
            const double innovation = columns(j, k) - (s * column[0] + column[1] - column[2]);
            column[0] += kl * innovation;
            column[1] += ka * innovation;
            column[2] = kv * innovation;
            columns(j, k) = innovation * scale;
        }
        ll -= gl * kl;
        la -= gl * ka;
        aa -= ga * ka;
        lv = -kl * fresh;
        av = -ka * fresh;
        vv = fresh - kv * fresh;
    }
    return log_determinant;
}

void bind_state_space(nanobind::module_& module) { kernel(module, "whiten", &whiten); }

}  // namespace rwa
