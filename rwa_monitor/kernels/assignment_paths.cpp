// Loops over whole paths of the search: found, traced back, weighed, compared.
#include "assignment.hpp"

#include <algorithm>
#include <cstdlib>
#include <numeric>

namespace rwa {
namespace {

using IndexTable = Table<int64_t, 2>;

// See assignment.Knowns.
struct Knowns {
    int64_t slots;
    Array<const double, 3> table;
    Cases cases;
    double variance, scatter;
    auto fields() { return std::tie(slots, table, cases, variance, scatter); }
};

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
    const Expansion tree = expand(scores, bounds, cutoff, budget, kept);
    std::vector<std::size_t> best(tree.score.size());
    std::iota(best.begin(), best.end(), 0);
    std::stable_sort(best.begin(), best.end(), [&](auto a, auto b) { return tree.score[a] > tree.score[b]; });
    best.resize(std::min(best.size(), static_cast<std::size_t>(paths)));
    const auto systems = scores.configurations.size(), candidates = scores.signs.extent(0);
    Found found{NewFloats::zeros(best.size()), IndexTable::zeros(best.size(), systems),
                IndexTable::zeros(best.size(), candidates), tree.expanded, tree.lost};
    for (std::size_t path = 0; path < best.size(); ++path) {
        found.score[path] = tree.score[best[path]];
        auto node = tree.last[best[path]];
        for (auto k = candidates - 1; k >= 0; --k, node = tree.parent[node]) found.taken(path, k) = tree.action[node];
        int64_t number = tree.action[node];  // of the start; the last system counts fastest
        for (auto s = systems - 1; s >= 0; number /= scores.configurations[s--]) {
            found.start(path, s) = number % scores.configurations[s];
        }
    }
    return found;
}

// Search twice: with a narrow beam for a good path and the prices of its jumps, then for the best of all. Where values
// are wild the full search may drop every path within its budget; then the path of the narrow beam.
std::tuple<NewFloats, IndexTable, IndexTable, int64_t, bool> find_paths(
    const Scores& scores, int64_t paths, double margin, int64_t budget, int64_t quick_budget, int64_t kept) {
    const auto [free, worth] = free_bounds(scores);
    auto bounds = view_of<Bounds>(free);
    Found quick = search_once(scores, bounds, -INFINITE, std::min(quick_budget, budget), 1, 1);
    if (quick.score.values.empty()) return {};  // nothing is possible
    const auto start = quick.start.view().row(0), taken = quick.taken.view().row(0);
    const auto priced = priced_bounds(scores, view_of<Worth>(worth), start, taken);
    bounds.rest_fit = std::get<0>(priced).view(), bounds.own = std::get<1>(priced).view();
    Found full = search_once(scores, bounds, quick.score[0] - margin, budget, kept, paths);
    const bool none = full.score.values.empty(), pruned = none || full.lost > full.score[0];
    Found& best = none ? quick : full;
    return {std::move(best.score), std::move(best.start), std::move(best.taken), quick.states + full.states, pruned};
}

// The part of a path's score that comes from laws and priors of rare events: no fits, no sizes.
double add_up_laws(const Scores& scores, Integers start, Integers taken) {
    std::vector<int64_t> configuration(start.begin(), start.end()), since(start.size());
    double total = 0.0, staying = 0.0;
    for (int64_t node = 1; node <= taken.size(); ++node) {
        const auto action = taken[node - 1];
        if (action == REJECT || action == NO_SYSTEM) {
            total += scores.priors[action];
            continue;
        }
        for (int place : {0, 2}) {
            const auto s = scores.actions(action, place);
            if (s < 0) continue;
            const Step step = step_from(configuration[s], scores.actions(action, place + 1));
            total += sojourn_laws(scores, s, configuration[s], since[s], step)[node];
            total += scores.turn(s, step.before, step.direction);
            configuration[s] = step.after, since[s] = node;
        }
        if (scores.actions(action, 2) >= 0) total += scores.priors[2];
    }
    for (int64_t s = 0; s < start.size(); ++s) staying += scores.stay(s, configuration[s], since[s]);
    return total + staying;
}

using MadeStory = std::tuple<NewIntegers, NewIntegers, NewIntegers, NewIntegers>;  // see FlatStory

// A path as sojourns; the accepted candidates as nodes, and both ends of the window; who jumped at each candidate and
// which way, (m, 2): REJECTED or UNATTRIBUTED alone, REJECTED in second place.
std::tuple<MadeStory, NewIntegers, IndexTable, IndexTable> tell(
    Matrix<const int64_t> actions, Integers index, Integers start, Integers taken) {
    const auto systems = start.size();
    auto system = IndexTable::full(REJECTED, taken.size(), 2), direction = IndexTable::zeros(taken.size(), 2);
    std::vector<std::vector<int64_t>> configurations(systems), starts(systems, {0});
    for (int64_t s = 0; s < systems; ++s) configurations[s] = {start[s]};
    std::vector<int64_t> nodes{0}, unattributed, all_configurations, all_starts, sojourns;
    for (int64_t k = 0; k < taken.size(); ++k) {
        if (taken[k] == REJECT) continue;
        nodes.push_back(k + 1);
        if (taken[k] == NO_SYSTEM) {
            system(k, 0) = UNATTRIBUTED;
            unattributed.push_back(index[k]);
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
    for (int64_t s = 0; s < systems; ++s) {
        all_configurations.insert(all_configurations.end(), configurations[s].begin(), configurations[s].end());
        all_starts.insert(all_starts.end(), starts[s].begin(), starts[s].end());
        sojourns.push_back(static_cast<int64_t>(starts[s].size()));
    }
    return {{NewIntegers::from(std::move(all_configurations)), NewIntegers::from(std::move(all_starts)),
             NewIntegers::from(std::move(sojourns)), NewIntegers::from(std::move(unattributed))},
            NewIntegers::from(std::move(nodes)), std::move(system), std::move(direction)};
}

// A path weighed by its full likelihood: switching path, systems and directions as from `tell`; slots at which its
// segments begin and end, and their statistics; log-likelihood of the samples, and the same with the laws'.
std::tuple<MadeStory, IndexTable, IndexTable, NewIntegers, Table<double, 2>, double, double> weigh(
    const Scores& scores, Integers start, Integers taken, Integers index, Array<const double, 3> pairs,
    const Knowns& knowns) {
    auto [story, borders, system, direction] = tell(scores.actions, index, start, taken);
    auto moments = chain_of(pairs, borders.view());
    for (auto& node : borders.values) node = node == 0 ? 0 : node > index.size() ? knowns.slots : index[node - 1];
    const double log_evidence = evidence_of_cases(
        view_of<FlatStory>(story), borders.view(), knowns.table, moments.view(), knowns.cases, knowns.variance,
        knowns.scatter);
    return {std::move(story),   std::move(system), std::move(direction), std::move(borders),
            std::move(moments), log_evidence,      add_up_laws(scores, start, taken) + log_evidence};
}

// Add the weight of another path to each attribution (m, 2) that it shares with the best: the same system and direction
// at a candidate at most `apart` slots away. Two that jump at once are listed in the order of their systems, so places
// correspond.
void add_agreement(
    Integers index, int64_t apart, Matrix<const int64_t> system, Matrix<const int64_t> direction,
    Matrix<const int64_t> other_system, Matrix<const int64_t> other_direction, double weight, Matrix<double> sure) {
    for (int64_t k = 0; k < index.size(); ++k) {
        for (int place = 0; place < 2; ++place) {
            const auto shared = [&, who = system(k, place), way = direction(k, place)](int64_t near, int beside) {
                return other_system(near, beside) == who && other_direction(near, beside) == way;
            };
            bool same = shared(k, place);
            for (int64_t near = 0; near < index.size() && !same && system(k, place) != REJECTED; ++near) {
                same = std::abs(index[near] - index[k]) <= apart && (shared(near, 0) || shared(near, 1));
            }
            if (same) sure(k, place) += weight;
        }
    }
}

// The scores of all complete paths that `expand` finds, and how many entries it expanded.
std::tuple<NewFloats, int64_t> scores_of_expanded(
    const Scores& scores, const Bounds& bounds, double cutoff, int64_t budget, int64_t kept) {
    auto found = expand(scores, bounds, cutoff, budget, kept);
    return {NewFloats::from(std::move(found.score)), found.expanded};
}

}  // namespace

void bind_assignment(nanobind::module_& module) {
    module.attr("REJECT") = REJECT;
    module.attr("NO_SYSTEM") = NO_SYSTEM;
    module.attr("STEPS") = STEPS;
    module.attr("REJECTED") = REJECTED;
    module.attr("UNATTRIBUTED") = UNATTRIBUTED;
    kernel(module, "free_bounds", &free_bounds);
    kernel(module, "priced_bounds", &priced_bounds);
    kernel(module, "expand", &scores_of_expanded);
    kernel(module, "find_paths", &find_paths);
    kernel(module, "add_up_laws", &add_up_laws);
    kernel(module, "tell", &tell);
    kernel(module, "weigh", &weigh);
    kernel(module, "add_agreement", &add_agreement);
}

}  // namespace rwa
