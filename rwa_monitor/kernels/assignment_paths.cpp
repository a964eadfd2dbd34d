// Loops over whole paths of the search: found, traced back, weighed, compared.
#include "assignment.hpp"

namespace rwa {
namespace {

using IndexTable = Table<int64_t, 2>;

// Paths, best first: configurations at the window's begin and actions; entries expanded, highest bound of what was cut.
struct Found {
    NewFloats score;
    IndexTable start, taken;
    int64_t states;
    double lost;
};

// The best of all expanded paths, traced back from their leaves in the tree.
Found search_once(
    const Scores& scores, const Bounds& bounds, double cutoff, int64_t budget, int64_t kept, int64_t paths) {
    const Expansion all = expand(scores, bounds, cutoff, budget, kept);
    NewIntegers best(all.score.size());
    iota(best.begin(), best.end(), 0);
    stable_sort(best.begin(), best.end(), [&](auto a, auto b) { return all.score[a] > all.score[b]; });
    const int64_t systems = scores.configurations.size(), candidates = scores.signs.shape[0];
    const int64_t count = min<int64_t>(best.size(), paths);
    Found found{
        NewFloats(count), IndexTable({count, systems}), IndexTable({count, candidates}), all.expanded, all.lost};
    for (int64_t path = 0; path < count; ++path) {
        found.score[path] = all.score[best[path]];
        const Expansion::Node* node = &all.tree[all.last[best[path]]];
        for (auto k = candidates - 1; k >= 0; --k, node = &all.tree[node->before]) found.taken(path, k) = node->action;
        const NewIntegers start = start_of(node->action, scores.configurations);
        copy(start.begin(), start.end(), found.start.row(path).begin());
    }
    return found;
}

// Search twice: with a narrow beam for a good path and the prices of its jumps, then for the best of all. Where values
// are wild the full search may drop every path within its budget; then the path of the narrow beam.
tuple<NewFloats, IndexTable, IndexTable, int64_t, bool> find_paths(
    const Scores& scores, int64_t paths, double margin, int64_t budget, int64_t quick_budget, int64_t kept) {
    auto [bounds, worth] = free_bounds(scores);
    Found quick = search_once(scores, bounds, -INFINITE, min(quick_budget, budget), 1, 1);
    if (quick.score.empty()) return {};  // nothing is possible
    set_prices(scores, worth, quick.start.row(0), quick.taken.row(0), bounds);
    Found full = search_once(scores, bounds, quick.score[0] - margin, budget, kept, paths);
    const bool none = full.score.empty(), pruned = none || full.lost > full.score[0];
    Found& best = none ? quick : full;
    return {best.score, best.start, best.taken, quick.states + full.states, pruned};
}

// The part of a path's score that comes from laws and from jumps that no system made: no fits, no sizes.
double add_up_laws(const Scores& scores, Integers start, Integers taken) {
    NewIntegers configuration(start.begin(), start.end()), since(start.size());
    double total = 0.0, staying = 0.0;
    for (int64_t node = 1; node <= taken.size(); ++node) {
        const auto action = taken[node - 1];
        if (action == NO_SYSTEM) total += scores.unattributed;
        each_step(scores.actions, action, [&](int64_t s, int64_t number) {
            const Step step = step_from(configuration[s], number);
            total += sojourn_laws(scores, s, configuration[s], since[s], step)[node];
            total += scores.turn(s, step.before, step.direction);
            configuration[s] = step.after, since[s] = node;
        });
    }
    for (int64_t s = 0; s < start.size(); ++s) staying += scores.stay(s, configuration[s], since[s]);
    return total + staying;
}

// A path of the search as a switching path, see stage_results.FlatPath.
struct NewPath {
    NewIntegers configurations, starts, sojourns, unattributed;
    FIELDS(configurations, starts, sojourns, unattributed)
};

// A path as sojourns; the accepted candidates as nodes, and both ends of the window; who jumped at each candidate and
// which way, (m, 2): REJECTED or UNATTRIBUTED alone, REJECTED in second place.
tuple<NewPath, NewIntegers, IndexTable, IndexTable> switching_path(
    IntegerMatrix actions, Integers index, Integers start, Integers taken) {
    IndexTable system({taken.size(), 2}, REJECTED), direction({taken.size(), 2});
    vector<NewIntegers> configurations, starts(start.size(), {0});
    for (int64_t q : start) configurations.push_back({q});
    NewPath path;
    NewIntegers nodes{0};
    for (int64_t k = 0; k < taken.size(); ++k) {
        if (taken[k] == REJECT) continue;
        nodes.push_back(k + 1);
        if (taken[k] == NO_SYSTEM) {
            system(k, 0) = UNATTRIBUTED;
            path.unattributed.push_back(index[k]);
            continue;
        }
        for (int place = 0; place < 2; ++place) {
            const auto who = actions(taken[k], 2 * place);
            if (who < 0) continue;
            const Step step = step_from(configurations[who].back(), actions(taken[k], 2 * place + 1));
            system(k, place) = who, direction(k, place) = step.after - step.before;
            if (step.skipped != 0) {  // where it happened is not known; by the level, right after the sojourn began
                starts[who].push_back(starts[who].back() + 1);
                configurations[who].push_back(step.before);
            }
            starts[who].push_back(index[k]);
            configurations[who].push_back(step.after);
        }
    }
    nodes.push_back(taken.size() + 1);
    for (int64_t s = 0; s < start.size(); ++s) {
        path.configurations.insert(path.configurations.end(), configurations[s].begin(), configurations[s].end());
        path.starts.insert(path.starts.end(), starts[s].begin(), starts[s].end());
        path.sojourns.push_back(starts[s].size());
    }
    return {path, nodes, system, direction};
}

// A path weighed by its full likelihood: switching path, systems and directions as from `switching_path`; slots at which
// its segments begin and end, and their statistics; log-likelihood of the samples, and the same with the laws'.
tuple<NewPath, IndexTable, IndexTable, NewIntegers, NewMatrix, double, double> weigh(
    const Scores& scores, Integers start, Integers taken, Integers index, FloatCube pairs, int64_t slots,
    FloatCube table, const Cases& cases, double variance, double scatter) {
    auto [path, borders, system, direction] = switching_path(scores.actions, index, start, taken);
    auto statistics = chain_of(pairs, borders);
    for (auto& node : borders) node = node == 0 ? 0 : node > index.size() ? slots : index[node - 1];
    const double log_evidence = evidence_of_cases(
        {path.configurations, path.starts, path.sojourns, path.unattributed}, borders, table, statistics, cases,
        variance, scatter);
    const double score = add_up_laws(scores, start, taken) + log_evidence;
    return {path, system, direction, borders, statistics, log_evidence, score};
}

// Add the weight of another path to each attribution (m, 2) that it shares with the best: the same system and direction
// at a candidate at most `apart` slots away. Two that jump at once are listed in the order of their systems, so places
// correspond.
void add_agreement(
    Integers index, int64_t apart, IntegerMatrix system, IntegerMatrix direction,
    IntegerMatrix other_system, IntegerMatrix other_direction, double weight, Matrix<double> sure) {
    for (int64_t k = 0; k < index.size(); ++k) {
        for (int place = 0; place < 2; ++place) {
            const auto shared = [&, who = system(k, place), way = direction(k, place)](int64_t near, int beside) {
                return other_system(near, beside) == who && other_direction(near, beside) == way;
            };
            bool same = shared(k, place);
            for (int64_t near = 0; near < index.size() && !same && system(k, place) != REJECTED; ++near) {
                same = abs(index[near] - index[k]) <= apart && (shared(near, 0) || shared(near, 1));
            }
            if (same) sure(k, place) += weight;
        }
    }
}

}  // namespace

STAGE(assignment, REJECT, NO_SYSTEM, STEPS, REJECTED, UNATTRIBUTED, find_paths, add_up_laws,
      weigh, add_agreement)

}  // namespace rwa
