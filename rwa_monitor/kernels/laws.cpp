// Duration laws (rwa_monitor/switching/duration_likelihoods.py), densities of measured values (diagnosis/model.py).
#include "arrays.hpp"

namespace rwa {
namespace {
// ---- sojourns ----

constexpr double SOFT_SHARE = 1e-3;     // share of the broad law in every duration law
constexpr double MISSED_SHARE = 1e-2;   // probability that a jump has no candidate: a short sojourn, or in a gap
constexpr double CARRIED_TRUST = 0.95;  // probability that the configuration given by an earlier window is right
enum { DOWN, UP };

// See duration_likelihoods.Chain.
struct Chain {
    Floats means, entered, never;
    FloatMatrix turn;
    FIELDS(means, entered, never, turn)
};

// See duration_likelihoods.Onset.
struct Onset {
    int64_t configuration, age;
    FIELDS(configuration, age)
};

// P(τ ≥ slots) of the broad law of this mean: (1 + (slots - 1) / mean)^-2.
double broad_survival(double slots, double mean) {
    const double share = mean / (mean + slots - 1.0);
    return share * share;
}

// P(τ ≥ slots) of a law, mixed with that of the broad law.
double soft_survival(double survival, double slots, double mean) {
    return (1.0 - SOFT_SHARE) * survival + SOFT_SHARE * broad_survival(slots, mean);
}

// P(τ = slots) of the same mixture, from the law's P(τ ≥ slots) and P(τ ≥ slots + 1).
double soft_pmf(double survival, double following, double slots, double mean) {
    const double broad = broad_survival(slots, mean) - broad_survival(slots + 1.0, mean);
    return (1.0 - SOFT_SHARE) * (survival - following) + SOFT_SHARE * broad;
}

// Log-probability of the first sojourn, in q: of a mixture where an earlier window gives its configuration.
double log_first(double unknown, double known, int64_t q, int64_t configuration) {
    if (configuration < 0) return log(unknown);
    return log((1.0 - CARRIED_TRUST) * unknown + (q == configuration ? CARRIED_TRUST * known : 0.0));
}

// Fill the tables of one system, which hold -inf, from the survivals (Q, points), see laws.pyi.
void tabulate(
    Floats at, int64_t slots, FloatMatrix survivals, const Chain& chain, const Onset& first,
    Array<double, 3> jump, Matrix<double> stay, Array<double, 4> missed) {
    const int64_t count = at.size(), configurations = chain.means.size(), pairs = count * (count - 1) / 2;
    for (int64_t q : range(configurations)) {
        const double mean = chain.means[q];
        const double *survival = survivals.row(q).data, *following = survival + pairs;
        const double *begun = following + pairs, *left = begun + count;
        const double *late = left + count, *later = late + count, *whole = later + count;
        const double alive = soft_survival(whole[0], first.age + 1.0, mean);
        for (int64_t i : range(count)) {
            double* row = &jump(q, 1 + i, 1);
            for (int64_t j : range(i + 1, count)) {
                row[j] = log(soft_pmf(*survival++, *following++, at[j] - at[i], mean));
            }
        }
        for (int64_t k : range(count)) {
            stay(q, 1 + k) = log(soft_survival(left[k], slots - at[k], mean));
            const double ended = chain.entered[q] * soft_survival(begun[k], at[k], mean);
            const double known = soft_pmf(late[k], later[k], first.age + at[k], mean) / alive;
            jump(q, 0, 1 + k) = log_first(ended, known, q, first.configuration);
        }
        const double known = soft_survival(whole[1], first.age + slots, mean) / alive;
        stay(q, 0) = log_first(chain.never[q], known, q, first.configuration);
        if (q + 1 == configurations) continue;
        const double both = mean + chain.means[q + 1];  // mean of two sojourns with a missed jump between them
        const double log_up = log(MISSED_SHARE) + chain.turn(q, UP) + log(2.0 / both);
        const double log_down = log(MISSED_SHARE) + chain.turn(q + 1, DOWN) + log(2.0 / both);
        for (int64_t i : range(count)) {
            double *up = &missed(q, UP, 1 + i, 1), *down = &missed(q + 1, DOWN, 1 + i, 1);
            for (int64_t j : range(i + 1, count)) {
                const double duration = at[j] - at[i];
                if (!(duration >= 2.0)) continue;
                const double longer = 3.0 * log1p(duration / both);
                up[j] = log_up - longer;
                down[j] = log_down - longer;
            }
        }
    }
}

// ---- densities ----

constexpr double OTHER_SIZE = 0.05;      // share of anomalies of another size than those learned
constexpr double GAUSSIAN_WIDTH = 1e-3;  // width over softness, below which a band is a Gaussian
constexpr int LEVEL_NUMBERS = 8;

// The standard normal distribution function.
double below(double x) { return 0.5 * erfc(-x * sqrt(0.5)); }

// The density of a uniform value on [low, high] with Gaussian noise sigma, `soft` of it the band's own.
double density_in(double value, double sigma, double low, double high, double soft) {
    const double width = high - low, distance = abs(value - 0.5 * (low + high));
    // A band narrower than its softness is a Gaussian; the difference below would lose all digits.
    if (width < GAUSSIAN_WIDTH * soft) {
        const double deviation = distance / sigma;
        return exp(-0.5 * (deviation * deviation)) / (sigma * sqrt(2.0 * M_PI));
    }
    // By the lower tail at -distance, so that the difference keeps its digits on either side.
    return (below((0.5 * width - distance) / sigma) - below((-0.5 * width - distance) / sigma)) / width;
}

// A configuration's learned bands (`model.Levels.numbers`), softened by a measurement's standard deviation.
struct Softened {
    const double* numbers;
    double reach, nominal, anomalous;

