// Upper bounds of what can follow a partial assignment, of two kinds. The free bound: every jump has the best law and
// the best size that any system could have there. The priced one is a Lagrangian relaxation (Fisher 1981, "The
// Lagrangian relaxation method for solving integer programming problems", Management Science 27): levels and each
// system are planned on their own, and the levels pay a price for their jump at a candidate, which a system that jumps
// there earns. With any prices the separate optima add up to at least the joint one; under good ones the jumps of a
// good path earn what they cost.
#include "assignment.hpp"

namespace rwa {
namespace {

constexpr double LEAST_WORTH = -5.0;  // of the size of a path's own jump: an odd one must not make all others free

// The most that `size_term` can be for any mean and at least this variance.
double highest_size(const Scores& scores, int64_t k, double variance) {
    return size_term(scores, k, scores.size[k - 1], variance);
}

// Call `visit(q, direction, after)` for each jump that a system can make.
template <typename Visit>
void each_jump(int64_t configurations, Visit visit) {
    for (int64_t q = 0; q < configurations; ++q) {
        for (int64_t direction = 0; direction < 2; ++direction) {
            const int64_t after = q + 2 * direction - 1;
            if (after >= 0 && after < configurations) visit(q, direction, after);
        }
    }
}

// What sizes are worth at most.
Worth size_worth(const Scores& scores) {
    const auto [systems, configurations, nodes] = scores.stay.shape;
    Worth worth{Table<double, 4>({systems, configurations, 2, nodes}, -INFINITE), NewFloats(nodes), NewFloats(nodes),
                NewFloats(nodes, scores.unattributed)};
    double smallest = INFINITE;  // variance of a friction that moves at all
    for (double variance : scores.law_variance) {
        if (variance > 0.0) smallest = min(smallest, variance);
    }
    for (int64_t k = 1; k < nodes; ++k) {
        worth.alone[k] = size_term(scores, k, 0.0, scores.unattributed_variance);
        // Both of two may return to rest only where the level may fall; otherwise one of them takes up friction.
        worth.twice[k] = highest_size(scores, k, scores.signs(k - 1, 0) || smallest == INFINITE ? 0.0 : smallest);
        for (int64_t s = 0; s < systems; ++s) {
            each_jump(scores.configurations[s], [&](int64_t q, int64_t direction, int64_t after) {
                const double variance = scores.law_variance(s, after);
                worth.single(s, q, direction, k) =
                    scores.law_variance(s, q) == 0.0  // from rest the friction before is known
                        ? size_term(scores, k, scores.law_mean(s, after) - scores.law_mean(s, q), variance)
                        : highest_size(scores, k, variance);
            });
        }
    }
    return worth;
}

// Raise `highest` to the highest entry of each column above the diagonal.
void raise(Vector<double> highest, FloatMatrix table) {
    for (int64_t i = 0; i < table.shape[0]; ++i) {
        for (int64_t k = i + 1; k < table.shape[1]; ++k) highest[k] = max(highest[k], table(i, k));
    }
}

// Add the laws to the most that a jump at each node can be worth; return that by size alone.
NewFloats add_best_laws(const Scores& scores, Worth& worth) {
    const auto [systems, configurations, nodes] = scores.stay.shape;
    NewCube law({systems, configurations, nodes}, -INFINITE);
    for (int64_t s = 0; s < systems; ++s) {
        NewFloats skips(nodes, -INFINITE);
        for (int64_t q = 0; q < configurations; ++q) {
            for (int64_t skipped = 0; skipped < 2; ++skipped) raise(skips, scores.missed.row(s).row(q).row(skipped));
        }
        for (int64_t q = 0; q < scores.configurations[s]; ++q) {
            const auto best = law.row(s).row(q);
            copy(skips.begin(), skips.end(), best.begin());
            raise(best, scores.jump.row(s).row(q));
        }
    }
    NewFloats size_only(nodes);
    for (int64_t k = 1; k < nodes; ++k) {
        double& with_law = worth.with_law[k];
        with_law += worth.alone[k];
        size_only[k] = max(0.0, worth.alone[k]);
        double first = -INFINITE, second = -INFINITE;  // the best laws of any two systems
        for (int64_t s = 0; s < systems; ++s) {
            double plain = -INFINITE;
            each_jump(scores.configurations[s], [&](int64_t q, int64_t direction, int64_t) {
                const double turned = law(s, q, k) + scores.turn(s, q, direction);
                const double size = worth.single(s, q, direction, k);
                plain = max(plain, turned);
                with_law = max(with_law, turned + size);
                size_only[k] = max(size_only[k], size);
            });
            second = max(second, min(first, plain));
            first = max(first, plain);
        }
        with_law = max(with_law, first + second + worth.twice[k]);
        if (systems > 1) size_only[k] = max(size_only[k], worth.twice[k]);
    }
    return size_only;
}

// The best sum of fits, and gains of accepted nodes, from node i to the end over candidates after k: (m + 1, m + 1).
NewMatrix best_rest(FloatMatrix fit, Floats gain) {
    const auto nodes = fit.shape[0] - 1;
    NewMatrix rest({nodes, nodes}, -INFINITE);
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

// `own` of Bounds; earned, (S, Q, 2, m + 1), is what a jump from a configuration down or up adds at each node.
Table<double, 4> best_chains(const Scores& scores, Array<const double, 4> earned) {
    const auto [systems, configurations, nodes] = scores.stay.shape;
    Table<double, 4> own({systems, configurations, nodes, nodes}, -INFINITE);
    NewMatrix begun({configurations, nodes}, -INFINITE);  // of a sojourn that begins at the node
    for (int64_t s = 0; s < systems; ++s) {
        for (int64_t i = nodes - 1; i >= 0; --i) {
            for (int64_t q = 0; q < configurations; ++q) {
                double* best = &own(s, q, i, 0);
                for (int64_t number = 0; number < STEPS; ++number) {
                    const Step step = step_from(q, number);
                    if (!possible(step, configurations)) continue;
                    const double turn = scores.turn(s, step.before, step.direction);
                    const double* gain = &earned(s, step.before, step.direction, 0);
                    const double* law = sojourn_laws(scores, s, q, i, step);
                    const double* then = &begun(step.after, 0);
                    for (auto k = i + 1; k < nodes; ++k) {
                        best[k - 1] = max(best[k - 1], law[k] + (turn + gain[k]) + then[k]);
                    }
                }
                best[nodes - 1] = scores.stay(s, q, i);
                for (auto k = nodes - 1; k > i; --k) best[k - 1] = max(best[k], best[k - 1]);
            }
            for (int64_t q = 0; q < configurations; ++q) begun(q, i) = own(s, q, i, i);
        }
    }
    return own;
}

// Prices under which the path's jumps cost their systems nothing on balance; where it rejects, no jump earns more than
// it costs.
NewFloats prices(const Scores& scores, const Worth& worth, Integers start, Integers taken) {
    NewFloats price;
    for (double most : worth.with_law) price.push_back(-most);
    NewIntegers configuration(start.begin(), start.end()), since(start.size());
    for (int64_t node = 1; node <= taken.size(); ++node) {
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
                    max(worth.single(s, step.before, step.direction, node), LEAST_WORTH);
            systems += 1.0;
            configuration[s] = step.after, since[s] = node;
        });
        price[node] = cost / systems;
    }
    return price;
}

}  // namespace

