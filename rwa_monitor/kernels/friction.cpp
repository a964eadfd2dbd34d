// A switching path as a linear model with a Gaussian prior (see rwa_monitor/switching/friction_model.py).
#include "detection.hpp"

namespace rwa {
namespace {
constexpr double LEAST_PIVOT = 1e-60;       // of a coefficient whose prior variance is zero

// A sojourn whose friction is not 0 by law: its system, mean and standard deviation of its friction law.
struct FreeSojourn {
    int64_t system;
    double mean, std;
};

// The linear model of a switching path, with the unknowns base, free sojourns, unattributed jumps, and slope.
struct Model {
    NewMatrix levels;  // (segments, unknowns - 1): coefficient of each unknown in a level; without the slope
    NewIntegers column;       // of each sojourn's friction, -1 where it is 0 by law
    vector<FreeSojourn> free;

    int64_t unknowns() const { return levels.shape[1] + 1; }
};

Model lay_out(const SwitchingPath& path, Integers borders, FloatCube laws) {
    const auto [configurations, starts, sojourns, unattributed] = path;
    Model model;
    model.column.assign(configurations.size(), -1);
    for (int64_t s = 0, at = 0; s < sojourns.size(); ++s) {
        for (const int64_t end = at + sojourns[s]; at < end; ++at) {
            const auto law = laws.row(s).row(configurations[at]);
            if (law[0] == 0.0 && law[1] == 0.0) continue;
            model.free.push_back({s, law[0], law[1]});
            model.column[at] = model.free.size();
        }
    }
    const int64_t segments = borders.size() - 1, jumps_at = 1 + model.free.size();
    model.levels = NewMatrix({segments, jumps_at + unattributed.size()});
    for (int64_t segment : range(segments)) {
        const auto row = model.levels.row(segment);
        const int64_t end = borders[segment + 1];
        row[0] = 1.0;
        for (int64_t s = 0, own = 0, next = 0; s < sojourns.size(); ++s, own = next) {
            next += sojourns[s];
            while (own + 1 < next && starts[own + 1] < end) ++own;  // sojourns at a segment's end count for all of it
            if (model.column[own] >= 0) row[model.column[own]] = 1.0;
        }
        for (int64_t j : range(unattributed.size())) {
            if (end > unattributed[j]) row[jumps_at + j] = 1.0;
        }
    }
    return model;
}

// Replace the lower triangle by the Cholesky factor; return the log-determinant. `block`: the first row of each row's
// diagonal block (outside the blocks the matrix is zero).
VECTORISED double factorise(Matrix<double> matrix, Integers block, Vector<double> log_pivot) {
    const int64_t size = matrix.shape[0];
    NewFloats diagonal(size), finished(size);
    for (int64_t i : range(size)) diagonal[i] = matrix(i, i);
    double* __restrict column = finished.data();
    double log_determinant = 0.0;
    for (int64_t j = 0, end = 0; j < size; ++j) {
        while (end < size && block[end] <= j) ++end;
        // A pivot is at least its rounding error: noise of a billionth of the friction leaves no significant digits.
        const double pivot = max({matrix(j, j), std::numeric_limits<double>::epsilon() * diagonal[j], LEAST_PIVOT});
        log_pivot[j] = log(pivot);
        log_determinant += log_pivot[j];
        const double root = matrix(j, j) = sqrt(pivot);
        for (int64_t i : range(j + 1, end)) {
            double* __restrict row = matrix.row(i).data;
            const double weight = row[j] = column[i] = row[j] / root;
            for (int64_t c : range(j + 1, i + 1)) row[c] -= weight * column[c];
        }
    }
    return log_determinant;
}

// Write the inverse of a symmetric positive definite matrix, of which the lower triangle is read and destroyed; return
// its log-determinant, the sum of `log_pivot`.
VECTORISED double invert(Matrix<double> matrix, Integers block, Matrix<double> inverse, Vector<double> log_pivot) {
    const int64_t size = matrix.shape[0];
    const double log_determinant = factorise(matrix, block, log_pivot);
    NewMatrix lower({size, size});  // the inverse of the factor
    for (int64_t i : range(size)) {
        double* __restrict row = lower.row(i).data;
        for (int64_t c : range(block[i], i)) {
            const double* __restrict above = lower.row(c).data;
            const double weight = matrix(i, c);
            for (int64_t j : range(block[i], c + 1)) row[j] -= weight * above[j];
        }
        const double pivot = matrix(i, i);
        for (int64_t j : range(block[i], i)) row[j] /= pivot;
        row[i] = 1.0 / pivot;
    }
    fill(inverse, 0.0);
    for (int64_t c : range(size)) {
        const double* __restrict row = lower.row(c).data;
        for (int64_t i : range(block[c], c + 1)) {
            double* __restrict out = inverse.row(i).data;
            const double weight = row[i];
            for (int64_t j : range(block[c], i + 1)) out[j] += weight * row[j];
        }
    }
    for (int64_t i : range(size)) {
        for (int64_t j : range(i)) inverse(j, i) = inverse(i, j);
    }
    return log_determinant;
}

// The prior with all parts in their first state, all in their second, and so on. A system's anomaly is common to its
// sojourns; all else is independent a priori. So each part is a diagonal block of the covariance, and a case takes each
// block from the state that it chooses.
struct Prior {
    NewIntegers part, block;              // the part on whose state each unknown depends; see `factorise`
    NewMatrix mean, log_variance;  // (states, unknowns); the logarithm of each pivot of the covariance
    NewCube precision;           // (states, unknowns, unknowns)
};

// Mean, and the lower triangle within the blocks of the covariance, with each part in one state: for a factor 1 + a on
// a system's laws (m, s), with a ~ N(mean, spread²), the covariance is spread² m mᵀ + (1 + mean)² diag(s²).
void write_prior(
    FloatMatrix state, const Model& model, Floats rest, Integers block, Vector<double> mean,
    Matrix<double> covariance) {
    const int64_t unknowns = mean.size(), jumps_at = 1 + model.free.size();
    mean[0] = state(0, 0), covariance(0, 0) = state(0, 1) * state(0, 1);
    for (int64_t i : range(1, jumps_at)) {
        const auto [system, middle, std] = model.free[i - 1];
        const double factor = 1.0 + state(1 + system, 0), spread = state(1 + system, 1), deviation = factor * std;
        mean[i] = factor * middle;
        for (int64_t j : range(block[i], i)) covariance(i, j) = (spread * middle) * (spread * model.free[j - 1].mean);
        covariance(i, i) = deviation * deviation + (spread * middle) * (spread * middle);
    }
    for (int64_t i : range(jumps_at, unknowns - 1)) mean[i] = 0.0, covariance(i, i) = rest[0] * rest[0];
    mean[unknowns - 1] = rest[1], covariance(unknowns - 1, unknowns - 1) = rest[2] * rest[2];
}

Prior prior_of_states(const Cases& cases, const Model& model) {
    const int64_t states = cases.states.shape[0], unknowns = model.unknowns(), sojourns = model.free.size();
    Prior prior{NewIntegers(unknowns), NewIntegers(unknowns), NewMatrix({states, unknowns}),
                NewMatrix({states, unknowns}), NewCube({states, unknowns, unknowns})};
    for (int64_t i : range(unknowns)) {
        const bool free = i > 0 && i <= sojourns;
        prior.part[i] = free ? 1 + model.free[i - 1].system : 0;
        prior.block[i] = free && prior.part[i] == prior.part[i - 1] ? prior.block[i - 1] : i;
    }
    NewMatrix covariance({unknowns, unknowns});
    for (int64_t state : range(states)) {
        write_prior(cases.states.row(state), model, cases.rest, prior.block, prior.mean.row(state), covariance);
        invert(covariance, prior.block, prior.precision.row(state), prior.log_variance.row(state));
    }
    return prior;
}

// One case after the other, conditioned on the segments: its precision, and the precision times the change of its mean.
struct Conditioned {
    Model model;
    Prior prior;
    NewFloats mean, response, log_variance;
    NewMatrix precision;  // the lower triangle
    NewIntegers block;
    double squares = 0.0, log_determinant = 0.0;  // squared residuals of the prior's mean; of prior and segments

