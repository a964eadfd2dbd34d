// Assignment of candidates to jumps of switching systems, or to none (see rwa_monitor/switching/assignment.py).
#include "detection.hpp"

#include <unordered_map>

namespace rwa {
namespace {

enum : int64_t { REJECT, NO_SYSTEM };  // the first two rows of every table of actions
constexpr int64_t STEPS = 6;           // of a system at a candidate, see `step_from`
enum : int64_t { UNATTRIBUTED = -2, REJECTED };  // in place of a system: changepoint of no system; no changepoint

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

// Upper bounds of the score that can follow: `rest`, plus `own` of all systems.
struct Bounds {
    NewMatrix rest;        // (m + 1, m + 1): fits and jumps, last changepoint at i, candidates up to k decided
    Table<double, 4> own;  // (S, Q, m + 1, m + 1): a system's laws plus the prices it earns; sojourn begun at i
};

// Largest possible gain of a jump at each node [log density over the flat one that the fits assume].
struct Worth {
    Table<double, 4> single;  // (S, Q, 2, m + 1): by its size, down or up from q; -inf where there is none
    NewFloats twice;          // by its size, of a jump of two systems at once
    NewFloats alone;          // by its size, of a jump of no system
    NewFloats with_law;       // of any jump, by its size and the best law
};

struct Step {
    int64_t direction;      // 0 down, 1 up
    int64_t skipped;        // a missed jump (without a candidate) before it: 0 none, 1 down, 2 up
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

// Configurations of all systems at the window's begin, by their number; the last system varies fastest.
inline NewIntegers start_of(int64_t number, Integers configurations) {
    NewIntegers start(configurations.size());
    for (int64_t s = configurations.size() - 1; s >= 0; number /= configurations[s--]) {
        start[s] = number % configurations[s];
    }
    return start;
}

// log P of a sojourn of system s in q from node `since` to each node, with the missed jump of `step`, if any.
inline const double* sojourn_laws(const Scores& scores, int64_t s, int64_t q, int64_t since, const Step& step) {
    return step.skipped == 0 ? &scores.jump(s, q, since, 0) : &scores.missed(s, q, step.skipped - 1, since, 0);
}

// log P(size of the jump at candidate k), Gaussian, over the flat density that the fits assume.
inline double size_term(const Scores& scores, int64_t k, double mean, double variance) {
    const double total = variance + scores.size_variance[k - 1], miss = scores.size[k - 1] - mean;
    return scores.log_range - 0.5 * log(2.0 * M_PI * total) - 0.5 * (miss * miss) / total;
}

// ---- bounds ----------------------------------------------------------------------------------------------------------
// Upper bounds of the score that can follow a partial assignment. Those of the first search are free: every jump has the
// best law and size that any system could have there. Those of the second are a Lagrangian relaxation (Fisher 1981, "The
// Lagrangian relaxation method for solving integer programming problems", Management Science 27): levels and each
// system are optimised separately, and the levels pay a price for their jump at a candidate, which a system that jumps
// there earns. For any prices the sum of the separate optima is an upper bound of the joint one; good prices balance
// the gains and costs of the jumps of a good path.

// The largest `size_term` for any mean and at least this variance.
double highest_size(const Scores& scores, int64_t k, double variance) {
    return size_term(scores, k, scores.size[k - 1], variance);
}

// Call `visit(q, direction, after)` for each jump that a system can make.
template <typename Visit>
void each_jump(int64_t configurations, Visit visit) {
    for (int64_t q : range(configurations)) {
        for (int64_t direction : range(2)) {
            const int64_t after = q + 2 * direction - 1;
            if (after >= 0 && after < configurations) visit(q, direction, after);
        }
    }
}

// Raise `highest` to the largest entry above the diagonal in each column.
void raise(Vector<double> highest, FloatMatrix table) {
    for (int64_t i : range(table.shape[0])) {
        for (int64_t k : range(i + 1, table.shape[1])) highest[k] = max(highest[k], table(i, k));
    }
}

Worth worth_of(const Scores& scores) {
    const auto [systems, configurations, nodes] = scores.stay.shape;
    Worth worth{Table<double, 4>({systems, configurations, 2, nodes}, -INFINITY), NewFloats(nodes), NewFloats(nodes),
                NewFloats(nodes)};
    NewMatrix law({systems, nodes}, -INFINITY);  // the best one of a sojourn that ends at the node
    for (int64_t s : range(systems)) {
        for (int64_t q : range(configurations)) {
            raise(law.row(s), scores.jump.row(s).row(q));
            for (int64_t skipped : range(2)) raise(law.row(s), scores.missed.row(s).row(q).row(skipped));
        }
    }
    for (int64_t k : range(1, nodes)) {
        worth.alone[k] = size_term(scores, k, 0.0, scores.unattributed_variance);
        worth.twice[k] = highest_size(scores, k, 0.0);
        double with_law = scores.unattributed + worth.alone[k];
        double first = -INFINITY, second = -INFINITY;  // the best laws of any two systems
        for (int64_t s : range(systems)) {
            second = max(second, min(first, law(s, k)));
            first = max(first, law(s, k));
            each_jump(scores.configurations[s], [&](int64_t q, int64_t direction, int64_t after) {
                const double variance = scores.law_variance(s, after);
                const double size = worth.single(s, q, direction, k) =
                    scores.law_variance(s, q) == 0.0  // from rest the friction before is known
                        ? size_term(scores, k, scores.law_mean(s, after) - scores.law_mean(s, q), variance)
                        : highest_size(scores, k, variance);
                with_law = max(with_law, law(s, k) + size);
            });
        }
        worth.with_law[k] = max(with_law, first + second + worth.twice[k]);
    }
    return worth;
}

// The best sum of fits and of gains of accepted nodes, from node i to the end, over candidates after k: (m + 1, m + 1).
NewMatrix best_rest(FloatMatrix fit, Floats gain) {
    const auto nodes = fit.shape[0] - 1;
    NewMatrix rest({nodes, nodes}, -INFINITY);
    NewFloats from_node(nodes);
    for (int64_t i = nodes - 1; i >= 0; --i) {
        double best = rest(i, nodes - 1) = fit(i, nodes);
        for (int64_t k = nodes - 1; k > i; --k) {
            rest(i, k - 1) = best = max(best, fit(i, k) + gain[k] + from_node[k]);
        }
        from_node[i] = best;
    }
    return rest;
}

// `own` of Bounds; earned, (S, Q, 2, m + 1), is the gain of a jump from a configuration down or up at each node.
Table<double, 4> best_chains(const Scores& scores, Array<const double, 4> earned) {
    const auto [systems, configurations, nodes] = scores.stay.shape;
    Table<double, 4> own({systems, configurations, nodes, nodes}, -INFINITY);
    NewMatrix begun({configurations, nodes}, -INFINITY);  // best score of a sojourn that begins at the node
    for (int64_t s : range(systems)) {
        for (int64_t i = nodes - 1; i >= 0; --i) {
            for (int64_t q : range(configurations)) {
                double* best = &own(s, q, i, 0);
                for (int64_t number : range(STEPS)) {
                    const Step step = step_from(q, number);
                    if (!possible(step, configurations)) continue;
                    const double turn = scores.turn(s, step.before, step.direction);
                    const double* gain = &earned(s, step.before, step.direction, 0);
                    const double* law = sojourn_laws(scores, s, q, i, step);
                    const double* then = &begun(step.after, 0);
                    for (int64_t k : range(i + 1, nodes)) {
                        best[k - 1] = max(best[k - 1], law[k] + (turn + gain[k]) + then[k]);
                    }
                }
                best[nodes - 1] = scores.stay(s, q, i);
                for (auto k = nodes - 1; k > i; --k) best[k - 1] = max(best[k], best[k - 1]);
            }
            for (int64_t q : range(configurations)) begun(q, i) = own(s, q, i, i);
        }
    }
    return own;
}

// Prices that equal the costs of the path's jumps for their systems; where the path rejects, no jump has a net gain.
NewFloats prices(const Scores& scores, const Worth& worth, Integers start, Integers taken) {
    NewFloats price;
    for (double most : worth.with_law) price.push_back(-most);
    NewIntegers configuration(start.begin(), start.end()), since(start.size());
    for (int64_t node : range(1, taken.size() + 1)) {
        const auto action = taken[node - 1];
        if (action == REJECT) continue;
        if (action == NO_SYSTEM) {
            price[node] = -scores.unattributed;
            continue;
        }
        double cost = 0.0, systems = 0.0;
        each_step(scores.actions, action, [&](int64_t s, int64_t number) {
            const Step step = step_from(configuration[s], number);
            cost -= sojourn_laws(scores, s, configuration[s], since[s], step)[node] +
                    scores.turn(s, step.before, step.direction) +
                    worth.single(s, step.before, step.direction, node);
            systems += 1.0;
            configuration[s] = step.after, since[s] = node;
        });
        price[node] = cost / systems;
    }
    return price;
}

// Bounds with prices from a complete path: its start and the actions taken.
Bounds priced_bounds(const Scores& scores, const Worth& worth, Integers start, Integers taken) {
    const NewFloats price = prices(scores, worth, start, taken);
    Table<double, 4> earned(worth.single.shape, -INFINITY);
    NewFloats paid(price.size());
    for (int64_t k : range(1, price.size())) {
        paid[k] = max(-price[k], scores.unattributed + worth.alone[k]);
        // Two systems that jump at once share one size and one price: each gains at least half of both.
        const double least = 0.5 * (worth.twice[k] - price[k]);
        for (int64_t s : range(scores.configurations.size())) {
            each_jump(scores.configurations[s], [&](int64_t q, int64_t direction, int64_t) {
                // Against the level's sign a system jumps only together with another one.
                double size = worth.single(s, q, direction, k);
                size = scores.signs(k - 1, direction) ? max(size, least) : least;
                earned(s, q, direction, k) = size + price[k];
            });
        }
    }
    return {best_rest(scores.fit, paid), best_chains(scores, earned)};
}

// ---- states ----------------------------------------------------------------------------------------------------------
// States are expanded candidate by candidate, merged, and pruned by bounds. Sums are computed in a fixed order, so that
// results are the same on every machine.

constexpr double ROUNDING = 1e-6;    // bounds and scores add up the same terms in different orders [log-likelihood]
constexpr int64_t MOST_SYSTEMS = 8;  // of a wheel
constexpr size_t MOST_KEPT = 4;      // entries of a state

// The last accepted changepoint, and the configuration of each system with the node at which its sojourn began.
struct State {
    std::int16_t last = 0;
    array<std::int16_t, MOST_SYSTEMS> configuration{}, since{};

