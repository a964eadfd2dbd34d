// Exact penalised segmentation (see rwa_monitor/discrepancy/segmentation.py), and the running sums that it reads.
#include "arrays.hpp"

#include <optional>

namespace rwa {
namespace {

constexpr int64_t COARSE_FROM = 2000;  // samples from which jumps are first searched between blocks
constexpr int64_t BLOCK = 4;           // samples of a block
constexpr int64_t REFINE = 6;          // slots on each side of a coarse jump that are tried
constexpr double ROOM_TO_JUMPS = 2.0;       // penalties above the least cost at which DeCAFS first truncates the cost

// On [edge, edge of the next) the minimum cost of a level μ is bend (μ - centre)² + least, with the jumps of one
// history.
struct Parabola {
    double bend, centre, least, edge;
    int64_t history;
};
using Parabolas = vector<Parabola>;  // of one function, from left to right

// The end of a part of a function; that of the last part is `last`.
double end_of(const Parabolas& parts, size_t i, double last) { return i + 1 < parts.size() ? parts[i + 1].edge : last; }

// Append the minimum of a parabola and a constant on [from, to).
void append(Parabolas& envelope, const Parabola& p, double from, double to, const Parabola& constant) {
    const auto put = [&](const Parabola& part, double start, double end) {
        if (!(end > start) || (!envelope.empty() && envelope.back().history == part.history)) return;
        envelope.push_back(part);
        envelope.back().edge = start;
    };
    const double below = constant.least - p.least;
    const double half = below > 0.0 ? sqrt(below / p.bend) : 0.0;
    const double left = clamp(p.centre - half, from, to), right = clamp(p.centre + half, from, to);
    put(constant, from, left);
    put(p, left, right);
    put(constant, right, to);
}

// The mean of each block of samples, from their running sums, and its number of samples.
void block_means(Floats running, int64_t block, NewFloats& means, NewFloats& weights) {
    const int64_t size = running.size() - 1, count = (size + block - 1) / block;
    means.resize(count);
    weights.resize(count);
    for (int64_t i : range(count)) {
        const int64_t begin = i * block, end = min(begin + block, size);
        weights[i] = end - begin;
        means[i] = (running[end] - running[begin]) / weights[i];
    }
}

// Move each jump, in order, to the best sample around it; the first and the last edge are the ends of the sequence.
void move_jumps(Floats running, NewIntegers& edges) {
    for (int64_t i : range(1, edges.size() - 1)) {
        const int64_t before = edges[i - 1], after = edges[i + 1];
        const int64_t last = min(edges[i] + REFINE, after - 1);
        double best = -INFINITY;
        int64_t place = edges[i];
        for (int64_t k = max(edges[i] - REFINE, before + 1); k <= last; ++k) {
            const double left = running[k] - running[before], right = running[after] - running[k];
            const double explained =
                left * left / (k - before) + right * right / (after - k);
            if (explained > best) best = explained, place = k;
        }
        edges[i] = place;
    }
}

// Drop, weakest first, the jumps that lower the cost by less than the penalty; returns whether there was one.
bool drop_jumps(Floats running, NewIntegers& edges, double penalty) {
    for (bool dropped = false;; dropped = true) {
        int64_t weakest = 0;
        double least = penalty;
        for (int64_t i : range(1, edges.size() - 1)) {
            const double n1 = edges[i] - edges[i - 1], n2 = edges[i + 1] - edges[i], until = running[edges[i]];
            const double step = (running[edges[i + 1]] - until) / n2 - (until - running[edges[i - 1]]) / n1;
            const double worth = step * step * n1 * n2 / (n1 + n2);
            if (worth < least) weakest = i, least = worth;
        }
        if (weakest == 0) return dropped;
        edges.erase(edges.begin() + weakest);
    }
}

// A history is its last jump and the history before that.
struct Jump {
    int64_t at, before;
};
enum : int64_t { UNKNOWN = -2, NO_JUMP };

// The step from sample k - 1 to k: μ' and μ cost (value + φ μ' - μ)² / v, value = z_k - φ z_{k-1}.
struct Step {
    double value, phi, v;
};

// The minimum over μ' of p(μ') + (value + φ μ' - μ)² / v, as a function of μ, plus the penalty: the level jumps.
Parabola jumped(const Parabola& p, const Step& step, double penalty) {
    const double bend = 1.0 / (step.v + step.phi * step.phi / p.bend);
    return {bend, step.value + step.phi * p.centre, p.least + penalty, 0.0, p.history};
}

// p(μ) + (value - (1 - φ) μ)² / v: the level stays.
Parabola stayed(const Parabola& p, const Step& step) {
    const double rest = 1.0 - step.phi, bend = p.bend + rest * rest / step.v, apart = rest * p.centre - step.value;
    const double centre = (p.bend * p.centre + rest * step.value / step.v) / bend;
    return {bend, centre, p.least + p.bend / step.v * apart * apart / bend, p.edge, p.history};
}

// Where q - p crosses 0 downwards and where upwards. If q bends at least as p does, q < p between `falling` and
// `rising`; else, q < p left of `rising` and right of `falling`.
struct Crossings {
    double falling, rising;
};
Crossings crossings(const Parabola& p, const Parabola& q) {
    const double apart = q.centre - p.centre, up = q.least - p.least, bend = q.bend - p.bend;
    const double square = p.bend * q.bend * apart * apart - bend * up;
    if (!(square > 0.0)) {
        if (bend < 0.0) return {-INFINITY, -INFINITY};
        return {bend == 0.0 && up < 0.0 ? -INFINITY : INFINITY, INFINITY};
    }
    // The roots of bend x² - 2 b x + c, x = μ - p.centre, without cancellation.
    const double root = sqrt(square), b = q.bend * apart, c = b * apart + up;
    if (b >= 0.0) return {p.centre + c / (b + root), p.centre + (b + root) / bend};
    return {p.centre + (b - root) / bend, p.centre + c / (b - root)};
}

// Add the next parabola to the lower envelope of the previous ones, on (low, high). They come in their order before a
// step, which a step preserves: the best μ' is monotonic in μ, so that of two parabolas the later one is the minimum
// from where it becomes less, which is at `limit` at the latest.
void lay(Parabolas& envelope, Parabola next, double low, double high) {
    for (double limit = high; !envelope.empty(); envelope.pop_back()) {
        const Parabola& last = envelope.back();
        if (next.history == last.history) return;
        const auto [falling, rising] = crossings(last, next);
        const bool inside = next.bend >= last.bend;
        if (inside ? max(falling, low) >= min(rising, high) : rising <= low && falling >= high) return;
        next.edge = !inside && rising > limit ? low : min(falling, limit);
        if (next.edge > max(last.edge, low)) break;
        limit = last.edge;
    }
    if (envelope.empty()) next.edge = -INFINITY;
    envelope.push_back(next);
}

// The lower envelope of parabolas in order, each with its minimum below a constant, exact where it is below that.
void envelope_below(const Parabola& constant, const Parabolas& parabolas, Parabolas& out) {
    double low = INFINITY, high = -INFINITY;
    for (const Parabola& p : parabolas) {
        const double half = sqrt((constant.least - p.least) / p.bend);
        low = min(low, p.centre - half);
        high = max(high, p.centre + half);
    }
    out.clear();
    for (const Parabola& p : parabolas) lay(out, p, low, high);
    if (out.empty()) out.push_back(constant);
}

// The minimum of two envelopes and a constant.
void least_of(const Parabolas& first, const Parabolas& second, const Parabola& constant, Parabolas& out) {
    out.clear();
    double from = -INFINITY;
    for (size_t i = 0, j = 0; i < first.size() && j < second.size();) {
        const Parabola &p = first[i], &q = second[j];
        const double p_end = end_of(first, i, INFINITY), q_end = end_of(second, j, INFINITY), to = min(p_end, q_end);
        const auto [falling, rising] = crossings(p, q);
        const double fall = clamp(falling, from, to), rise = clamp(rising, from, to);
        const bool inside = q.bend >= p.bend;  // q is less between the crossings, else outside
        const double low = inside ? fall : rise, high = inside ? rise : fall;
        append(out, inside ? p : q, from, low, constant);
        append(out, inside ? q : p, low, high, constant);
        append(out, inside ? p : q, high, to, constant);
        from = to;
        i += p_end == to;
        j += q_end == to;
    }
}

const Parabola& least_in(const Parabolas& parts) {
    const auto less = [](const Parabola& p, const Parabola& q) { return p.least < q.least; };
    return *min_element(parts, less);
}

// `decafs` with the cost as a function of μ truncated at its minimum plus `room`, with an unknown history there. The
// cost of the result is at most that of the optimum, so it is the optimum where its history is known; else nothing.
std::optional<NewIntegers> decafs_within(
    const Floats& z, const Floats& phi, const Floats& v, double penalty, double room) {
    vector<Jump> jumps;
    Parabolas cost{{1.0 / v[0], z[0], 0.0, -INFINITY, NO_JUMP}}, stay, moved, jump;
    const auto history = [&](int64_t at, int64_t before) {
        jumps.push_back({at, before});
        return static_cast<int64_t>(jumps.size()) - 1;
    };
    for (int64_t k : range(1, z.size())) {
        const Step step{z[k] - phi[k] * z[k - 1], phi[k], v[k]};
        const Parabola best = least_in(cost);
        stay.clear();
        for (const Parabola& p : cost) stay.push_back(stayed(p, step));
        const double top = min(least_in(stay).least, best.least + penalty) + room;
        const Parabola constant{0.0, 0.0, top, -INFINITY, history(k, UNKNOWN)};
        if (step.phi < 0.0) reverse(cost);
        if (step.phi * step.phi == 0.0) cost = {best};  // the former level has no influence
        moved.clear();
        for (const Parabola& p : cost) {
            if (p.bend > 0.0 && p.least + penalty < top) moved.push_back(jumped(p, step, penalty));
        }
        envelope_below(constant, moved, jump);
        for (Parabola& p : jump) p.history = history(k, p.history);
        least_of(stay, jump, constant, cost);
    }
    NewIntegers found;
    int64_t last = least_in(cost).history;
    for (; last >= 0; last = jumps[last].before) found.push_back(jumps[last].at);
    if (last == UNKNOWN) return {};
    reverse(found);
    return found;
}

}  // namespace

// The jumps of weighted values, by FPOP. A history is its last jump.
NewIntegers fpop(Floats z, Floats weight, double penalty) {
    const double low = *min_element(z), high = *max_element(z);
    Parabolas cost{{0.0, 0.0, 0.0, low, 0}}, capped;
    NewIntegers last(z.size() + 1), found;
    for (int64_t t : range(1, z.size() + 1)) {
        const double value = z[t - 1], w = weight[t - 1];
        double least = INFINITY;
        for (size_t i : range(cost.size())) {
            Parabola& p = cost[i];
            const double apart = value - p.centre, share = w / (p.bend + w);
            p.least += p.bend * share * apart * apart;
            p.centre += share * apart;
            p.bend += w;
            const double off = min(max(p.centre, p.edge), end_of(cost, i, high)) - p.centre;
            const double within = p.bend * off * off + p.least;
            if (within < least) least = within, last[t] = p.history;
        }
        const Parabola constant{0.0, 0.0, least + penalty, low, t};
        capped.clear();
        for (size_t i : range(cost.size())) {
            append(capped, cost[i], cost[i].edge, end_of(cost, i, high), constant);
        }
        if (low < high) swap(cost, capped);
    }
    for (int64_t t = last.back(); t > 0; t = last[t]) found.push_back(t);
    reverse(found);
    return found;
}

// The jumps of a level in autoregressive noise: DeCAFS (Romano et al., J. Am. Stat. Assoc. 117, 2022), without a random
// walk of the level. Each history's cost is one parabola in μ, so that the minimum over μ' is exact.
NewIntegers decafs(Floats z, Floats correlation, Floats innovation_variance, double penalty) {
    for (double room = ROOM_TO_JUMPS * penalty;; room *= 2.0) {
        auto found = decafs_within(z, correlation, innovation_variance, penalty, room);
        if (found) return *found;
    }
}

// The jumps of a sequence, from its running sums. In a long one they are first found between blocks, then moved to
// their best samples, and the superfluous one is dropped of two around a block with a jump in it.
NewIntegers segment_sums(Floats running, double penalty) {
    const int64_t n = running.size() - 1, block = n + 1 > COARSE_FROM ? BLOCK : 1;
    NewFloats means, weights;
    block_means(running, block, means, weights);
    auto jumps = fpop(means, weights, penalty);
    if (block == 1) return jumps;
    NewIntegers edges{0};
    for (auto jump : jumps) edges.push_back(jump * block);
    edges.push_back(n);
    for (int round = 0; round < 3; ++round) {
        move_jumps(running, edges);
        if (!drop_jumps(running, edges, penalty)) break;
    }
    return {edges.begin() + 1, edges.end() - 1};
}

// Sums of a segment, x relative to the segment's first block; `scale` converts the x of the next block.
struct CurveSums {
    int64_t first;
    double scale = 1.0, n = 0.0, x = 0.0, z = 0.0, xx = 0.0, xz = 0.0, zz = 0.0;
};

// The first block of each segment but the first, where a segment is a level or a level and a multiple of x, from each
// block's sums (6, blocks) of 1, x, z, xx, xz, zz, and the factor `keep` from its x to that of the next: optimal
// partitioning (Jackson et al., IEEE Signal Processing Letters 12, 2005) with the pruning of PELT (Killick et al.,
// J. Am. Stat. Assoc. 107, 2012), a penalty later, since one segment of two parameters may replace two of one.
NewIntegers optimal_curves(FloatMatrix sums, Floats keep, double penalty) {
    const int64_t count = sums.shape[1];
    NewFloats best(count + 1, -penalty), costs(count + 1);
    NewIntegers previous(count + 1), found;
    vector<CurveSums> alive{{0}};
    for (int64_t j : range(0, count)) {
        double least = INFINITY;
        for (size_t k : range(alive.size())) {
            CurveSums& s = alive[k];
            s.n += sums(0, j), s.z += sums(2, j), s.zz += sums(5, j);
            s.x += s.scale * sums(1, j), s.xz += s.scale * sums(4, j), s.xx += s.scale * s.scale * sums(3, j);
            s.scale *= keep[j];
            const double level = max(s.zz - s.z * s.z / s.n, 0.0);
            const double energy = s.xx - s.x * s.x / s.n, moment = s.xz - s.x * s.z / s.n;
            const double curve = energy > 0.0 ? max(level - moment * moment / energy, 0.0) : level;
            costs[k] = best[s.first] + min(level, curve + penalty);
            if (costs[k] + penalty < least) least = costs[k] + penalty, previous[j + 1] = s.first;
        }
        best[j + 1] = least;
        size_t left = 0;
        for (size_t k : range(alive.size())) {
            if (costs[k] <= least + penalty) alive[left++] = alive[k];
        }
        alive.resize(left);
        alive.push_back({j + 1});
    }
    for (int64_t j = previous[count]; j > 0; j = previous[j]) found.push_back(j);
    reverse(found);
    return found;
}

STAGE(segmentation, fpop, decafs, segment_sums, optimal_curves)

}  // namespace rwa