    Conditioned(const SwitchingPath& path, Integers borders, const Cases& cases)
        : model(lay_out(path, borders, cases.laws)), prior(prior_of_states(cases, model)), mean(model.unknowns()),
          response(mean.size()), log_variance(mean.size()), precision({model.unknowns(), model.unknowns()}),
          block(mean.size()) {}

    // Take mean, precision and covariance's log-determinant of one case, and add the segments to it.
    void condition(Integers choice, FloatMatrix statistics, double variance, double scatter) {
        const int64_t unknowns = mean.size(), slope_at = unknowns - 1;
        log_determinant = 0.0;
        for (int64_t i : range(unknowns)) {
            const int64_t state = choice[prior.part[i]], begin = prior.block[i];
            const double* source = prior.precision.row(state).row(i).data;
            double* row = precision.row(i).data;
            mean[i] = prior.mean(state, i);
            fill(row, row + begin, 0.0);
            copy(source + begin, source + i + 1, row + begin);
            log_determinant += prior.log_variance(state, i);
        }
        fill(response, 0.0);
        NewFloats row(unknowns);  // the non-zero entries of a segment's row
        NewIntegers column(unknowns);
        const double slope = mean[slope_at];
        squares = 0.0;
        for (int64_t i : range(statistics.shape[1])) {
            const double n = statistics(0, i);
            if (n == 0.0) continue;
            const double x_mean = statistics(1, i) / n, z_mean = statistics(2, i) / n;
            // Deviations from the segment's own mean depend on the slope alone.
            const double sxx = statistics(3, i) - n * x_mean * x_mean;
            const double sxz = statistics(4, i) - n * x_mean * z_mean;
            const double szz = statistics(5, i) - n * z_mean * z_mean;
            precision(slope_at, slope_at) += sxx / variance;
            response[slope_at] += (sxz - slope * sxx) / variance;
            squares += (szz - 2.0 * slope * sxz + slope * slope * sxx) / variance;
            // The mean is one observation of level + slope x_mean.
            const double mean_variance = variance / n + scatter;
            int64_t held = 0;
            for (int64_t a : range(unknowns)) {
                const double value = a < slope_at ? model.levels(i, a) : x_mean;
                if (value != 0.0) row[held] = value, column[held++] = a;
            }
            double rest = z_mean;
            for (int64_t k : range(held)) rest -= row[k] * mean[column[k]];
            squares += rest * rest / mean_variance;
            log_determinant += log(mean_variance * n / variance);  // relative to independent samples
            for (int64_t k : range(held)) {
                response[column[k]] += row[k] * rest / mean_variance;
                for (int64_t other : range(k + 1)) {
                    precision(column[k], column[other]) += row[k] * row[other] / mean_variance;
                }
            }
        }
    }
};

// Replace log-probabilities by weights that add up to 1; return the logarithm of the sum of the probabilities.
double normalise(NewFloats& scores) {
    const double best = *max_element(scores);
    double total = 0.0;
    for (auto& score : scores) total += score = exp(score - best);
    for (auto& score : scores) score /= total;
    return best + log(total);
}

// Log evidence, mean, standard deviation, covariance of the mixture of all cases' posteriors; the model's column.
tuple<double, NewFloats, NewFloats, NewMatrix, NewIntegers> solve_cases(
    const SwitchingPath& path, Integers borders, FloatMatrix statistics, const Cases& cases, double variance,
    double scatter) {
    Conditioned one(path, borders, cases);
    const int64_t count = cases.choice.shape[0], unknowns = one.mean.size();
    NewMatrix means({count, unknowns}), covariance({unknowns, unknowns});
    NewCube covariances({count, unknowns, unknowns});
    NewFloats weights(count), mean(unknowns), std(unknowns);
    for (int64_t c : range(count)) {
        one.condition(cases.choice.row(c), statistics, variance, scatter);
        one.log_determinant += invert(one.precision, one.block, covariances.row(c), one.log_variance);
        double explained = 0.0;
        for (int64_t a : range(unknowns)) {
            double shift = 0.0;
            for (int64_t b : range(unknowns)) shift += covariances(c, a, b) * one.response[b];
            explained += shift * one.response[a];
            means(c, a) = one.mean[a] + shift;
        }
        weights[c] = -0.5 * (one.squares - explained) - 0.5 * one.log_determinant + cases.log_prior[c];
    }
    const double log_evidence = normalise(weights);
    for (int64_t c : range(count)) {
        for (int64_t a : range(unknowns)) mean[a] += weights[c] * means(c, a);
    }
    for (int64_t c : range(count)) {
        for (int64_t a : range(unknowns)) {
            const double apart = weights[c] * (means(c, a) - mean[a]);
            for (int64_t b : range(unknowns)) {
                covariance(a, b) += weights[c] * covariances(c, a, b) + apart * (means(c, b) - mean[b]);
            }
        }
    }
    for (int64_t a : range(unknowns)) std[a] = sqrt(max(covariance(a, a), 0.0));
    return {log_evidence, mean, std, covariance, one.model.column};
}
}  // namespace

double evidence_of_cases(
    const SwitchingPath& path, Integers borders, FloatMatrix statistics, const Cases& cases, double variance,
    double scatter) {
    Conditioned one(path, borders, cases);
    NewFloats scores(cases.choice.shape[0]);
    for (int64_t c : range(scores.size())) {
        one.condition(cases.choice.row(c), statistics, variance, scatter);
        one.log_determinant += factorise(one.precision, one.block, one.log_variance);
        double explained = 0.0;
        for (int64_t i : range(one.mean.size())) {  // by forward substitution
            const double* row = one.precision.row(i).data;
            double value = one.response[i];
            for (int64_t j : range(i)) value -= row[j] * one.response[j];
            one.response[i] = value /= row[i];
            explained += value * value;
        }
        scores[c] = cases.log_prior[c] - 0.5 * (one.squares - explained) - 0.5 * one.log_determinant;
    }
    return normalise(scores);
}

STAGE(friction, solve_cases, evidence_of_cases)

}  // namespace rwa
