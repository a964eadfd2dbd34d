// Which candidates are jumps, and which switching system made each (see rwa_monitor/switching/assignment.py).
#pragma once

#include "arrays.hpp"

namespace rwa {

constexpr int64_t REJECT = 0, NO_SYSTEM = 1;         // the first two rows of every table of actions
constexpr int64_t STEPS = 6;                         // that a system can take at a candidate, see `step_from`
constexpr int64_t REJECTED = -1, UNATTRIBUTED = -2;  // in place of a system: no changepoint; one that none made

// ---- levels between candidates (segments.cpp) ----

// Of the statistics (6, m + 2, m + 2) of all pairs, those of the segments between consecutive nodes: (6, segments).
NewMatrix chain_of(FloatCube pairs, Integers nodes);

// ---- a switching path as a linear model with a Gaussian prior (friction.cpp) ----

// See stage_results.FlatPath.
struct FlatPath {
    Integers configurations, starts, sojourns, unattributed;
    FIELDS(configurations, starts, sojourns, unattributed)
};

// See friction_model.Cases.
struct Cases {
    FloatCube states;
    IntegerMatrix choice;
    Floats log_prior, rest;
    FIELDS(states, choice, log_prior, rest)
};

// The log evidence of `solve_cases` alone, without the posterior.
double evidence_of_cases(
    const FlatPath& path, Integers borders, FloatCube table, FloatMatrix statistics,
    const Cases& cases, double variance, double scatter);

// ---- the scores of paths, and what bounds them (assignment_bounds.cpp) ----

// See assignment.Scores.
struct Scores {
    FloatMatrix fit;
    Array<const double, 4> jump;
    FloatCube stay, turn;
    Array<const double, 5> missed;
    Integers configurations;
    Matrix<const bool> signs;
    IntegerMatrix actions;
    Floats size, size_variance;
    FloatMatrix law_mean, law_variance;
    double log_range, unattributed, unattributed_variance;
    FIELDS(fit, jump, stay, turn, missed, configurations, signs, actions, size, size_variance, law_mean, law_variance,
           log_range, unattributed, unattributed_variance)
};

// Upper bounds of what can follow: the lower of `rest`, and of `rest_fit` with the `own` of all systems.
struct Bounds {
    NewMatrix rest;      // (m + 1, m + 1): fits and laws, last changepoint at i, candidates up to k decided
    NewMatrix rest_fit;  // without laws, less the prices of the jumps
    Table<double, 4> own;       // (S, Q, m + 1, m + 1): a system's laws, with what it earns; sojourn begun at i
};

// The most that a jump at each node can be worth [log density over the flat one that the fits assume].
struct Worth {
    Table<double, 4> single;  // (S, Q, 2, m + 1): by its size, down or up from q; -inf where there is none
    NewFloats twice;          // by its size, of one that two systems make at once
    NewFloats alone;          // by its size, of one that no system makes
    NewFloats with_law;       // of any, by its size and the best law
};

struct Step {
    int64_t direction;      // 0 down, 1 up
    int64_t skipped;        // a jump without a candidate before it: 0 none, 1 down, 2 up
    int64_t before, after;  // configurations
};
inline Step step_from(int64_t configuration, int64_t number) {
    const int64_t direction = number % 2, skipped = number / 2;
    const int64_t before = configuration + (skipped == 0 ? 0 : 2 * skipped - 3);
    return {direction, skipped, before, before + 2 * direction - 1};
}
inline bool possible(const Step& step, int64_t configurations) {
    return min(step.before, step.after) >= 0 && max(step.before, step.after) < configurations;
}

// Call `visit(system, step number)` for each system that steps in an action.
template <typename Visit>
void each_step(IntegerMatrix actions, int64_t action, Visit visit) {
    for (int place : {0, 2}) {
        if (actions(action, place) >= 0) visit(actions(action, place), actions(action, place + 1));
    }
}

// Configurations of all systems at the window's begin, by their number; the last system counts fastest.
inline NewIntegers start_of(int64_t number, Integers configurations) {
    NewIntegers start(configurations.size());
    for (int64_t s = configurations.size() - 1; s >= 0; number /= configurations[s--]) {
        start[s] = number % configurations[s];
    }
    return start;
}

// log P of a sojourn of system s in q from one node to each other, and of the jump that was skipped at its end.
inline const double* sojourn_laws(const Scores& scores, int64_t s, int64_t q, int64_t since, const Step& step) {
    return step.skipped == 0 ? &scores.jump(s, q, since, 0) : &scores.missed(s, q, step.skipped - 1, since, 0);
}

// log P(size of the jump at candidate k), Gaussian, over the flat density that the fits assume.
inline double size_term(const Scores& scores, int64_t k, double mean, double variance) {
    const double total = variance + scores.size_variance[k - 1], miss = scores.size[k - 1] - mean;
    return scores.log_range - 0.5 * log(2.0 * M_PI * total) - 0.5 * (miss * miss) / total;
}

// The bounds without prices, and what jumps are worth; every law term must be ≤ 0.
tuple<Bounds, Worth> free_bounds(const Scores& scores);

// Make the bounds `rest_fit` and `own` those with prices from a complete path: its start and the actions taken.
void set_prices(const Scores& scores, const Worth& worth, Integers start, Integers taken, Bounds& bounds);

// The entries kept as a tree, and the complete paths (last entry and score); how many entries were expanded, and the
// highest bound of what the budget cut.
struct Expansion {
    struct Node {
        int64_t before, action;  // at the root the number of the start
    };
    vector<Node> tree;
    NewIntegers last;
    NewFloats score;
    int64_t expanded = 0;
    double lost = -INFINITE;
};
// Expand all states candidate by candidate. Dropped: extensions with a bound below the cutoff, and those past the
// budget of a candidate, by their bound; `kept` entries are kept of each state.
Expansion expand(const Scores& scores, const Bounds& bounds, double cutoff, int64_t budget, int64_t kept);

}  // namespace rwa