    Softened(double std, const double* of)
        : numbers(of), reach(hypot(of[7], std)), nominal(hypot(of[2], std)),
          anomalous(hypot(of[5], std)) {}
};

// Densities of a measured value under nominal and under anomalous, and the probability that it lies in no learned band.
array<double, 3> level_density(double value, const Softened& level) {
    const double low = level.numbers[0], high = level.numbers[1], soft = level.numbers[2];
    const double stray_share = level.numbers[6], reach = level.reach;
    const double far = 1.0 + abs(value - 0.5 * (low + high)) / reach;
    const double stray = 0.5 / reach / (far * far);
    const double excess = value - (high + 2.0 * soft), beyond = 1.0 + max(excess, 0.0) / reach;
    const double other = below(excess / level.nominal) / reach / (beyond * beyond);
    const double in_nominal = density_in(value, level.nominal, low, high, soft);
    double learned = other, inside = in_nominal;
    if (!isnan(level.numbers[3])) {
        learned = density_in(value, level.anomalous, level.numbers[3], level.numbers[4], level.numbers[5]);
        inside = in_nominal + learned;
    }
    const double nominal = (1.0 - stray_share) * in_nominal + stray_share * stray;
    const double anomalous = (1.0 - stray_share - OTHER_SIZE) * learned + OTHER_SIZE * other + stray_share * stray;
    const double everything = 0.5 * (nominal + anomalous);
    return {nominal, anomalous, everything > 0.0 ? max(0.0, 1.0 - 0.5 * inside / everything) : 1.0};
}

// `level_density` (3, n, offsets) of measured values with each offset added; 1, 1 and NaN where a value is not finite
// or its configuration was not learned.
NewCube densities(
    Integers configuration, Floats value, Floats std, Floats offset, FloatMatrix numbers) {
    NewCube found({3, value.size(), offset.size()}, 1.0);
    for (int64_t i : range(value.size())) {
        const int64_t q = configuration[i];
        const bool learned = q < numbers.shape[0] && !isnan(numbers(q, 0));
        if (!learned || !isfinite(value[i]) || !isfinite(std[i])) {
            fill_n(&found(2, i, 0), offset.size(), NAN);
            continue;
        }
        const Softened level(std[i], numbers.row(q).data);
        for (int64_t j : range(offset.size())) {
            const auto density = level_density(value[i] + offset[j], level);
            for (int64_t part : range(3)) found(part, i, j) = density[part];
        }
    }
    return found;
}
}  // namespace

STAGE(laws, SOFT_SHARE, LEVEL_NUMBERS, tabulate, densities)

}  // namespace rwa
