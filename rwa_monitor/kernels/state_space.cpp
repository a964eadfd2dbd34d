#include "arrays.hpp"

namespace rwa {

// Variances of the parts of the noise.
struct NoiseLaw {
    double white;        // of the measurement noise of each sample
    double coloured;     // stationary variance of the AR(1) noise
    double correlation;  // its φ from slot to slot
    double level;        // of a recording's level about the common one
    FIELDS(white, coloured, correlation, level)
};

// The update by a sample: the variance of its innovation, and the gains of level and AR(1) noise.
struct Gains {
    double variance, level, coloured;
};

// Covariance of the level l and the AR(1) noise a, given the samples so far.
struct Covariance {
    double ll = 0.0, la = 0.0, aa = 0.0;

    void predict(double power, double coloured) {
        la *= power;
        aa = power * power * aa + coloured * (1.0 - power * power);
    }
    // A level with a diffuse prior: the sample determines it, and has no innovation.
    void reset(double s, double white) {
        ll = (aa + white) / (s * s);
        la = -aa / s;
    }
    Gains update(double s, double white) {
        const double gl = s * ll + la, ga = s * la + aa, variance = s * gl + ga + white, inverse = 1.0 / variance;
        const Gains gains{variance, gl * inverse, ga * inverse};
        ll -= gl * gains.level;
        la -= gl * gains.coloured;
        aa -= ga * gains.coloured;
        return gains;
    }
};

// The Kalman filter of
//
//   y_k = s_k l_k + a_k + w_k,   l_k = l_{k-1},   a_k = φ^gap a_{k-1} + N(0, ·)
//
// whose gains are the same for friction and all regressors (de Jong 1991, "The diffuse Kalman filter"; Harvey 1989,
// section 3.4). `gap` counts the slots since the previous sample, 0 where a recording begins and the filter restarts.
// At a jump the level has a diffuse prior. Row k of `gains` (n, 4) becomes 1/√S_k, 0 at a jump, the gains of l and a,
// and φ^gap. Returns Σ log S_k of the same samples without jumps, the log-determinant of their covariance.
double filter_gains(Floats sign, Integers gap, Integers jumps, const NoiseLaw& law, Matrix<double> gains) {
    Covariance jumping, smooth;
    double log_determinant = 0.0, power = law.correlation;
    int64_t next = 0;
    for (int64_t k : range(gap.size())) {
        if (gap[k] == 0) {
            jumping = smooth = {law.level, 0.0, law.coloured};
        } else {
            power = gap[k] == 1 ? law.correlation : pow(law.correlation, gap[k]);
            jumping.predict(power, law.coloured);
            smooth.predict(power, law.coloured);
        }
        log_determinant += log(smooth.update(sign[k], law.white).variance);
        gains(k, 3) = power;
        if (next < jumps.size() && jumps[next] == k) {
            ++next;
            jumping.reset(sign[k], law.white);
            gains(k, 0) = gains(k, 1) = gains(k, 2) = 0.0;
            continue;
        }
        const auto [variance, of_level, of_coloured] = jumping.update(sign[k], law.white);
        gains(k, 0) = 1.0 / sqrt(variance), gains(k, 1) = of_level, gains(k, 2) = of_coloured;
    }
    return log_determinant;
}

// Whiten the rows from row j on, P at a time: the recursions of different rows run in parallel.
template <int64_t P>
void whiten_rows(Matrix<double> columns, Floats sign, Integers gap, FloatMatrix gains, int64_t& j) {
    for (; j + P <= columns.shape[0]; j += P) {
        double l[P] = {}, a[P] = {};
        for (int64_t k : range(columns.shape[1])) {
            const double s = sign[k], scale = gains(k, 0), kl = gains(k, 1), ka = gains(k, 2), power = gains(k, 3);
            for (int64_t i : range(P)) {
                double& y = columns(j + i, k);
                a[i] = gap[k] == 0 ? 0.0 : power * a[i];
                if (gap[k] == 0) l[i] = 0.0;
                if (scale == 0.0) {
                    l[i] = (y - a[i]) / s;
                    y = 0.0;
                    continue;
                }
                const double innovation = y - (s * l[i] + a[i]);
                l[i] += kl * innovation;
                a[i] += ka * innovation;
                y = innovation * scale;
            }
        }
    }
}

// Replace each row of `columns` (p, n), friction or a regressor, by its innovations over their standard deviations.
void whiten(Matrix<double> columns, Floats sign, Integers gap, FloatMatrix gains) {
    int64_t j = 0;
    whiten_rows<4>(columns, sign, gap, gains, j);
    whiten_rows<2>(columns, sign, gap, gains, j);
    whiten_rows<1>(columns, sign, gap, gains, j);
}

STAGE(state_space, filter_gains, whiten)

}  // namespace rwa
