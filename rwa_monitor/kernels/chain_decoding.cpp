// The likeliest paths of several semi-Markov chains at once (see rwa_monitor/switching/jump_attribution.py).
#include "arrays.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace rwa {
namespace {

// Per slot, of a jump that is no system's: a hundredth of the rate of the rarest jumps that a recording of hours shows.
constexpr double FALSE_RATE = 1e-7;
constexpr double OUTLIER_SHARE = 3e-3;  // of the segments: too short for their level, or with jumps in them not seen
constexpr double BROAD_SHARE = 0.03;    // of the sojourns, as far from the others as a decade
constexpr double BROAD_SIGMA = 2.3;
constexpr double NEVER = 1e-300;  // a probability whose logarithm is finite
constexpr double TWO_PI = 2.0 * 3.141592653589793;
constexpr double INF = std::numeric_limits<double>::infinity();

struct Record {
    Floats level, variance;  // [N m], [N² m²]
    Integers at;         // slots
    auto fields() { return std::tie(level, variance, at); }
};

struct Laws {
    Integers counts;
    Matrix<const double> size, variance, mu, sigma, log_up, log_down;  // (systems, configurations)
    double base, base_variance;
    auto fields() { return std::tie(counts, size, variance, mu, sigma, log_up, log_down, base, base_variance); }
};

struct States {
    Matrix<const int64_t> configuration;  // (states, systems)
    Floats log_probability;
    auto fields() { return std::tie(configuration, log_probability); }
};

// The paths that are followed: where each system is, since which slot, and whether that is in the record; the Kalman
// state, base first, then what each system adds [N m]; the log-likelihood of what has happened.
struct Tracks {
    Table<int64_t, 2> configuration, since, began;
    Table<double, 2> mean;
    Table<double, 3> covariance;
    NewFloats score;

