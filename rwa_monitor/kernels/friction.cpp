// A switching path as a linear model with a Gaussian prior (see rwa_monitor/switching/friction_model.py).
#include "assignment.hpp"

#include <algorithm>

namespace rwa {
namespace {
constexpr double PIVOT_ROUNDING = 0x1p-52;  // of a pivot, relative to the diagonal
constexpr double LEAST_PIVOT = 1e-60;       // of a coefficient that a wheel file leaves no room for
constexpr int64_t PANEL = 4;                // columns of a factor

// The linear model of a switching path, with the unknowns base, sojourns, unattributed jumps, and slope: levels, column
// and laws (see friction.pyi).
std::tuple<Table<double, 2>, NewIntegers, Table<double, 2>> lay_out(
    const FlatStory& story, Integers borders, Array<const double, 3> table) {
    const auto [configurations, starts, sojourns, unattributed] = story;
    auto column = NewIntegers::full(-1, configurations.size());
    std::vector<std::array<double, 3>> free;
    for (int64_t s = 0, at = 0; s < sojourns.size(); ++s) {
        for (const int64_t end = at + sojourns[s]; at < end; ++at) {
            const auto law = table.row(s).row(configurations[at]);
            if (law[0] == 0.0 && law[1] == 0.0) continue;
            free.push_back({static_cast<double>(s), law[0], law[1]});
            column[at] = static_cast<int64_t>(free.size());
        }
    }
    auto laws = Table<double, 2>::zeros(3, free.size());
    for (std::size_t i = 0; i < free.size(); ++i) {
        for (int k = 0; k < 3; ++k) laws(k, i) = free[i][k];
    }
    const int64_t segments = borders.size() - 1;
    auto levels = Table<double, 2>::zeros(segments, 1 + free.size() + unattributed.size());
    for (int64_t segment = 0; segment < segments; ++segment) {
        const auto row = levels.view().row(segment);
        const int64_t end = borders[segment + 1];
        row[0] = 1.0;
        for (int64_t s = 0, own = 0, next = 0; s < sojourns.size(); ++s, own = next) {
            next += sojourns[s];
            while (own + 1 < next && starts[own + 1] < end) ++own;  // a segment belongs to those that hold at its end
            if (column[own] >= 0) row[column[own]] = 1.0;
        }
        for (int64_t j = 0; j < unattributed.size(); ++j) {
            if (end > unattributed[j]) row[1 + free.size() + j] = 1.0;
        }
    }
    return {std::move(levels), std::move(column), std::move(laws)};
}

// Take the four finished columns of a factor from the lower triangle of the rows and columns [first, end).
VECTORISED void take_panel(Matrix<double> matrix, Matrix<double> panel, int64_t first, int64_t end) {
    const double *a = panel.row(0).data, *b = panel.row(1).data, *c = panel.row(2).data, *d = panel.row(3).data;
    for (int64_t i = first; i < end; ++i) {
        double* __restrict row = matrix.row(i).data;
        const double ai = a[i], bi = b[i], ci = c[i], di = d[i];
        for (int64_t j = first; j <= i; ++j) row[j] = (((row[j] - ai * a[j]) - bi * b[j]) - ci * c[j]) - di * d[j];
    }
}

// Put the Cholesky factor in the place of the lower triangle; return the log-determinant. `block`: the first row of the
// diagonal block that each row belongs to (beyond the blocks the matrix is zero). `PANEL` columns are finished before
// they are taken from those beyond, so that a matrix larger than the fastest cache is read less often; each element is
// still reached by one column after the other.
double factorise(Matrix<double> matrix, Integers block, Vector<double> log_pivot) {
    const int64_t size = matrix.extent(0);
    std::vector<double> diagonal(size);
    for (int64_t i = 0; i < size; ++i) diagonal[i] = matrix(i, i);
    auto panel = Table<double, 2>::zeros(PANEL, size);
    double log_determinant = 0.0;
    for (int64_t first = 0, last, end = 0; first < size; first = last) {
        while (end < size && block[end] <= first) ++end;
        last = std::min(first + PANEL, end);
        for (int64_t j = first; j < last; ++j) {
            // A pivot smaller than its rounding is taken for that: noise a billionth of the friction leaves no digits.
            const double pivot = std::max({matrix(j, j), PIVOT_ROUNDING * diagonal[j], LEAST_PIVOT});
            log_pivot[j] = std::log(pivot);
            log_determinant += log_pivot[j];
            const double root = matrix(j, j) = std::sqrt(pivot);
            double* __restrict column = panel.view().row(j - first).data;
            for (int64_t i = j + 1; i < end; ++i) {
                double* __restrict row = matrix.row(i).data;
                row[j] = column[i] = row[j] / root;
                for (int64_t c = j + 1; c < std::min(i + 1, last); ++c) row[c] -= column[i] * column[c];
            }
        }
        if (last < end) take_panel(matrix, panel.view(), last, end);
    }
    return log_determinant;
}

// The inverse of a Cholesky factor with diagonal blocks, to `lower`, which holds zeros.
VECTORISED void invert_factor(Matrix<const double> factor, Integers block, Matrix<double> lower) {
    for (int64_t i = 0; i < factor.extent(0); ++i) {
        double* __restrict row = lower.row(i).data;
        const double pivot = factor(i, i);
        for (int64_t c = block[i]; c < i; ++c) {
            const double* __restrict above = lower.row(c).data;
            const double weight = factor(i, c);
            for (int64_t j = block[i]; j <= c; ++j) row[j] -= weight * above[j];
        }
        for (int64_t j = block[i]; j < i; ++j) row[j] /= pivot;
        row[i] = 1.0 / pivot;
    }
}

// The lower triangle of LᵀL, L in diagonal blocks, to `product`, which holds zeros.
VECTORISED void square(Matrix<const double> lower, Integers block, Matrix<double> product) {
    for (int64_t c = 0; c < lower.extent(0); ++c) {
        const double* __restrict row = lower.row(c).data;
        for (int64_t i = block[c]; i <= c; ++i) {
            double* __restrict out = product.row(i).data;
            const double weight = row[i];
            for (int64_t j = block[c]; j <= i; ++j) out[j] += weight * row[j];
        }
    }
}

// Write the inverse of a symmetric positive definite matrix, of which the lower triangle is read and destroyed; return
// its log-determinant, the sum of `log_pivot`.
double invert(Matrix<double> matrix, Integers block, Matrix<double> inverse, Vector<double> log_pivot) {
    const int64_t size = matrix.extent(0);
    const double log_determinant = factorise(matrix, block, log_pivot);
    auto lower = Table<double, 2>::zeros(size, size);
    invert_factor(matrix, block, lower.view());
    std::fill(inverse.begin(), inverse.end(), 0.0);
    square(lower.view(), block, inverse);
    for (int64_t i = 0; i < size; ++i) {
        for (int64_t j = 0; j < i; ++j) inverse(j, i) = inverse(i, j);
    }
    return log_determinant;
}

// The prior with all parts in their first state, all in their second, and so on. What a system's anomaly does to its
// sojourns is common to them; all else is independent before the window. So each part is a diagonal block of the
// covariance, and a case takes it from the state that it chooses.
struct Prior {
    std::vector<int64_t> part;            // whose state each unknown depends on
    NewIntegers block;                    // see `factorise`
    Table<double, 2> mean, log_variance;  // (states, unknowns); the logarithm of each pivot of the covariance
    Table<double, 3> precision;           // (states, unknowns, unknowns)
};

// Mean, and the lower triangle within the blocks of the covariance, with each part in one state: of a factor 1 + a of a
// system's laws (m, s), with a of N(mean, spread²), the covariance is spread² m mᵀ + (1 + mean)² diag(s²).
void write_prior(
    Matrix<const double> state, Matrix<const double> laws, Floats rest, Integers block, Vector<double> mean,
    Matrix<double> covariance) {
    const int64_t unknowns = mean.size(), sojourns = laws.extent(1);
    mean[0] = state(0, 0), covariance(0, 0) = state(0, 1) * state(0, 1);
    for (int64_t i = 0; i < sojourns; ++i) {
        const auto owner = 1 + static_cast<int64_t>(laws(0, i));
        const double factor = 1.0 + state(owner, 0), spread = state(owner, 1), deviation = factor * laws(2, i);
        mean[1 + i] = factor * laws(1, i);
        for (int64_t j = block[1 + i] - 1; j < i; ++j) {
            covariance(1 + i, 1 + j) = (spread * laws(1, i)) * (spread * laws(1, j));
        }
        covariance(1 + i, 1 + i) = deviation * deviation + (spread * laws(1, i)) * (spread * laws(1, i));
    }
    for (int64_t i = 1 + sojourns; i < unknowns - 1; ++i) mean[i] = 0.0, covariance(i, i) = rest[0] * rest[0];
    mean[unknowns - 1] = rest[1], covariance(unknowns - 1, unknowns - 1) = rest[2] * rest[2];
}

Prior prior_of_states(const Cases& cases, Matrix<const double> laws, int64_t unknowns) {
    const int64_t states = cases.states.extent(0);
    Prior prior{
        std::vector<int64_t>(unknowns), NewIntegers::zeros(unknowns), Table<double, 2>::zeros(states, unknowns),
        Table<double, 2>::zeros(states, unknowns), Table<double, 3>::zeros(states, unknowns, unknowns)};
    for (int64_t i = 0; i < unknowns; ++i) prior.block[i] = i;
    for (int64_t i = 0; i < laws.extent(1); ++i) {
        prior.part[1 + i] = 1 + static_cast<int64_t>(laws(0, i));
        if (i > 0 && laws(0, i) == laws(0, i - 1)) prior.block[1 + i] = prior.block[i];
    }
    const Integers block = prior.block.view();
    auto covariance = Table<double, 2>::zeros(unknowns, unknowns);
    for (int64_t state = 0; state < states; ++state) {
        const auto log_variance = prior.log_variance.view().row(state);
        write_prior(cases.states.row(state), laws, cases.rest, block, prior.mean.view().row(state), covariance.view());
        invert(covariance.view(), block, prior.precision.view().row(state), log_variance);
    }
    return prior;
}

// Write mean, and the lower triangle of the precision, of one case; return its covariance's log-determinant.
double choose(const Prior& prior, Integers choice, Vector<double> mean, Matrix<double> precision) {
    double log_determinant = 0.0;
    for (int64_t i = 0; i < mean.size(); ++i) {
        const int64_t state = choice[prior.part[i]], begin = prior.block.view()[i];
        const double* source = prior.precision.view().row(state).row(i).data;
        double* row = precision.row(i).data;
        mean[i] = prior.mean.view()(state, i);
        std::fill(row, row + begin, 0.0);
        std::copy(source + begin, source + i + 1, row + begin);
        log_determinant += prior.log_variance.view()(state, i);
    }
    return log_determinant;
}

// What the segments were seen to be.
struct Seen {
    Matrix<const double> levels, moments;
    double variance, scatter;
};

// Add the segments to a prior: the lower triangle of the precision becomes the posterior's, `response` that precision
// times the change of the mean. Returns the squared misses of the prior's mean, and the log-determinant with that of the
// segments' variances.
std::tuple<double, double> add_segments(
    const Seen& seen, Floats mean, Matrix<double> precision, Vector<double> response, double log_determinant) {
    const auto [levels, moments, variance, scatter] = seen;
    const int64_t unknowns = mean.size(), slope_at = unknowns - 1;
    std::fill(response.begin(), response.end(), 0.0);
    std::vector<double> row(unknowns);  // what is not zero in a segment's row
    std::vector<int64_t> column(unknowns);
    const double slope = mean[slope_at];
    double squares = 0.0;
    for (int64_t i = 0; i < levels.extent(0); ++i) {
        const double n = moments(0, i);
        if (n == 0.0) continue;
        const double x_mean = moments(1, i) / n, z_mean = moments(2, i) / n;
        // About the segment's own mean only the slope counts; what is left of z after its prior mean is small.
        const double sxx = moments(3, i) - n * x_mean * x_mean;
        const double sxz = moments(4, i) - n * x_mean * z_mean;
        const double szz = moments(5, i) - n * z_mean * z_mean;
        precision(slope_at, slope_at) += sxx / variance;
        response[slope_at] += (sxz - slope * sxx) / variance;
        squares += (szz - 2.0 * slope * sxz + slope * slope * sxx) / variance;
        // The mean is one observation of level + slope x_mean.
        const double mean_variance = variance / n + scatter;
        int64_t held = 0;
        for (int64_t a = 0; a < unknowns; ++a) {
            const double value = a < slope_at ? levels(i, a) : x_mean;
            if (value != 0.0) row[held] = value, column[held++] = a;
        }
        double rest = z_mean;
        for (int64_t k = 0; k < held; ++k) rest -= row[k] * mean[column[k]];
        squares += rest * rest / mean_variance;
        log_determinant += std::log(mean_variance * n / variance);  // relative to independent samples
        for (int64_t k = 0; k < held; ++k) {
            response[column[k]] += row[k] * rest / mean_variance;
            for (int64_t other = 0; other <= k; ++other) {
                precision(column[k], column[other]) += row[k] * row[other] / mean_variance;
            }
        }
    }
    return {squares, log_determinant};
}

// Condition the prior of this mean, precision (destroyed) and covariance's log-determinant on the segments; write mean
// and covariance of the posterior, return the log evidence.
double condition_on(
    const Seen& seen, Floats mean, Matrix<double> precision, double log_determinant, Vector<double> posterior_mean,
    Matrix<double> posterior) {
    const int64_t unknowns = mean.size();
    auto response = NewFloats::zeros(unknowns), log_variance = response;
    const auto [squares, with_segments] = add_segments(seen, mean, precision, response.view(), log_determinant);
    const auto whole = NewIntegers::zeros(unknowns);
    log_determinant = with_segments + invert(precision, whole.view(), posterior, log_variance.view());
    double explained = 0.0;
    for (int64_t a = 0; a < unknowns; ++a) {
        double shift = 0.0;
        for (int64_t b = 0; b < unknowns; ++b) shift += posterior(a, b) * response[b];
        explained += shift * response[a];
        posterior_mean[a] = mean[a] + shift;
    }
    return -0.5 * (squares - explained) - 0.5 * log_determinant;
}

// Turn log-probabilities into weights that add up to 1; return the logarithm of their sum.
double normalise(std::vector<double>& scores) {
    const double best = *std::max_element(scores.begin(), scores.end());
    double total = 0.0;
    for (auto& score : scores) total += score = std::exp(score - best);
    for (auto& score : scores) score /= total;
    return best + std::log(total);
}

double condition(
    Matrix<const double> levels, Matrix<const double> moments, Floats mean, Matrix<double> covariance, Integers block,
    double variance, double scatter, Vector<double> posterior_mean, Matrix<double> posterior) {
    auto precision = Table<double, 2>::zeros(mean.size(), mean.size());
    auto log_variance = NewFloats::zeros(mean.size());
    const double log_determinant = invert(covariance, block, precision.view(), log_variance.view());
    return condition_on(
        {levels, moments, variance, scatter}, mean, precision.view(), log_determinant, posterior_mean, posterior);
}

// Log evidence, mean, standard deviation, covariance of the mixture of all cases' posteriors; the column of `lay_out`.
std::tuple<double, NewFloats, NewFloats, Table<double, 2>, NewIntegers> solve_cases(
    const FlatStory& story, Integers borders, Array<const double, 3> table, Matrix<const double> moments,
    const Cases& cases, double variance, double scatter) {
    auto [levels, column, laws] = lay_out(story, borders, table);
    const int64_t count = cases.choice.extent(0), unknowns = levels.view().extent(1) + 1;
    const Prior prior = prior_of_states(cases, laws.view(), unknowns);
    auto means = Table<double, 2>::zeros(count, unknowns);
    auto covariances = Table<double, 3>::zeros(count, unknowns, unknowns);
    auto mean = NewFloats::zeros(unknowns), std = mean;
    auto precision = Table<double, 2>::zeros(unknowns, unknowns), covariance = precision;
    std::vector<double> weights(count);
    for (int64_t c = 0; c < count; ++c) {
        const double log_determinant = choose(prior, cases.choice.row(c), mean.view(), precision.view());
        weights[c] = condition_on(
            {levels.view(), moments, variance, scatter}, mean.view(), precision.view(), log_determinant,
            means.view().row(c), covariances.view().row(c));
        weights[c] += cases.log_prior[c];
    }
    const double log_evidence = normalise(weights);
    std::fill(mean.values.begin(), mean.values.end(), 0.0);
    for (int64_t c = 0; c < count; ++c) {
        for (int64_t a = 0; a < unknowns; ++a) mean[a] += weights[c] * means(c, a);
    }
    for (int64_t c = 0; c < count; ++c) {
        for (int64_t a = 0; a < unknowns; ++a) {
            const double apart = weights[c] * (means(c, a) - mean[a]);
            for (int64_t b = 0; b < unknowns; ++b) {
                covariance(a, b) += weights[c] * covariances(c, a, b) + apart * (means(c, b) - mean[b]);
            }
        }
    }
    for (int64_t a = 0; a < unknowns; ++a) std[a] = std::sqrt(std::max(covariance(a, a), 0.0));
    return {log_evidence, std::move(mean), std::move(std), std::move(covariance), std::move(column)};
}
}  // namespace

double evidence_of_cases(
    const FlatStory& story, Integers borders, Array<const double, 3> table, Matrix<const double> moments,
    const Cases& cases, double variance, double scatter) {
    auto [levels, column, laws] = lay_out(story, borders, table);
    const int64_t count = cases.choice.extent(0), unknowns = levels.view().extent(1) + 1;
    const Prior prior = prior_of_states(cases, laws.view(), unknowns);
    auto mean = NewFloats::zeros(unknowns), response = mean, log_variance = mean;
    auto precision = Table<double, 2>::zeros(unknowns, unknowns);
    const auto whole = NewIntegers::zeros(unknowns);
    std::vector<double> scores(count);
    for (int64_t c = 0; c < count; ++c) {
        const double of_prior = choose(prior, cases.choice.row(c), mean.view(), precision.view());
        const auto [squares, with_segments] = add_segments(
            {levels.view(), moments, variance, scatter}, mean.view(), precision.view(), response.view(), of_prior);
        const double log_determinant = with_segments + factorise(precision.view(), whole.view(), log_variance.view());
        double explained = 0.0;
        for (int64_t i = 0; i < unknowns; ++i) {  // by forward substitution, in units of the posterior's deviations
            const double* row = precision.view().row(i).data;
            double value = response[i];
            for (int64_t j = 0; j < i; ++j) value -= row[j] * response[j];
            response[i] = value /= row[i];
            explained += value * value;
        }
        scores[c] = cases.log_prior[c] - 0.5 * (squares - explained) - 0.5 * log_determinant;
    }
    return normalise(scores);
}

void bind_friction(nanobind::module_& module) {
    kernel(module, "lay_out", &lay_out);
    kernel(module, "condition", &condition);
    kernel(module, "solve_cases", &solve_cases);
    kernel(module, "evidence_of_cases", &evidence_of_cases);
}

}  // namespace rwa