tuple<Bounds, Worth> free_bounds(const Scores& scores) {
    Worth worth = size_worth(scores);
    const NewFloats size_only = add_best_laws(scores, worth);
    const Table<double, 4> nothing(worth.single.shape);
    Bounds bounds{
        best_rest(scores.fit, worth.with_law), best_rest(scores.fit, size_only), best_chains(scores, nothing)};
    return {std::move(bounds), std::move(worth)};
}

void set_prices(const Scores& scores, const Worth& worth, Integers start, Integers taken, Bounds& bounds) {
    const NewFloats price = prices(scores, worth, start, taken);
    Table<double, 4> earned(worth.single.shape, -INFINITE);
    NewFloats paid(price.size());
    for (std::size_t k = 1; k < price.size(); ++k) {
        paid[k] = max(-price[k], scores.unattributed + worth.alone[k]);
        // Two that jump at once earn twice, and share one size: each is taken to be worth half of it at least.
        const double least = 0.5 * (worth.twice[k] - price[k]);
        for (int64_t s = 0; s < scores.configurations.size(); ++s) {
            each_jump(scores.configurations[s], [&](int64_t q, int64_t direction, int64_t) {
                // Against the level's sign a system jumps only together with another one.
                double size = worth.single(s, q, direction, k);
                size = scores.signs(k - 1, direction) ? max(size, least) : least;
                earned(s, q, direction, k) = size + price[k];
            });
        }
    }
    bounds.rest_fit = best_rest(scores.fit, paid);
    bounds.own = best_chains(scores, earned);
}

}  // namespace rwa
