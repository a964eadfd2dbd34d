// The most likely joint path of several semi-Markov chains (see rwa_monitor/switching/jump_attribution.py).
#include "arrays.hpp"

namespace rwa {
namespace {

// Rate per slot of jumps of no system: a hundredth of that of the rarest jumps in a recording of hours.
constexpr double FALSE_RATE = 1e-7;
constexpr double OUTLIER_SHARE = 3e-3;  // of the segments: too short for a level, or with undetected jumps in them
constexpr double BROAD_SHARE = 0.03;    // of the sojourns, with durations that spread over a decade
constexpr double BROAD_SIGMA = 2.3;
constexpr double NEVER = 1e-300;  // a probability whose logarithm is finite
constexpr int64_t MOST_SYSTEMS = 3;
constexpr int64_t PARTS = 1 + MOST_SYSTEMS;  // of a level: the base, then the friction of each system

struct Record {
    Floats level, variance;  // [N m], [N² m²]
    Integers at;         // slots
    FIELDS(level, variance, at)
};

struct Laws {
    Integers counts;
    FloatMatrix size, variance, mu, sigma, log_up, log_down;  // (systems, configurations)
    double base, base_variance;
    FIELDS(counts, size, variance, mu, sigma, log_up, log_down, base, base_variance)
};

struct States {
    IntegerMatrix configuration;  // (states, systems)
    Floats log_probability;
    FIELDS(configuration, log_probability)
};

using Configuration = array<int64_t, MOST_SYSTEMS>;

template <typename Values>
double sum(const Values& values) {
    double total = 0.0;
    for (auto value : values) total += value;
    return total;
}

// Log probability of a sojourn's duration.
double log_density(int64_t slots, double mu, double sigma) {
    const double x = log(slots) - mu, u = x / sigma, v = x / BROAD_SIGMA;
    const double near = exp(-0.5 * (u * u)) / sigma, far = exp(-0.5 * (v * v)) / BROAD_SIGMA;
    return log(((1.0 - BROAD_SHARE) * near + BROAD_SHARE * far) / sqrt((2.0 * M_PI)) + NEVER) -
           log(slots);
}

// Log probability that a sojourn lasts at least so many slots.
double log_survival(int64_t slots, double mu, double sigma) {
    const double x = (log(slots) - mu) / sqrt(2.0);
    const double near = 0.5 * erfc(x / sigma), far = 0.5 * erfc(x / BROAD_SIGMA);
    return log((1.0 - BROAD_SHARE) * near + BROAD_SHARE * far + NEVER);
}

double log_gauss(double deviation, double variance) {
    return -0.5 * (deviation * deviation / variance + log((2.0 * M_PI) * variance));
}

// A path in the beam: each system's configuration, the slot since which it holds, and whether it began in the record;
// the Kalman state [N m]; the log-likelihood so far; its last segment in the history.
struct Track {
    Configuration configuration{}, since{};
    array<bool, MOST_SYSTEMS> began{};
    array<double, PARTS> mean{};
    array<double, PARTS * PARTS> covariance{};
    double score = 0.0;
    int64_t last = -1;

    // Set a system's configuration, with the law as the prior of its friction.
    void enter(int64_t i, int64_t q, int64_t slot, const Laws& laws) {
        configuration[i] = q;
        since[i] = slot;
        mean[i + 1] = laws.size(i, q);
        for (int64_t k : range(PARTS)) covariance[(i + 1) * PARTS + k] = covariance[k * PARTS + i + 1] = 0.0;
        covariance[(i + 1) * PARTS + i + 1] = laws.variance(i, q);
    }