    Tracks(int64_t room, int64_t systems)
        : configuration(Table<int64_t, 2>::zeros(room, systems)), since(configuration), began(configuration),
          mean(Table<double, 2>::zeros(room, systems + 1)),
          covariance(Table<double, 3>::zeros(room, systems + 1, systems + 1)), score(NewFloats::zeros(room)) {}
};

// A way on: path, move, whether the segment is an outlier; score, and that with the survival of the sojourns under way.
struct Way {
    int64_t path, move;
    bool outlier;
    double value, rank;
};

template <typename Values>
double sum(const Values& values) {
    double total = 0.0;
    for (auto value : values) total += value;
    return total;
}

// Log probability that a sojourn lasts so many slots.
double log_density(int64_t slots, double mu, double sigma) {
    const double x = std::log(static_cast<double>(slots)) - mu, u = x / sigma, v = x / BROAD_SIGMA;
    const double near = std::exp(-0.5 * (u * u)) / sigma, far = std::exp(-0.5 * (v * v)) / BROAD_SIGMA;
    return std::log(((1.0 - BROAD_SHARE) * near + BROAD_SHARE * far) / std::sqrt(TWO_PI) + NEVER) -
           std::log(static_cast<double>(slots));
}

// Log probability that a sojourn lasts at least so long.
double log_survival(int64_t slots, double mu, double sigma) {
    const double x = (std::log(static_cast<double>(slots)) - mu) / std::sqrt(2.0);
    const double near = 0.5 * std::erfc(x / sigma), far = 0.5 * std::erfc(x / BROAD_SIGMA);
    return std::log((1.0 - BROAD_SHARE) * near + BROAD_SHARE * far + NEVER);
}

double log_gauss(double deviation, double variance) {
    return -0.5 * (deviation * deviation / variance + std::log(TWO_PI * variance));
}

// Update a path's Kalman state by a segment's level, the sum of all its entries.
void observe(Tracks& tracks, int64_t b, double level, double level_variance, std::vector<double>& gain) {
    const auto mean = tracks.mean.view().row(b);
    const auto covariance = tracks.covariance.view().row(b);
    const double variance = sum(covariance) + level_variance, off = level - sum(mean);
    for (int64_t i = 0; i < mean.size(); ++i) gain[i] = sum(covariance.row(i)) / variance;
    for (int64_t i = 0; i < mean.size(); ++i) {
        mean[i] += gain[i] * off;
        for (int64_t k = 0; k < mean.size(); ++k) covariance(i, k) -= gain[i] * gain[k] * variance;
    }
}

// Begin two paths in each joint state, with the first segment as it is and as an outlier; returns how many.
int64_t begin_paths(
    Tracks& tracks, const Record& record, const Laws& laws, const States& states, double doubt,
    std::vector<double>& gain) {
    const Matrix<const int64_t>& joint = states.configuration;
    const int64_t count = joint.extent(0), systems = joint.extent(1);
    for (int64_t b = 0; b < 2 * count; ++b) {
        const int64_t s = b / 2;
        tracks.mean(b, 0) = laws.base;
        tracks.covariance(b, 0, 0) = laws.base_variance;
        for (int64_t i = 0; i < systems; ++i) {
            tracks.configuration(b, i) = joint(s, i);
            tracks.since(b, i) = record.at[0];
            tracks.mean(b, i + 1) = laws.size(i, joint(s, i));
            tracks.covariance(b, i + 1, i + 1) = laws.variance(i, joint(s, i));
        }
        if (b % 2 == 1) {
            tracks.score[b] = states.log_probability[s] + doubt;
            continue;
        }
        const double off = record.level[0] - sum(tracks.mean.view().row(b));
        const double variance = sum(tracks.covariance.view().row(b)) + record.variance[0];
        tracks.score[b] = states.log_probability[s] + std::log(1.0 - OUTLIER_SHARE) + log_gauss(off, variance);
        observe(tracks, b, record.level[0], record.variance[0], gain);
    }
    return 2 * count;
}

// Copy path b to place p of those that follow, with its systems moved.
void go_on(Tracks& tracks, int64_t b, Tracks& following, int64_t p, Integers move, int64_t slot, const Laws& laws) {
    const auto copy = [&](auto Tracks::* member) {
        const auto from = (tracks.*member).view().row(b);
        std::copy(from.begin(), from.end(), (following.*member).view().row(p).begin());
    };
    copy(&Tracks::configuration), copy(&Tracks::since), copy(&Tracks::began), copy(&Tracks::mean);
    copy(&Tracks::covariance);
    for (int64_t i = 0; i < move.size(); ++i) {
        if (move[i] == 0) continue;
        const int64_t q = following.configuration(p, i) += move[i];
        following.since(p, i) = slot;
        following.began(p, i) = 1;
        following.mean(p, i + 1) = laws.size(i, q);
        for (int64_t k = 0; k <= move.size(); ++k) {
            following.covariance(p, i + 1, k) = following.covariance(p, k, i + 1) = 0.0;
        }
        following.covariance(p, i + 1, i + 1) = laws.variance(i, q);
    }
}

// Mean and variance of the level after a move.
std::pair<double, double> expected_level(Tracks& tracks, int64_t b, Integers move, const Laws& laws) {
    const auto mean = tracks.mean.view().row(b);
    const auto covariance = tracks.covariance.view().row(b);
    double expected = 0.0, variance = 0.0;
    for (int64_t i = 0; i <= move.size(); ++i) {
        if (i > 0 && move[i - 1] != 0) {
            const int64_t q = tracks.configuration(b, i - 1) + move[i - 1];
            expected += laws.size(i - 1, q);
            variance += laws.variance(i - 1, q);
            continue;
        }
        expected += mean[i];
        for (int64_t k = 0; k <= move.size(); ++k) {
            if (k == 0 || move[k - 1] == 0) variance += covariance(i, k);
        }
    }
    return {expected, variance};
}

// Fill `ways` with each path and each possible move into segment j, as it is and as an outlier.
void ways_on(
    Tracks& tracks, int64_t paths, int64_t j, const Record& record, const Laws& laws,
    const Matrix<const int64_t>& moves, double doubt, Matrix<double> entering, std::vector<double>& gone,
    std::vector<double>& staying, std::vector<Way>& ways) {
    const int64_t systems = laws.counts.size(), slot = record.at[j], later = record.at[j + 1];
    ways.clear();
    for (int64_t i = 0; i < systems; ++i) {
        for (int64_t q = 0; q < laws.counts[i]; ++q) {
            entering(i, q) = log_survival(later - slot, laws.mu(i, q), laws.sigma(i, q));
        }
    }
    for (int64_t b = 0; b < paths; ++b) {
        const auto configuration = tracks.configuration.view().row(b);
        for (int64_t i = 0; i < systems; ++i) {
            const int64_t q = configuration[i], since = tracks.since(b, i);
            const double m = laws.mu(i, q), s = laws.sigma(i, q);
            // What was there when the record began is seen from a random moment on: S(e)/mean.
            gone[i] = tracks.began(b, i) ? log_density(slot - since, m, s)
                                         : log_survival(slot - since, m, s) - m - 0.5 * s * s;
            staying[i] = log_survival(later - since, m, s);
        }
        for (int64_t option = 0; option < moves.extent(0); ++option) {
            const auto move = moves.row(option);
            double worth = 0.0, ahead = 0.0;  // log-likelihood of the move, and of what has not happened after it
            bool moved = false, possible = true;
            for (int64_t i = 0; i < systems && possible; ++i) {
                const int64_t q = configuration[i] + move[i];
                if (move[i] == 0) {
                    ahead += staying[i];
                } else if ((possible = q >= 0 && q < laws.counts[i])) {
                    moved = true;
                    worth += gone[i] + (move[i] > 0 ? laws.log_up : laws.log_down)(i, configuration[i]);
                    ahead += entering(i, q);
                }
            }
            if (!possible) continue;
            if (!moved) worth = std::log(FALSE_RATE);
            const auto [expected, spread] = expected_level(tracks, b, move, laws);
            const double plain =
                log_gauss(record.level[j] - expected, spread + record.variance[j]) + std::log(1.0 - OUTLIER_SHARE);
            for (bool outlier : {false, true}) {
                const double value = tracks.score[b] + worth + (outlier ? doubt : plain);
                if (value > -INF) ways.push_back({b, option, outlier, value, value + ahead});
            }
        }
    }
}

}  // namespace

