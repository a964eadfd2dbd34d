// States expanded candidate by candidate, merged, pruned by bounds. A state is a row of small integers: the node of the
// last accepted changepoint, then for each system its configuration and the node at which its sojourn began. Sums are
// taken in a fixed order, so that results are the same on every machine.
#include "assignment.hpp"

#include <algorithm>

namespace rwa {
namespace {

constexpr std::size_t WORTH_THINNING = 500;  // offers from which it pays to leave out those that others have beaten
constexpr double SLACK = 1e-9;               // of a first sieve, which adds up in another order [log-likelihood]

using Row = const std::int16_t*;

// Entries of a stage: states, scores, nodes in the tree, friction of each system (mean, variance).
struct Entries {
    std::vector<std::int16_t> rows;
    std::vector<double> score, friction;
    std::vector<std::int32_t> node;
};

// An extension of an entry, and the bound of the complete paths through it.
struct Offer {
    std::int32_t entry, action;
    double score, bound;
};

// Distinct states of the next stage, each with its best offers, best first; `table` finds a state by its hash.
struct States {
    std::vector<std::int32_t> table, kept, best;
    std::vector<std::int16_t> rows;
};

// What a step of a system is worth: log-probability, change of its own bound, mean and variance of the jump.
struct Weighed {
    double law, own, mean, variance;
};

// An upper bound of what can follow a state when candidates up to k are decided.
double bound_of(const Bounds& bounds, Row row, int64_t systems, int64_t k) {
    double by_own = bounds.rest_fit(row[0], k);
    for (int64_t s = 0; s < systems; ++s) by_own += bounds.own(s, row[1 + 2 * s], row[2 + 2 * s], k);
    return std::min(bounds.rest(row[0], k), by_own);
}

// Enter all configurations that the systems may be in at the window's begin.
void enter(
    const Scores& scores, const Bounds& bounds, double cutoff, int64_t starts, Entries& entries, Expansion& tree) {
    const auto systems = scores.configurations.size();
    std::vector<std::int16_t> row(1 + 2 * systems);
    for (int64_t start = 0; start < starts; ++start) {
        for (int64_t s = systems - 1, rest = start; s >= 0; rest /= scores.configurations[s--]) {
            row[1 + 2 * s] = static_cast<std::int16_t>(rest % scores.configurations[s]);
        }
        if (!(bound_of(bounds, row.data(), systems, 0) >= cutoff)) continue;
        entries.rows.insert(entries.rows.end(), row.begin(), row.end());
        for (int64_t s = 0; s < systems; ++s) {
            entries.friction.push_back(scores.law_mean(s, row[1 + 2 * s]));
            entries.friction.push_back(scores.law_variance(s, row[1 + 2 * s]));
        }
        entries.score.push_back(0.0);
        entries.node.push_back(static_cast<std::int32_t>(tree.parent.size()));
        tree.parent.push_back(-1);
        tree.action.push_back(static_cast<std::int32_t>(start));
    }
}

// Weigh each step of each system, see `list_offers`; a law of -inf where it is impossible.
void weigh_steps(
    const Scores& scores, const Bounds& bounds, Row row, const double* friction, int64_t k, Weighed* steps) {
    for (int64_t s = 0; s < scores.configurations.size(); ++s) {
        const int64_t q = row[1 + 2 * s], since = row[2 + 2 * s];
        const double now = bounds.own(s, q, since, k), now_mean = friction[2 * s], now_variance = friction[2 * s + 1];
        for (int64_t number = 0; number < STEPS; ++number, ++steps) {
            const Step step = step_from(q, number);
            if (!possible(step, scores.configurations[s])) {
                steps->law = -INFINITE;
                continue;
            }
            double law = sojourn_laws(scores, s, q, since, step)[k], mean = now_mean, variance = now_variance;
            if (step.skipped != 0) {
                mean = scores.law_mean(s, step.before), variance = scores.law_variance(s, step.before);
                if (scores.sized) {  // no candidate, so no change of level that could be seen
                    const double hidden = mean - now_mean;
                    law -= 0.5 * (hidden * hidden) / (variance + now_variance + scores.size_variance[k - 1]);
                }
            }
            *steps = {law + scores.turn(s, step.before, step.direction), bounds.own(s, step.after, k, k) - now,
                      scores.law_mean(s, step.after) - mean, scores.law_variance(s, step.after) + variance};
        }
    }
}

// The bounds of offers, the n lowest before all others, and the lowest of these in place n.
std::vector<double> divided_bounds(const std::vector<Offer>& offers, std::size_t n) {
    std::vector<double> bounds;
    bounds.reserve(offers.size());
    for (const Offer& offer : offers) bounds.push_back(offer.bound);
    std::nth_element(bounds.begin(), bounds.begin() + n, bounds.end());
    return bounds;
}

// List what may happen to each entry at candidate k and is within reach of the best. All of the `wanted` best by their
// bound are among them, those that tie with the last of these too; others are left out while the list grows.
void list_offers(
    const Scores& scores, const Bounds& bounds, int64_t k, double cutoff, std::size_t wanted, const Entries& entries,
    std::vector<Offer>& offers) {
    const auto systems = scores.configurations.size(), width = 1 + 2 * systems, actions = scores.actions.extent(0);
    const double unattributed = scores.priors[1] + size_term(scores, k, 0.0, scores.unattributed_variance);
    const double highest = size_term(scores, k, scores.size[k - 1], 0.0);
    const double rest = bounds.rest(k, k), rest_fit = bounds.rest_fit(k, k);
    std::vector<Weighed> steps(systems * STEPS);
    offers.clear();
    std::size_t full = wanted + std::max(wanted, WORTH_THINNING);
    for (std::size_t at = 0; at < entries.score.size(); ++at) {
        if (offers.size() >= full) {  // most of what follows is then out of reach before it is weighed
            cutoff = std::max(cutoff, divided_bounds(offers, offers.size() - wanted)[offers.size() - wanted]);
            const auto beaten = [cutoff](const Offer& offer) { return !(offer.bound >= cutoff); };
            offers.erase(std::remove_if(offers.begin(), offers.end(), beaten), offers.end());
            full = offers.size() + std::max(wanted, WORTH_THINNING);
        }
        const Row row = &entries.rows[at * width];
        const double so_far = entries.score[at];
        double by_own = 0.0;  // what the systems may still do without a step here
        for (int64_t s = 0; s < systems; ++s) by_own += bounds.own(s, row[1 + 2 * s], row[2 + 2 * s], k);
        if (by_own == -INFINITE) continue;
        const auto offer = [&, at](int64_t action, double score, double follows) {
            const double bound = score + follows;
            if (bound >= cutoff && (bound > -INFINITE || action == REJECT)) {
                offers.push_back({static_cast<std::int32_t>(at), static_cast<std::int32_t>(action), score, bound});
            }
        };
        const double fit = scores.fit(row[0], k);
        offer(REJECT, so_far + scores.priors[0], std::min(bounds.rest(row[0], k), bounds.rest_fit(row[0], k) + by_own));
        offer(NO_SYSTEM, so_far + (fit + unattributed), std::min(rest, rest_fit + by_own));
        // Most steps end here, before they are weighed: not even a perfect size would bring them within reach.
        const double best = so_far + fit + highest + rest;
        if (best < cutoff - SLACK) continue;
        weigh_steps(scores, bounds, row, entries.friction.data() + 2 * systems * at, k, steps.data());
        for (int64_t a = NO_SYSTEM + 1; a < actions; ++a) {
            const int64_t* action = &scores.actions(a, 0);
            const Weighed& one = steps[action[0] * STEPS + action[1]];
            if (best + one.law < cutoff - SLACK || one.law == -INFINITE) continue;
            const bool two = action[3] >= 0;
            if ((!two || action[1] % 2 == action[3] % 2) && !scores.signs(k - 1, action[1] % 2)) continue;
            double score = so_far + (fit + one.law), own = by_own + one.own, mean = one.mean, variance = one.variance;
            if (two) {
                const Weighed& other = steps[action[2] * STEPS + action[3]];
                if (other.law == -INFINITE) continue;
                score += other.law + scores.priors[2];
                own += other.own;
                mean += other.mean;
                variance += other.variance;
            }
            const double follows = std::min(rest, rest_fit + own);
            if (score + highest + follows < cutoff) continue;
            offer(a, score + size_term(scores, k, mean, variance), follows);
        }
    }
}

// Write the state that an action at candidate k makes of one.
void move(const Scores& scores, Row row, int64_t k, int64_t action, std::int16_t* out) {
    std::copy_n(row, 1 + 2 * scores.configurations.size(), out);
    if (action == REJECT) return;
    out[0] = static_cast<std::int16_t>(k);
    for (int place : {0, 2}) {
        const auto s = scores.actions(action, place);
        if (s < 0) continue;
        out[1 + 2 * s] = static_cast<std::int16_t>(step_from(row[1 + 2 * s], scores.actions(action, place + 1)).after);
        out[2 + 2 * s] = static_cast<std::int16_t>(k);
    }
}

// Scatters states over a table (FNV-1a over the columns).
std::uint64_t hash(Row row, int64_t width) {
    std::uint64_t key = 1469598103934665603u;
    for (int64_t column = 0; column < width; ++column) {
        key = (key ^ static_cast<std::uint64_t>(row[column])) * 1099511628211u;
    }
    return (key ^ (key >> 29)) >> 1;
}

// Put an offer among the best of its state, after those that score as much.
void keep(const std::vector<Offer>& offers, std::int32_t offer, std::int32_t* best, std::int32_t& kept, int64_t most) {
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

// Bring the first `room` offers that reach the cutoff together by state.
void merge(
    const Scores& scores, int64_t k, double cutoff, std::size_t room, const Entries& entries,
    const std::vector<Offer>& offers, int64_t kept, States& states) {
    const auto width = 1 + 2 * scores.configurations.size();
    std::size_t slots = 16, taken = 0;
    while (slots < 2 * std::min(room, offers.size())) slots *= 2;
    states.table.assign(slots, -1);
    states.rows.clear(), states.kept.clear(), states.best.clear();
    for (std::size_t offer = 0; offer < offers.size() && taken < room; ++offer) {
        if (offers[offer].bound < cutoff) continue;
        ++taken;
        const std::size_t found = states.kept.size();
        states.rows.resize((found + 1) * width);
        std::int16_t* row = &states.rows[found * width];
        move(scores, &entries.rows[offers[offer].entry * width], k, offers[offer].action, row);
        auto place = hash(row, width) & (slots - 1);
        while (states.table[place] >= 0 && !std::equal(row, row + width, &states.rows[states.table[place] * width])) {
            place = (place + 1) & (slots - 1);
        }
        if (states.table[place] < 0) {
            states.table[place] = static_cast<std::int32_t>(found);
            states.kept.push_back(0);
            states.best.resize((found + 1) * kept);
        }
        const auto state = states.table[place];
        keep(offers, static_cast<std::int32_t>(offer), &states.best[state * kept], states.kept[state], kept);
    }
}

// Change the friction of each system by an action at candidate k. The jump's size gives the new friction: the law's
// mean and variance are conditioned on it (a scalar Kalman step).
void learn(const Scores& scores, Row row, int64_t k, int64_t action, double* friction) {
    if (action == REJECT) return;
    double surprise = scores.size[k - 1], total = scores.size_variance[k - 1];
    for (int place : {0, 2}) {
        const auto s = scores.actions(action, place);
        if (s < 0) continue;
        const Step step = step_from(row[1 + 2 * s], scores.actions(action, place + 1));
        double *mean = &friction[2 * s], *variance = mean + 1;
        surprise += step.skipped == 0 ? *mean : scores.law_mean(s, step.before);
        total += step.skipped == 0 ? *variance : scores.law_variance(s, step.before);
        *mean = scores.law_mean(s, step.after), *variance = scores.law_variance(s, step.after);
        surprise -= *mean;
        total += *variance;
    }
    if (!scores.sized) return;
    for (int place : {0, 2}) {
        const auto s = scores.actions(action, place);
        if (s < 0) continue;
        const double share = friction[2 * s + 1] / total;
        friction[2 * s] += share * surprise;
        friction[2 * s + 1] *= 1.0 - share;
    }
}

}  // namespace

Expansion expand(const Scores& scores, const Bounds& bounds, double cutoff, int64_t budget, int64_t kept) {
    const auto candidates = scores.signs.extent(0), systems = scores.configurations.size(), width = 1 + 2 * systems;
    int64_t starts = 1;
    for (auto configurations : scores.configurations) starts *= configurations;
    const auto room = static_cast<std::size_t>(std::max(budget, starts));
    Expansion found;
    Entries entries, following;
    std::vector<Offer> offers;
    States states;
    enter(scores, bounds, cutoff, starts, entries, found);
    for (int64_t k = 1; k <= candidates; ++k) {
        // One more than there is room for: the best that is cut shows whether the search missed anything.
        list_offers(scores, bounds, k, cutoff, room + 1, entries, offers);
        found.expanded += static_cast<int64_t>(entries.score.size());
        double stage_cutoff = cutoff;
        if (offers.size() > room) {
            const auto divided = divided_bounds(offers, offers.size() - room);
            const auto first = divided.end() - static_cast<std::ptrdiff_t>(room);
            stage_cutoff = *first;
            found.lost = std::max(found.lost, *std::max_element(divided.begin(), first));
        }
        merge(scores, k, stage_cutoff, room, entries, offers, kept, states);
        following.rows.clear(), following.score.clear(), following.friction.clear(), following.node.clear();
        for (std::size_t state = 0; state < states.kept.size(); ++state) {
            for (std::int32_t rank = 0; rank < states.kept[state]; ++rank) {
                const Offer& offer = offers[states.best[state * kept + rank]];
                const auto row = states.rows.begin() + state * width;
                following.rows.insert(following.rows.end(), row, row + width);
                const auto before = entries.friction.begin() + 2 * systems * offer.entry;
                following.friction.insert(following.friction.end(), before, before + 2 * systems);
                double* friction = following.friction.data() + following.friction.size() - 2 * systems;
                learn(scores, &entries.rows[offer.entry * width], k, offer.action, friction);
                following.score.push_back(offer.score);
                following.node.push_back(static_cast<std::int32_t>(found.parent.size()));
                found.parent.push_back(entries.node[offer.entry]);
                found.action.push_back(offer.action);
            }
        }
        std::swap(entries, following);
    }
    for (std::size_t at = 0; at < entries.score.size(); ++at) {
        const Row row = &entries.rows[at * width];
        entries.score[at] += scores.fit(row[0], candidates + 1);
        for (int64_t s = 0; s < systems; ++s) entries.score[at] += scores.stay(s, row[1 + 2 * s], row[2 + 2 * s]);
    }
    found.last = std::move(entries.node);
    found.score = std::move(entries.score);
    return found;
}

}  // namespace rwa