    // Update the Kalman state by a segment's level, the sum of all its entries.
    void observe(double level, double level_variance) {
        const double variance = sum(covariance) + level_variance, off = level - sum(mean);
        array<double, PARTS> gain{};
        for (int64_t i : range(PARTS)) {
            for (int64_t k : range(PARTS)) gain[i] += covariance[i * PARTS + k];
            gain[i] /= variance;
        }
        for (int64_t i : range(PARTS)) {
            mean[i] += gain[i] * off;
            for (int64_t k : range(PARTS)) covariance[i * PARTS + k] -= gain[i] * gain[k] * variance;
        }
    }

    // Mean and variance of the level after a move.
    std::pair<double, double> expected_level(Integers move, const Laws& laws) const {
        double expected = 0.0, variance = 0.0;
        for (int64_t i : range(move.size() + 1)) {
            if (i > 0 && move[i - 1] != 0) {
                const int64_t q = configuration[i - 1] + move[i - 1];
                expected += laws.size(i - 1, q);
                variance += laws.variance(i - 1, q);
                continue;
            }
            expected += mean[i];
            for (int64_t k : range(move.size() + 1)) {
                if (k == 0 || move[k - 1] == 0) variance += covariance[i * PARTS + k];
            }
        }
        return {expected, variance};
    }
};

// A segment of a path: the previous one, whether it is an outlier, and the systems' configurations.
struct Visited {
    int64_t before;
    bool outlier;
    Configuration configuration;
};

// An extension: path, move, whether the segment is an outlier; score, without and with the survival of open sojourns.
struct Way {
    int64_t path, move;
    bool outlier;
    double value, rank;
};

// Begin two paths in each joint state, with the first segment as a regular one and as an outlier.
vector<Track> begin_paths(const Record& record, const Laws& laws, const States& states, double outlier_score) {
    vector<Track> tracks;
    for (int64_t s : range(states.configuration.shape[0])) {
        Track track;
        track.mean[0] = laws.base;
        track.covariance[0] = laws.base_variance;
        for (int64_t i : range(laws.counts.size())) track.enter(i, states.configuration(s, i), record.at[0], laws);
        Track& plain = tracks.emplace_back(track);
        const double off = record.level[0] - sum(track.mean), variance = sum(track.covariance) + record.variance[0];
        plain.score = states.log_probability[s] + log(1.0 - OUTLIER_SHARE) + log_gauss(off, variance);
        plain.observe(record.level[0], record.variance[0]);
        track.score = states.log_probability[s] + outlier_score;
        tracks.push_back(track);
    }
    return tracks;
}

// Fill `ways` with each path and each possible move into segment j, as a regular segment and as an outlier.
void ways_on(
    const vector<Track>& tracks, int64_t j, const Record& record, const Laws& laws,
    const IntegerMatrix& moves, double outlier_score, vector<Way>& ways) {
    const int64_t systems = laws.counts.size(), slot = record.at[j], later = record.at[j + 1];
    ways.clear();
    NewMatrix entering(laws.mu.shape);
    for (int64_t i : range(systems)) {
        for (int64_t q : range(laws.counts[i])) {
            entering(i, q) = log_survival(later - slot, laws.mu(i, q), laws.sigma(i, q));
        }
    }
    for (int64_t b : range(tracks.size())) {
        const Track& track = tracks[b];
        array<double, MOST_SYSTEMS> gone, staying;
        for (int64_t i : range(systems)) {
            const int64_t q = track.configuration[i], since = track.since[i];
            const double m = laws.mu(i, q), s = laws.sigma(i, q);
            // A sojourn that the record's start cuts is observed from a random time on: S(e)/mean.
            gone[i] = track.began[i] ? log_density(slot - since, m, s)
                                     : log_survival(slot - since, m, s) - m - 0.5 * s * s;
            staying[i] = log_survival(later - since, m, s);
        }
        for (int64_t option : range(moves.shape[0])) {
            const auto move = moves.row(option);
            double worth = 0.0, ahead = 0.0;  // log-likelihood of the move, and of the survivals after it
            bool moved = false, possible = true;
            for (int64_t i = 0; i < systems && possible; ++i) {
                const int64_t q = track.configuration[i] + move[i];
                if (move[i] == 0) {
                    ahead += staying[i];
                } else if ((possible = q >= 0 && q < laws.counts[i])) {
                    moved = true;
                    worth += gone[i] + (move[i] > 0 ? laws.log_up : laws.log_down)(i, track.configuration[i]);
                    ahead += entering(i, q);
                }
            }
            if (!possible) continue;
            if (!moved) worth = log(FALSE_RATE);
            const auto [expected, spread] = track.expected_level(move, laws);
            const double plain =
                log_gauss(record.level[j] - expected, spread + record.variance[j]) + log(1.0 - OUTLIER_SHARE);
            for (bool outlier : {false, true}) {
                const double value = track.score + worth + (outlier ? outlier_score : plain);
                if (value > -INFINITY) ways.push_back({b, option, outlier, value, value + ahead});
            }
        }
    }
}

}  // namespace

// Beam search: a score is the log-likelihood of the completed sojourns and levels; paths are ranked by it together with
// the survival of the open sojourns. Returns configurations, outliers and log-likelihood of the most likely path.
tuple<Table<int64_t, 2>, vector<std::uint8_t>, double> likeliest_path(
    const Record& record, const Laws& laws, const States& states, IntegerMatrix moves, int64_t beam) {
    const auto& [level, variance, at] = record;
    const int64_t n = level.size(), systems = laws.counts.size();
    REQUIRE(systems <= MOST_SYSTEMS);
    const double highest = *max_element(level);
    const double lowest = *min_element(level);
    const double noise = sqrt(*max_element(variance));
    const double span = highest - lowest + sqrt(laws.base_variance) + noise;
    const double outlier_score = log(OUTLIER_SHARE) - log(span);
    vector<Track> tracks = begin_paths(record, laws, states, outlier_score), following;
    vector<Visited> history;
    const auto visit = [&](Track& track, bool outlier) {
        history.push_back({track.last, outlier, track.configuration});
        track.last = history.size() - 1;
    };
    for (int64_t b : range(tracks.size())) visit(tracks[b], b % 2 == 1);
    vector<Way> ways;
    for (int64_t j : range(1, n)) {
        ways_on(tracks, j, record, laws, moves, outlier_score, ways);
        const auto end = ways.begin() + min<int64_t>(beam, ways.size());
        partial_sort(ways, end, [](const Way& one, const Way& other) {
            if (one.rank != other.rank) return one.rank > other.rank;
            return tie(one.path, one.move, one.outlier) < tie(other.path, other.move, other.outlier);
        });
        ways.erase(end, ways.end());
        following.clear();
        for (const Way& way : ways) {
            Track& track = following.emplace_back(tracks[way.path]);
            const auto move = moves.row(way.move);
            for (int64_t i : range(systems)) {
                if (move[i] == 0) continue;
                track.enter(i, track.configuration[i] + move[i], at[j], laws);
                track.began[i] = true;
            }
            if (!way.outlier) track.observe(level[j], variance[j]);
            track.score = way.value;
            visit(track, way.outlier);
        }
        swap(tracks, following);
    }
    const Track* best = nullptr;
    for (Track& track : tracks) {
        for (int64_t i : range(systems)) {
            const int64_t q = track.configuration[i];
            track.score += log_survival(at[n] - track.since[i], laws.mu(i, q), laws.sigma(i, q));
        }
        if (best == nullptr || track.score > best->score) best = &track;
    }
    Table<int64_t, 2> found({n, systems});
    vector<std::uint8_t> outliers(n);
    int64_t last = best->last;
    for (int64_t j = n - 1; j >= 0; --j, last = history[last].before) {
        copy_n(history[last].configuration.begin(), systems, found.row(j).begin());
        outliers[j] = history[last].outlier;
    }
    return {found, outliers, best->score};
}

STAGE(chain_decoding, NEVER, likeliest_path)

}  // namespace rwa
