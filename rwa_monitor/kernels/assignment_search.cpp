// States expanded candidate by candidate, merged, pruned by bounds. Sums are taken in a fixed order, so that results are
// the same on every machine.
#include "assignment.hpp"

namespace rwa {
namespace {

constexpr double SLACK = 1e-9;               // of a first sieve, which adds up in another order [log-likelihood]
constexpr int64_t MOST_SYSTEMS = 8;          // of a wheel
constexpr int64_t MOST_KEPT = 4;             // entries of a state

// The last accepted changepoint, and the configuration of each system with the node at which its sojourn began.
struct State {
    std::int16_t last = 0;
    array<std::int16_t, MOST_SYSTEMS> configuration{}, since{};

    bool operator==(const State& other) const {
        return last == other.last && configuration == other.configuration && since == other.since;
    }
};

// A partial assignment: its state, score and node in the tree; mean and variance of each system's friction.
struct Entry {
    State state;
    int64_t node;
    double score;
    array<double, MOST_SYSTEMS> mean{}, variance{};
};

// An extension of an entry, and the bound of the complete paths through it.
struct Offer {
    int64_t entry, action;
    double score, bound;
};

// A state of the next stage with its best offers, best first.
struct Merged {
    State state;
    int64_t kept = 0;
    array<int64_t, MOST_KEPT> best{};
};

// What a step of a system is worth: log-probability, change of its own bound, mean and variance of the jump.
struct Weighed {
    double law, own, mean, variance;
};

// What the systems may still do when candidates up to k are decided.
double bound_of_systems(const Bounds& bounds, const State& state, int64_t systems, int64_t k) {
    double sum = 0.0;
    for (int64_t s = 0; s < systems; ++s) sum += bounds.own(s, state.configuration[s], state.since[s], k);
    return sum;
}

// Enter all configurations that the systems may be in at the window's begin.
vector<Entry> enter(const Scores& scores, const Bounds& bounds, double cutoff, int64_t starts, Expansion& found) {
    const auto systems = scores.configurations.size();
    vector<Entry> entries;
    for (int64_t number = 0; number < starts; ++number) {
        const NewIntegers start = start_of(number, scores.configurations);
        Entry entry;
        double by_own = bounds.rest_fit(0, 0);
        for (int64_t s = 0; s < systems; ++s) {
            entry.state.configuration[s] = start[s];
            entry.mean[s] = scores.law_mean(s, start[s]), entry.variance[s] = scores.law_variance(s, start[s]);
            by_own += bounds.own(s, start[s], 0, 0);
        }
        if (!(min(bounds.rest(0, 0), by_own) >= cutoff)) continue;
        entry.score = 0.0;
        entry.node = found.tree.size();
        entries.push_back(entry);
        found.tree.push_back({-1, number});
    }
    return entries;
}

// Weigh each step of each system, see `list_offers`; a law of -inf where it is impossible.
void weigh_steps(const Scores& scores, const Bounds& bounds, const Entry& entry, int64_t k, Weighed* steps) {
    for (int64_t s = 0; s < scores.configurations.size(); ++s) {
        const int64_t q = entry.state.configuration[s], since = entry.state.since[s];
        const double now = bounds.own(s, q, since, k);
        for (int64_t number = 0; number < STEPS; ++number, ++steps) {
            const Step step = step_from(q, number);
            if (!possible(step, scores.configurations[s])) {
                steps->law = -INFINITE;
                continue;
            }
            double law = sojourn_laws(scores, s, q, since, step)[k], mean = entry.mean[s], variance = entry.variance[s];
            if (step.skipped != 0) {
                mean = scores.law_mean(s, step.before), variance = scores.law_variance(s, step.before);
                const double hidden = mean - entry.mean[s];  // no candidate, so no change of level that could be seen
                law -= 0.5 * (hidden * hidden) / (variance + entry.variance[s] + scores.size_variance[k - 1]);
            }
            *steps = {law + scores.turn(s, step.before, step.direction), bounds.own(s, step.after, k, k) - now,
                      scores.law_mean(s, step.after) - mean, scores.law_variance(s, step.after) + variance};
        }
    }
}

// List what may happen to each entry at candidate k and is within reach of the best.
void list_offers(
    const Scores& scores, const Bounds& bounds, int64_t k, double cutoff, const vector<Entry>& entries,
    vector<Offer>& offers) {
    const auto systems = scores.configurations.size(), actions = scores.actions.shape[0];
    const double unattributed = scores.unattributed + size_term(scores, k, 0.0, scores.unattributed_variance);
    const double highest = size_term(scores, k, scores.size[k - 1], 0.0);
    const double rest = bounds.rest(k, k), rest_fit = bounds.rest_fit(k, k);
    vector<Weighed> steps(systems * STEPS);
    offers.clear();
    for (std::size_t at = 0; at < entries.size(); ++at) {
        const Entry& entry = entries[at];
        const int64_t last = entry.state.last;
        const double by_own = bound_of_systems(bounds, entry.state, systems, k);  // without a step here
        if (by_own == -INFINITE) continue;
        const auto offer = [&](int64_t action, double score, double follows) {
            const double bound = score + follows;
            if (bound >= cutoff && (bound > -INFINITE || action == REJECT)) {
                offers.push_back({static_cast<int64_t>(at), action, score, bound});
            }
        };
        const double fit = scores.fit(last, k);
        offer(REJECT, entry.score, min(bounds.rest(last, k), bounds.rest_fit(last, k) + by_own));
        offer(NO_SYSTEM, entry.score + (fit + unattributed), min(rest, rest_fit + by_own));
        // Most steps end here, before they are weighed: not even a perfect size would bring them within reach.
        const double best = entry.score + fit + highest + rest;
        if (best < cutoff - SLACK) continue;
        weigh_steps(scores, bounds, entry, k, steps.data());
        for (int64_t a = NO_SYSTEM + 1; a < actions; ++a) {
            const int64_t* action = &scores.actions(a, 0);
            const Weighed& one = steps[action[0] * STEPS + action[1]];
            if (best + one.law < cutoff - SLACK || one.law == -INFINITE) continue;
            const bool two = action[3] >= 0;
            if ((!two || action[1] % 2 == action[3] % 2) && !scores.signs(k - 1, action[1] % 2)) continue;
            double score = entry.score + (fit + one.law), own = by_own + one.own;
            double mean = one.mean, variance = one.variance;
            if (two) {
                const Weighed& other = steps[action[2] * STEPS + action[3]];
                if (other.law == -INFINITE) continue;
                score += other.law;
                own += other.own;
                mean += other.mean;
                variance += other.variance;
            }
            const double follows = min(rest, rest_fit + own);
            offer(a, score + size_term(scores, k, mean, variance), follows);
        }
    }
}

// The state that an action at candidate k makes of one.
State moved(const Scores& scores, State state, int64_t k, int64_t action) {
    if (action == REJECT) return state;
    state.last = k;
    each_step(scores.actions, action, [&](int64_t s, int64_t number) {
        state.configuration[s] = step_from(state.configuration[s], number).after;
        state.since[s] = k;
    });
    return state;
}

// Scatters states over a table (FNV-1a).
std::uint64_t hash(const State& state, int64_t systems) {
    std::uint64_t key = 1469598103934665603u;
    const auto add = [&key](std::int16_t value) { key = (key ^ static_cast<std::uint64_t>(value)) * 1099511628211u; };
    add(state.last);
    for (int64_t s = 0; s < systems; ++s) add(state.configuration[s]), add(state.since[s]);
    return (key ^ (key >> 29)) >> 1;
}

// Put an offer among the best of its state, after those that score as much.
void keep(const vector<Offer>& offers, int64_t offer, int64_t most, Merged& merged) {
    auto& [state, kept, best] = merged;
    const double score = offers[offer].score;
    if (kept < most) {
        ++kept;
    } else if (!(score > offers[best[most - 1]].score)) {
        return;
    }
    auto place = kept - 1;
    for (; place > 0 && offers[best[place - 1]].score < score; --place) best[place] = best[place - 1];
    best[place] = offer;
}

// Bring the first `room` offers that reach the cutoff together by state, which `table` finds by its hash.
void merge(
    const Scores& scores, int64_t k, double cutoff, std::size_t room, const vector<Entry>& entries,
    const vector<Offer>& offers, int64_t kept, NewIntegers& table, vector<Merged>& merged) {
    std::size_t slots = 16, taken = 0;
    while (slots < 2 * min(room, offers.size())) slots *= 2;
    table.assign(slots, -1);
    merged.clear();
    for (std::size_t offer = 0; offer < offers.size() && taken < room; ++offer) {
        if (offers[offer].bound < cutoff) continue;
        ++taken;
        const State state = moved(scores, entries[offers[offer].entry].state, k, offers[offer].action);
        auto place = hash(state, scores.configurations.size()) & (slots - 1);
        while (table[place] >= 0 && !(merged[table[place]].state == state)) place = (place + 1) & (slots - 1);
        if (table[place] < 0) {
            table[place] = merged.size();
            merged.push_back({state});
        }
        keep(offers, offer, kept, merged[table[place]]);
    }
}

// Change the friction of each system by an action at candidate k. The jump's size gives the new friction: the law's
// mean and variance are conditioned on it (a scalar Kalman step).
void learn(const Scores& scores, const State& before, int64_t k, int64_t action, Entry& entry) {
    if (action == REJECT) return;
    double surprise = scores.size[k - 1], total = scores.size_variance[k - 1];
    each_step(scores.actions, action, [&](int64_t s, int64_t number) {
        const Step step = step_from(before.configuration[s], number);
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

}  // namespace

Expansion expand(const Scores& scores, const Bounds& bounds, double cutoff, int64_t budget, int64_t kept) {
    const auto candidates = scores.signs.shape[0], systems = scores.configurations.size();
    REQUIRE(systems <= MOST_SYSTEMS && kept <= MOST_KEPT);
    int64_t starts = 1;
    for (auto configurations : scores.configurations) starts *= configurations;
    const auto room = static_cast<std::size_t>(max(budget, starts));
    Expansion found;
    vector<Entry> entries = enter(scores, bounds, cutoff, starts, found), following;
    vector<Offer> offers;
    NewIntegers table;
    vector<Merged> merged;
    for (int64_t k = 1; k <= candidates; ++k) {
        list_offers(scores, bounds, k, cutoff, entries, offers);
        found.expanded += static_cast<int64_t>(entries.size());
        double stage_cutoff = cutoff;
        if (offers.size() > room) {  // the best that is cut shows whether the search missed anything
            NewFloats reached;
            for (const Offer& offer : offers) reached.push_back(offer.bound);
            const auto first = reached.end() - room;
            nth_element(reached.begin(), first, reached.end());
            stage_cutoff = *first;
            found.lost = max(found.lost, *max_element(reached.begin(), first));
        }
        merge(scores, k, stage_cutoff, room, entries, offers, kept, table, merged);
        following.clear();
        for (const Merged& one : merged) {
            for (int64_t rank = 0; rank < one.kept; ++rank) {
                const Offer& offer = offers[one.best[rank]];
                const Entry& before = entries[offer.entry];
                Entry& entry = following.emplace_back(before);
                learn(scores, before.state, k, offer.action, entry);
                entry.state = one.state;
                entry.score = offer.score;
                entry.node = found.tree.size();
                found.tree.push_back({before.node, offer.action});
            }
        }
        swap(entries, following);
    }
    for (const auto& [state, node, score, mean, variance] : entries) {
        double total = score + scores.fit(state.last, candidates + 1);
        for (int64_t s = 0; s < systems; ++s) total += scores.stay(s, state.configuration[s], state.since[s]);
        found.last.push_back(node);
        found.score.push_back(total);
    }
    return found;
}

}  // namespace rwa