// Follow the paths: a score is the log-likelihood of what has happened; paths are ranked by it and by that of what has
// not happened yet. Returns the configurations of the likeliest path, its outliers and its log-likelihood.
std::tuple<Table<int64_t, 2>, Table<std::uint8_t, 1>, double> likeliest_path(
    const Record& record, const Laws& laws, const States& states, Matrix<const int64_t> moves, int64_t beam) {
    const auto& [level, variance, at] = record;
    const int64_t n = level.size(), systems = laws.counts.size();
    const int64_t room = std::max(beam, 2 * states.configuration.extent(0));
    const double highest = *std::max_element(level.begin(), level.end());
    const double lowest = *std::min_element(level.begin(), level.end());
    const double noise = std::sqrt(*std::max_element(variance.begin(), variance.end()));
    const double doubt = std::log(OUTLIER_SHARE) - std::log(highest - lowest + std::sqrt(laws.base_variance) + noise);
    Tracks tracks(room, systems), following(room, systems);
    auto parents = Table<int64_t, 2>::zeros(n, room);
    auto history = Table<int64_t, 3>::zeros(n, room, systems);
    auto odd = Table<std::uint8_t, 2>::zeros(n, room);
    auto entering = Table<double, 2>::zeros(systems, laws.mu.extent(1));
    std::vector<double> gain(systems + 1), gone(systems), staying(systems);
    std::vector<Way> ways;
    int64_t paths = begin_paths(tracks, record, laws, states, doubt, gain);
    const auto keep = [&](int64_t j, int64_t p, bool outlier) {
        const auto row = tracks.configuration.view().row(p);
        std::copy(row.begin(), row.end(), &history(j, p, 0));
        odd(j, p) = outlier;
    };
    for (int64_t b = 0; b < paths; ++b) keep(0, b, b % 2 == 1);
    for (int64_t j = 1; j < n; ++j) {
        ways_on(tracks, paths, j, record, laws, moves, doubt, entering.view(), gone, staying, ways);
        paths = std::min(beam, static_cast<int64_t>(ways.size()));
        std::partial_sort(ways.begin(), ways.begin() + paths, ways.end(), [](const Way& one, const Way& other) {
            if (one.rank != other.rank) return one.rank > other.rank;
            return std::tie(one.path, one.move, one.outlier) < std::tie(other.path, other.move, other.outlier);
        });
        for (int64_t p = 0; p < paths; ++p) {
            const Way& way = ways[p];
            go_on(tracks, way.path, following, p, moves.row(way.move), at[j], laws);
            if (!way.outlier) observe(following, p, level[j], variance[j], gain);
            following.score[p] = way.value;
            parents(j, p) = way.path;
        }
        std::swap(tracks, following);
        for (int64_t p = 0; p < paths; ++p) keep(j, p, ways[p].outlier);
    }
    for (int64_t b = 0; b < paths; ++b) {
        for (int64_t i = 0; i < systems; ++i) {
            const int64_t q = tracks.configuration(b, i);
            tracks.score[b] += log_survival(at[n] - tracks.since(b, i), laws.mu(i, q), laws.sigma(i, q));
        }
    }
    const auto& score = tracks.score.values;
    int64_t last = std::max_element(score.begin(), score.begin() + paths) - score.begin();
    const double total = score[last];
    auto found = Table<int64_t, 2>::zeros(n, systems);
    auto outliers = Table<std::uint8_t, 1>::zeros(n);
    for (int64_t j = n - 1; j >= 0; --j) {
        std::copy_n(&history(j, last, 0), systems, &found(j, 0));
        outliers[j] = odd(j, last);
        last = parents(j, last);
    }
    return {std::move(found), std::move(outliers), total};
}

void bind_chain_decoding(nanobind::module_& module) {
    module.attr("NEVER") = NEVER;
    kernel(module, "likeliest_path", &likeliest_path);
}

}  // namespace rwa