    bool operator==(const State&) const = default;
};
using StateHash = decltype([](const State& state) {
    return std::hash<std::string_view>{}({reinterpret_cast<const char*>(&state), sizeof state});
});

// A partial assignment: its state, score and node in the tree; mean and variance of each system's friction.
struct Entry {
    State state;
    int64_t node = 0;
    double score = 0.0;
    array<double, MOST_SYSTEMS> mean{}, variance{};
};

// The kept entries as a tree, and those of complete paths, best first; the number of entries expanded, and the highest
// bound of the extensions that the budget cut.
struct Expansion {
    struct Node {
        int64_t before, action;  // at a root the number of the start
    };
    vector<Node> tree;
    vector<Entry> leaves;
    int64_t expanded = 0;
    double lost = -INFINITY;
};

// An extension of an entry, and the bound of the complete paths through it.
struct Offer {
    int64_t entry, action;
    double score, bound;
};

// A state of the next stage with its best offers, best first.
struct Merged {
    State state;
    size_t kept = 0;
    array<int64_t, MOST_KEPT + 1> best{};  // and room for one to be dropped
};

// A step of a system: log-probability, change of the system's own bound, mean and variance of the jump.
struct Weighed {
    double law, own, mean, variance;
};

// Upper bound of the systems' scores after candidates up to k are decided.
double bound_of_systems(const Bounds& bounds, const State& state, int64_t systems, int64_t k) {
    double sum = 0.0;
    for (int64_t s : range(systems)) sum += bounds.own(s, state.configuration[s], state.since[s], k);
    return sum;
}

// Create an entry for each joint configuration at the window's begin.
vector<Entry> enter(const Scores& scores, int64_t starts, Expansion& found) {
    vector<Entry> entries(starts);
    for (int64_t number : range(starts)) {
        const NewIntegers start = start_of(number, scores.configurations);
        Entry& entry = entries[number];
        copy(start, entry.state.configuration.begin());
        for (int64_t s : range(start.size())) {
            entry.mean[s] = scores.law_mean(s, start[s]), entry.variance[s] = scores.law_variance(s, start[s]);
        }
        entry.node = number;
        found.tree.push_back({-1, number});
    }
    return entries;
}

// Compute each step of each system, see `list_offers`; a law of -inf where it is impossible.
void weigh_steps(const Scores& scores, const Bounds& bounds, const Entry& entry, int64_t k, Weighed* steps) {
    for (int64_t s : range(scores.configurations.size())) {
        const int64_t q = entry.state.configuration[s], since = entry.state.since[s];
        const double now = bounds.own(s, q, since, k);
        for (int64_t number = 0; number < STEPS; ++number, ++steps) {
            const Step step = step_from(q, number);
            if (!possible(step, scores.configurations[s])) {
                steps->law = -INFINITY;
                continue;
            }
            double law = sojourn_laws(scores, s, q, since, step)[k], mean = entry.mean[s], variance = entry.variance[s];
            if (step.skipped != 0) {
                mean = scores.law_mean(s, step.before), variance = scores.law_variance(s, step.before);
                const double hidden = mean - entry.mean[s];  // no candidate, so no detectable change of level
                law -= 0.5 * (hidden * hidden) / (variance + entry.variance[s] + scores.size_variance[k - 1]);
            }
            *steps = {law + scores.turn(s, step.before, step.direction), bounds.own(s, step.after, k, k) - now,
                      scores.law_mean(s, step.after) - mean, scores.law_variance(s, step.after) + variance};
        }
    }
}

// List the extensions of each entry at candidate k whose bound reaches the cutoff.
void list_offers(
    const Scores& scores, const Bounds& bounds, int64_t k, double cutoff, const vector<Entry>& entries,
    vector<Offer>& offers) {
    const auto systems = scores.configurations.size(), actions = scores.actions.shape[0];
    const double unattributed = scores.unattributed + size_term(scores, k, 0.0, scores.unattributed_variance);
    const double rest = bounds.rest(k, k);
    vector<Weighed> steps(systems * STEPS);
    offers.clear();
    for (int64_t at : range(entries.size())) {
        const Entry& entry = entries[at];
        const int64_t last = entry.state.last;
        const double by_own = bound_of_systems(bounds, entry.state, systems, k);  // without a step here
        if (by_own == -INFINITY) continue;
        const auto offer = [&](int64_t action, double score, double follows) {
            const double bound = score + follows;
            if (bound >= cutoff && (bound > -INFINITY || action == REJECT)) {
                offers.push_back({at, action, score, bound});
            }
        };
        const double fit = scores.fit(last, k);
        offer(REJECT, entry.score, bounds.rest(last, k) + by_own);
        offer(NO_SYSTEM, entry.score + (fit + unattributed), rest + by_own);
        weigh_steps(scores, bounds, entry, k, steps.data());
        for (int64_t a : range(NO_SYSTEM + 1, actions)) {
            const int64_t* action = &scores.actions(a, 0);
            const Weighed& one = steps[action[0] * STEPS + action[1]];
            const bool two = action[3] >= 0;
            const Weighed other = two ? steps[action[2] * STEPS + action[3]] : Weighed{};
            if (one.law == -INFINITY || other.law == -INFINITY) continue;
            if ((!two || action[1] % 2 == action[3] % 2) && !scores.signs(k - 1, action[1] % 2)) continue;
            const double score = entry.score + (fit + one.law) + other.law, own = by_own + one.own + other.own;
            const double size = size_term(scores, k, one.mean + other.mean, one.variance + other.variance);
            offer(a, score + size, rest + own);
        }
    }
}

// The state after an action at candidate k.
State moved(const Scores& scores, State state, int64_t k, int64_t action) {
    if (action == REJECT) return state;
    state.last = k;
    each_step(scores.actions, action, [&](int64_t s, int64_t number) {
        state.configuration[s] = step_from(state.configuration[s], number).after;
        state.since[s] = k;
    });
    return state;
}

// Group the first `room` offers that reach the cutoff by their state, and keep the best `kept` of each.
void merge(
    const Scores& scores, int64_t k, double cutoff, size_t room, const vector<Entry>& entries,
    const vector<Offer>& offers, size_t kept, vector<Merged>& merged) {
    std::unordered_map<State, size_t, StateHash> places(min(room, offers.size()));  // in `merged`
    size_t taken = 0;
    merged.clear();
    for (size_t offer = 0; offer < offers.size() && taken < room; ++offer) {
        const auto& [entry, action, score, bound] = offers[offer];
        if (bound < cutoff) continue;
        ++taken;
        const auto [place, is_new] = places.try_emplace(moved(scores, entries[entry].state, k, action), merged.size());
        if (is_new) merged.push_back({place->first});
        auto& [same, count, best] = merged[place->second];
        size_t rank = count;  // after those with an equal score
        for (; rank > 0 && offers[best[rank - 1]].score < score; --rank) best[rank] = best[rank - 1];
        best[rank] = offer;
        count = min(count + 1, kept);
    }
}

// Update the friction of each system by an action at candidate k: the law's mean and variance of the new friction are
// conditioned on the jump's size (a scalar Kalman step).
void learn(const Scores& scores, int64_t k, int64_t action, Entry& entry) {
    if (action == REJECT) return;
    double surprise = scores.size[k - 1], total = scores.size_variance[k - 1];
    each_step(scores.actions, action, [&](int64_t s, int64_t number) {
        const Step step = step_from(entry.state.configuration[s], number);
        double &mean = entry.mean[s], &variance = entry.variance[s];
        surprise += step.skipped == 0 ? mean : scores.law_mean(s, step.before);
        total += step.skipped == 0 ? variance : scores.law_variance(s, step.before);
        mean = scores.law_mean(s, step.after), variance = scores.law_variance(s, step.after);
        surprise -= mean;
        total += variance;
    });
    each_step(scores.actions, action, [&](int64_t s, int64_t) {
        const double share = entry.variance[s] / total;
        entry.mean[s] += share * surprise;
        entry.variance[s] *= 1.0 - share;
    });
}


// Expand all states candidate by candidate. Extensions are dropped with a bound below the cutoff, and those of the
// lowest bounds beyond the budget of a candidate; `kept` entries are kept of each state.
Expansion expand(const Scores& scores, const Bounds& bounds, double cutoff, int64_t budget, size_t kept) {
    const auto candidates = scores.signs.shape[0], systems = scores.configurations.size();
    REQUIRE(systems <= MOST_SYSTEMS);
    int64_t starts = 1;
    for (auto configurations : scores.configurations) starts *= configurations;
    const auto room = static_cast<size_t>(max(budget, starts));
    Expansion found;
    vector<Entry> entries = enter(scores, starts, found), following;
    vector<Offer> offers;
    vector<Merged> merged;
    for (int64_t k : range(1, candidates + 1)) {
        list_offers(scores, bounds, k, cutoff, entries, offers);
        found.expanded += static_cast<int64_t>(entries.size());
        double stage_cutoff = cutoff;
        if (offers.size() > room) {  // a better path may be lost: the highest bound that is cut limits by how much
            NewFloats reached;
            for (const Offer& offer : offers) reached.push_back(offer.bound);
            const auto first = reached.end() - room;
            nth_element(reached, first);
            stage_cutoff = *first;
            found.lost = max(found.lost, *max_element(reached.begin(), first));
        }
        merge(scores, k, stage_cutoff, room, entries, offers, kept, merged);
        following.clear();
        for (const Merged& one : merged) {
            for (size_t rank : range(one.kept)) {
                const Offer& offer = offers[one.best[rank]];
                Entry& entry = following.emplace_back(entries[offer.entry]);
                learn(scores, k, offer.action, entry);
                found.tree.push_back({entry.node, offer.action});
                entry.state = one.state;
                entry.score = offer.score;
                entry.node = found.tree.size() - 1;
            }
        }
        swap(entries, following);
    }
    for (auto& [state, node, score, mean, variance] : entries) {
        score += scores.fit(state.last, candidates + 1);
        for (int64_t s : range(systems)) score += scores.stay(s, state.configuration[s], state.since[s]);
    }
    stable_sort(entries, std::greater(), &Entry::score);
    found.leaves = move(entries);
    return found;
}

// ---- levels between candidates (see rwa_monitor/changepoints/estimation.py) -----------------------------------------

constexpr double PREFERENCE = 1e-6;     // log-likelihood per slot from the detected one: decides ties in gaps

// Σ (z - level - slope x)² of a segment about its own level.
double squared_error(const Sums& sum, double slope) {
    const double y = sum.z - slope * sum.x;
    const double yy = sum.zz - 2.0 * slope * sum.xz + slope * slope * sum.xx;
    return max(yy - y * y / max(sum.n, 1.0), 0.0);
}

// The log-likelihood of one level between all pairs of nodes, integrated over a flat prior of width `width`: each level
// has a penalty log(width √(n / 2π variance)), so that a jump must gain more than the penalty of its parameter.
NewMatrix fit_table(FloatCube pairs, double slope, double variance, double width) {
    const int64_t count = pairs.shape[1];
    const double log_range = log(width);
    NewMatrix table({count, count});
    for (int64_t i : range(count)) {
        for (int64_t j : range(i + 1, count)) {
            const Sums sum = Sums::read(&pairs(0, i, j), count * count);
            if (!(sum.n > 0.0)) continue;
            const double charge = log_range - 0.5 * log(2.0 * M_PI * variance / sum.n);
            table(i, j) = -squared_error(sum, slope) / (2.0 * variance) - max(charge, 0.0);
        }
    }
    return table;
}

// Move each inner node to the best split of its two intervals within its reach, and no further than half way to a
// neighbour.
NewIntegers refine_nodes(Integers nodes, Integers reach, double slope, double variance, const SumArrays& sums) {
    const int64_t count = nodes.size() - 2;
    NewIntegers refined(count);
    vector<Sums> prefix;
    for (const int64_t slot : nodes) prefix.push_back(prefix_moments(slot, sums));
    for (int64_t i : range(count)) {
        const int64_t left = nodes[i], at = nodes[i + 1], right = nodes[i + 2];
        const int64_t low = max(left + (at - left) / 2, at - reach[i]);  // exclusive unless it is `at`
        const int64_t high = min(at + (right - at) / 2, at + reach[i]);
        double best = -INFINITY;
        refined[i] = at;
        for (int64_t trial = min(low + 1, at); trial <= high; ++trial) {
            const Sums here = prefix_moments(trial, sums);
            double error = squared_error(moments_between(prefix[i], here, sums.centre), slope);
            error += squared_error(moments_between(here, prefix[i + 2], sums.centre), slope);
            const double score = -error / (2.0 * variance) - PREFERENCE * abs(trial - at);
            if (score > best) best = score, refined[i] = trial;
        }
    }
    return refined;
}

NewMatrix chain_of(FloatCube pairs, Integers nodes) {
    NewMatrix chain({pairs.shape[0], nodes.size() - 1});
    for (int64_t k : range(pairs.shape[0])) {
        for (int64_t i = 0; i + 1 < nodes.size(); ++i) chain(k, i) = pairs(k, nodes[i], nodes[i + 1]);
    }
    return chain;
}

// ---- whole paths: search, back-tracking, full likelihood -------------------------------------------------------------

using IndexTable = Table<int64_t, 2>;

// Paths, best first: configurations at the window's begin, actions; entries expanded, highest bound that was cut.
struct Found {
    NewFloats score;
    IndexTable start, taken;
    int64_t states;
    double lost;
};

// The best of all expanded paths, traced back in the tree.
Found search_once(
    const Scores& scores, const Bounds& bounds, double cutoff, int64_t budget, size_t kept, int64_t paths) {
    const Expansion all = expand(scores, bounds, cutoff, budget, kept);
    const int64_t systems = scores.configurations.size(), candidates = scores.signs.shape[0];
    const int64_t count = min<int64_t>(all.leaves.size(), paths);
    Found found{
        NewFloats(count), IndexTable({count, systems}), IndexTable({count, candidates}), all.expanded, all.lost};
    for (int64_t path : range(count)) {
        found.score[path] = all.leaves[path].score;
        const Expansion::Node* node = &all.tree[all.leaves[path].node];
        for (auto k = candidates - 1; k >= 0; --k, node = &all.tree[node->before]) found.taken(path, k) = node->action;
        const NewIntegers start = start_of(node->action, scores.configurations);
        copy(start, found.start.row(path).begin());
    }
    return found;
}

// Search twice: with a narrow beam for a good path and the prices of its jumps, then for the best of all. With extreme
// values the budget of the full search may cut every path; then the path of the narrow beam is returned.
tuple<NewFloats, IndexTable, IndexTable, int64_t, bool> find_paths(
    const Scores& scores, int64_t paths, double margin, int64_t budget) {
    const Worth worth = worth_of(scores);
    const auto [systems, configurations, nodes] = scores.stay.shape;
    const Bounds free{best_rest(scores.fit, worth.with_law), Table<double, 4>({systems, configurations, nodes, nodes})};
    Found quick = search_once(scores, free, -INFINITY, min(paths, budget), 1, 1);
    if (quick.score.empty()) return {};  // nothing is possible
    const Bounds priced = priced_bounds(scores, worth, quick.start.row(0), quick.taken.row(0));
    const double cutoff = quick.score[0] - (margin + ROUNDING);
    Found full = search_once(scores, priced, cutoff, budget, paths > 1 ? MOST_KEPT : 1, paths);
    const bool none = full.score.empty(), pruned = none || full.lost > full.score[0];
    Found& best = none ? quick : full;
    return {best.score, best.start, best.taken, quick.states + full.states, pruned};
}

// The part of a path's score from laws and from jumps of no system, without fits and sizes.
double add_up_laws(const Scores& scores, Integers start, Integers taken) {
    NewIntegers configuration(start.begin(), start.end()), since(start.size());
    double total = 0.0, staying = 0.0;
    for (int64_t node : range(1, taken.size() + 1)) {
        const auto action = taken[node - 1];
        if (action == NO_SYSTEM) total += scores.unattributed;
        each_step(scores.actions, action, [&](int64_t s, int64_t number) {
            const Step step = step_from(configuration[s], number);
            total += sojourn_laws(scores, s, configuration[s], since[s], step)[node];
            total += scores.turn(s, step.before, step.direction);
            configuration[s] = step.after, since[s] = node;
        });
    }
    for (int64_t s : range(start.size())) staying += scores.stay(s, configuration[s], since[s]);
    return total + staying;
}

using NewPath = PathOf<NewIntegers>;

// A path as sojourns; the accepted candidates as nodes, and both ends of the window; up to two systems at each
// candidate and their directions, (m, 2): in first place also REJECTED or UNATTRIBUTED, in second REJECTED for none.
tuple<NewPath, NewIntegers, IndexTable, IndexTable> switching_path(
    IntegerMatrix actions, Integers index, Integers start, Integers taken) {
    IndexTable system({taken.size(), 2}, REJECTED), direction({taken.size(), 2});
    vector<NewIntegers> configurations, starts(start.size(), {0});
    for (int64_t q : start) configurations.push_back({q});
    NewPath path;
    NewIntegers nodes{0};
    for (int64_t k : range(taken.size())) {
        if (taken[k] == REJECT) continue;
        nodes.push_back(k + 1);
        if (taken[k] == NO_SYSTEM) {
            system(k, 0) = UNATTRIBUTED;
            path.unattributed.push_back(index[k]);
            continue;
        }
        for (int64_t place : range(2)) {
            const auto who = actions(taken[k], 2 * place);
            if (who < 0) continue;
            const Step step = step_from(configurations[who].back(), actions(taken[k], 2 * place + 1));
            system(k, place) = who, direction(k, place) = step.after - step.before;
            if (step.skipped != 0) {  // its slot is not known; the level implies right after the sojourn's begin
                starts[who].push_back(starts[who].back() + 1);
                configurations[who].push_back(step.before);
            }
            starts[who].push_back(index[k]);
            configurations[who].push_back(step.after);
        }
    }
    nodes.push_back(taken.size() + 1);
    for (int64_t s : range(start.size())) {
        path.configurations.insert(path.configurations.end(), configurations[s].begin(), configurations[s].end());
        path.starts.insert(path.starts.end(), starts[s].begin(), starts[s].end());
        path.sojourns.push_back(starts[s].size());
    }
    return {path, nodes, system, direction};
}

// The full likelihood of a path: switching path, systems and directions as from `switching_path`; slots at which its
// segments begin and end, and their statistics; log-likelihood of the samples, without and with that of the laws.
tuple<NewPath, IndexTable, IndexTable, NewIntegers, NewMatrix, double, double> weigh(
    const Scores& scores, Integers start, Integers taken, Integers index, FloatCube pairs, int64_t slots,
    const Cases& cases, double variance, double scatter) {
    auto [path, borders, system, direction] = switching_path(scores.actions, index, start, taken);
    auto statistics = chain_of(pairs, borders);
    for (auto& node : borders) node = node == 0 ? 0 : node > index.size() ? slots : index[node - 1];
    const double log_evidence = evidence_of_cases(
        {path.configurations, path.starts, path.sojourns, path.unattributed}, borders, statistics, cases, variance,
        scatter);
    const double score = add_up_laws(scores, start, taken) + log_evidence;
    return {path, system, direction, borders, statistics, log_evidence, score};
}

}  // namespace

STAGE(assignment, REJECT, NO_SYSTEM, STEPS, REJECTED, UNATTRIBUTED, PREFERENCE, fit_table, refine_nodes, find_paths,
      add_up_laws, weigh)

}  // namespace rwa
