#include "changepoints.hpp"

#include "estimation.hpp"
#include "wglr.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

namespace rwa {
namespace {

constexpr std::int64_t LONGEST_HALF = 1024;  // slots on each side that a candidate is judged by
constexpr std::int64_t LONG_GAP = MAX_SCALE / 2;  // slots without a used sample: too few left on either side
constexpr std::int64_t MOST_CANDIDATES = 1000;  // a window with more holds something else; the strongest are kept
constexpr int MOST_ROUNDS = 3;  // of slope and candidates in turns; two nearly always agree

using Integers = Vector<const std::int64_t>;

// What a jump must clear: variance of the contrast by used samples of the shorter half, the χ² threshold, and the
// largest outlier by chance.
struct Bar {
    Vector<const double> variances;
    double threshold, outlier;
    auto fields() { return std::tie(variances, threshold, outlier); }
};

struct Candidate {
    std::int64_t index, scale;
    double statistic = 0.0, jump = 0.0, excess = 0.0;  // normalised; of the statistic over its threshold
};

Integers view(const std::vector<std::int64_t>& values) { return {values.data(), {values.size()}}; }

// The samples that the prefix sums at three slots read beside the checkpoints.
std::int64_t ends(std::int64_t low, std::int64_t middle, std::int64_t high) {
    return low % STRIDE + middle % STRIDE + high % STRIDE;
}

// Test for a jump at the candidate's slot between the levels of [low, index) and [index, high), the slope known. The
// threshold is higher where a single outlier of the noise could make the jump. All 0 where a half has no used sample.
void judge(
    Candidate& candidate, std::int64_t low, std::int64_t high, double slope, const SumArrays& sums, const Bar& bar) {
    const Sums a = prefix_moments(low, sums), b = prefix_moments(candidate.index, sums), c = prefix_moments(high, sums);
    const double left = b.n - a.n, right = c.n - b.n;
    candidate.statistic = candidate.jump = candidate.excess = 0.0;
    if (left < 1.0 || right < 1.0) return;
    const double jump = ((c.z - b.z) - slope * (c.x - b.x)) / right - ((b.z - a.z) - slope * (b.x - a.x)) / left;
    const double shorter = std::min(left, right), longer = std::max(left, right);
    const double variance = bar.variances[std::min(static_cast<std::int64_t>(shorter), bar.variances.size() - 1)];
    const double information = left * right / (left + right);
    // An outlier o in the shorter half shifts its mean by o/n.
    const double by_chance = bar.outlier * bar.outlier * longer / (shorter * (left + right)) / variance;
    candidate.statistic = jump * jump * information / variance;
    candidate.jump = jump;
    candidate.excess = candidate.statistic / std::max(bar.threshold, by_chance);
}

// The most likely slot of a single jump in [low, high) within `reach` of k; adds the samples read to `read`.
std::int64_t refine(
    std::int64_t k, std::int64_t low, std::int64_t high, std::int64_t reach, double slope, const SumArrays& sums,
    std::int64_t& read) {
    const std::int64_t first = std::max(low + 1, k - reach), last = std::min(high - 1, k + reach);
    const Sums a = prefix_moments(low, sums), c = prefix_moments(high, sums);
    Sums b = prefix_moments(first, sums);
    const double e0 = a.z - slope * a.x, e2 = c.z - slope * c.x;
    double n1 = b.n, e1 = b.z - slope * b.x;
    std::int64_t best = k;
    double best_value = -1.0;
    for (std::int64_t at = first; at <= last; ++at) {
        if (!sums.used[at]) continue;  // a masked slot is not the first sample of a level
        const double left = n1 - a.n, right = c.n - n1;
        if (left > 0.0 && right > 0.0) {
            const double difference = (e2 - e1) / right - (e1 - e0) / left;
            const double value = difference * difference * left * right / (left + right);
            if (value > best_value) {
                best = at;
                best_value = value;
            }
        }
        n1 += 1.0;
        e1 += (sums.z[at] - sums.centre[1]) - slope * (sums.x[at] - sums.centre[0]);
    }
    read += std::max<std::int64_t>(last - first + 1, 0) + ends(low, first, high);
    return best;
}

// Accept the peaks, in their order, that are significant between those accepted before; sorted by slot.
std::vector<Candidate> accept(
    Integers peak_index, Integers peak_scale, std::int64_t slots, double slope, const SumArrays& sums, const Bar& bar,
    std::int64_t& read) {
    std::vector<Candidate> accepted;
    for (std::int64_t p = 0; p < peak_index.size() && accepted.size() < MOST_CANDIDATES; ++p) {
        const std::int64_t k = peak_index[p], w = peak_scale[p];
        const auto place = std::lower_bound(
            accepted.begin(), accepted.end(), k, [](const Candidate& one, std::int64_t slot) { return one.index < slot; });
        if (place != accepted.end() && place->index == k) continue;
        const std::int64_t before = place != accepted.begin() ? (place - 1)->index : 0;
        const std::int64_t after = place != accepted.end() ? place->index : slots;
        const std::int64_t low = std::max(k - w, before), high = std::min(k + w, after);
        Candidate candidate{k, w};
        judge(candidate, low, high, slope, sums, bar);
        read += ends(low, k, high);
        if (candidate.excess < 1.0) continue;
        candidate.index = refine(k, std::max(k - 2 * w, before), std::min(k + 2 * w, after), w, slope, sums, read);
        accepted.insert(place, candidate);
    }
    return accepted;
}

}  // namespace

std::tuple<double, double> contrast(
    std::int64_t k, std::int64_t w, double slope, double weight, const SumArrays& sums) {
    const Sums a = prefix_moments(k - w, sums), b = prefix_moments(k, sums), c = prefix_moments(k + w, sums);
    const double left = b.n - a.n, right = c.n - b.n;
    if (left < 1.0 || right < 1.0) return {0.0, 0.0};
    const double xl = (b.x - a.x) / left, xr = (c.x - b.x) / right;
    const double el = (b.z - a.z) / left - slope * xl, er = (c.z - b.z) / right - slope * xr;
    const double spread = std::max(c.xx - a.xx - left * xl * xl - right * xr * xr, 0.0);
    const double tilt = c.xz - a.xz - slope * (c.xx - a.xx) - left * xl * el - right * xr * er;
    const double step = (xr - xl) / (spread + weight);
    const double jump = er - el - step * tilt;
    return {jump * jump / (1.0 / left + 1.0 / right + (xr - xl) * step), jump};
}

std::vector<std::int64_t> order_in_turn(Integers scale, Vector<const double> statistic) {
    std::vector<std::int64_t> order(scale.size());
    for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
    std::stable_sort(order.begin(), order.end(), [&](std::int64_t a, std::int64_t b) {
        return scale[a] != scale[b] ? scale[a] < scale[b] : statistic[a] > statistic[b];
    });
    return order;
}

std::vector<std::int64_t> kept_apart(Integers index, Integers scale) {
    std::vector<std::int64_t> taken;
    for (std::int64_t i = 0; i < index.size(); ++i) {
        const auto near = [&](std::int64_t slot) { return std::abs(slot - index[i]) <= scale[i]; };
        if (std::none_of(taken.begin(), taken.end(), near)) taken.push_back(index[i]);
    }
    std::sort(taken.begin(), taken.end());
    return taken;
}

// The most likely slot of a jump near k where the noise is AR(1), and the samples read. With the levels left and right of
// k, the likelihood of each slot follows from the innovations e_k - φ e_{k-1}, in which a jump is a spike: coloured noise
// hides where a jump is less than it hides that there is one.
std::tuple<std::int64_t, std::int64_t> refine_in_colour(
    std::int64_t k, std::int64_t low, std::int64_t high, std::int64_t reach, double slope, double correlation,
    const SumArrays& sums) {
    const Sums a = prefix_moments(low, sums), b = prefix_moments(k, sums), c = prefix_moments(high, sums);
    const std::int64_t read = ends(low, k, high);
    if (b.n - a.n < 1.0 || c.n - b.n < 1.0) return {k, read};
    const double left = ((b.z - a.z) - slope * (b.x - a.x)) / (b.n - a.n);
    const double right = ((c.z - b.z) - slope * (c.x - b.x)) / (c.n - b.n);
    const auto residual = [&](std::int64_t at) {
        return (sums.z[at] - sums.centre[1]) - slope * (sums.x[at] - sums.centre[0]);
    };
    const auto square = [](double value) { return value * value; };
    const double alone = 1.0 - correlation * correlation;  // weight of a sample whose neighbour is masked
    const std::int64_t first = std::max(low + 1, k - reach), last = std::min(high - 1, k + reach);
    std::int64_t best = k;
    double cost = 0.0, best_cost = std::numeric_limits<double>::infinity();
    for (std::int64_t at = first; at <= last; ++at) {
        if (!sums.used[at]) continue;
        if (cost < best_cost) {
            best = at;
            best_cost = cost;
        }
        // What changes when the slot `at` goes over to the left level: its innovation and the next one's.
        const double value = residual(at), was = value - right, now = value - left;
        if (sums.used[at - 1]) {
            const double before = correlation * (residual(at - 1) - left);
            cost += square(now - before) - square(was - before);
        } else {
            cost += alone * (now * now - was * was);
        }
        if (at + 1 < high && sums.used[at + 1]) {
            const double after = residual(at + 1) - right;
            cost += square(after - correlation * now) - square(after - correlation * was);
        }
    }
    return {best, read + std::max<std::int64_t>(last - first + 1, 0)};
}

namespace {

// Refine the accepted between their final neighbours, then take away the weakest while it fails the threshold.
void settle(
    std::vector<Candidate>& accepted, std::int64_t slots, double slope, double correlation, const SumArrays& sums,
    const Bar& bar, std::int64_t& read) {
    const auto before = [&](std::size_t i) { return i > 0 ? accepted[i - 1].index : 0; };
    const auto after = [&](std::size_t i) { return i + 1 < accepted.size() ? accepted[i + 1].index : slots; };
    for (std::size_t i = 0; i < accepted.size(); ++i) {
        auto& index = accepted[i].index;
        const std::int64_t reach = accepted[i].scale;
        const std::int64_t low = std::max(index - 2 * reach, before(i)), high = std::min(index + 2 * reach, after(i));
        index = refine(index, low, high, reach, slope, sums, read);
        if (correlation > 0.0) {
            std::int64_t more;
            std::tie(index, more) = refine_in_colour(index, low, high, reach, slope, correlation, sums);
            read += more;
        }
    }
    std::size_t first = 0, last = accepted.size();  // whose neighbours have changed
    while (true) {
        for (std::size_t i = first; i < last; ++i) {
            const std::int64_t index = accepted[i].index, half = std::max(LONGEST_HALF, 2 * accepted[i].scale);
            const std::int64_t low = std::max(index - half, before(i)), high = std::min(index + half, after(i));
            judge(accepted[i], low, high, slope, sums, bar);
            read += ends(low, index, high);
        }
        const auto weakest =
            std::min_element(accepted.begin(), accepted.end(), [](const Candidate& a, const Candidate& b) {
                return a.excess < b.excess || (std::isnan(a.excess) && !std::isnan(b.excess));
            });
        if (weakest == accepted.end() || weakest->excess >= 1.0) return;
        const std::size_t place = weakest - accepted.begin();
        accepted.erase(weakest);
        first = place > 0 ? place - 1 : 0;
        last = std::min(place + 1, accepted.size());
    }
}

// index, scale, statistic and jump of the candidates, and how many samples were read
using Chosen =
    std::tuple<Table<std::int64_t, 1>, Table<std::int64_t, 1>, Table<double, 1>, Table<double, 1>, std::int64_t>;

// Choose the candidates of a window among the peaks of all scales, given its slope.
Chosen select(
    Integers peak_index, Integers peak_scale, std::int64_t slots, double slope, double correlation,
    const SumArrays& sums, const Bar& bar) {
    std::int64_t read = 0;
    std::vector<Candidate> accepted = accept(peak_index, peak_scale, slots, slope, sums, bar, read);
    settle(accepted, slots, slope, correlation, sums, bar, read);
    const std::size_t count = accepted.size();
    auto index = Table<std::int64_t, 1>::zeros(count), scale = index;
    auto statistic = Table<double, 1>::zeros(count), jump = statistic;
    for (std::size_t i = 0; i < count; ++i) {
        index[i] = accepted[i].index;
        scale[i] = accepted[i].scale;
        statistic[i] = accepted[i].statistic;
        jump[i] = accepted[i].jump;
    }
    return {std::move(index), std::move(scale), std::move(statistic), std::move(jump), read};
}

// Estimate the slope and `select` candidates in turns, until they agree.
Chosen choose(
    Integers peak_index, Integers peak_scale, std::int64_t slots, const SumArrays& sums, const Bar& bar,
    double correlation, double variance, double prior_mean, double prior_std) {
    std::vector<std::int64_t> index = kept_apart(peak_index, peak_scale), exclude(index.size(), STEP / 4);
    std::int64_t read = 0;
    for (int round = 1;; ++round) {
        const double slope =
            std::get<0>(slope_within(slots, view(index), view(exclude), sums, variance, prior_mean, prior_std));
        Chosen chosen = select(peak_index, peak_scale, slots, slope, correlation, sums, bar);
        std::get<4>(chosen) = read += std::get<4>(chosen);
        auto& found = std::get<0>(chosen).values;
        if (round == MOST_ROUNDS || found == index) return chosen;
        index = found;
        exclude = std::get<1>(chosen).values;  // half the scale that detected it
        for (auto& slots_around : exclude) slots_around /= 2;
    }
}

// Slot and scale of a peak behind each long stretch without a used sample; the scale reaches MAX_SCALE beyond it.
std::tuple<Table<std::int64_t, 1>, Table<std::int64_t, 1>> ends_of_gaps(const SumArrays& sums, std::int64_t slots) {
    std::vector<std::int64_t> index, scale;
    std::int64_t begin = -1;  // first slot of the present gap
    for (std::int64_t j = 0; j <= slots / STRIDE; ++j) {
        const std::int64_t end = j * STRIDE;
        if (j < slots / STRIDE && sums.checkpoints(j + 1, 0) == sums.checkpoints(j, 0)) {
            if (begin < 0) begin = end;
            continue;
        }
        if (begin > 0 && end - begin >= LONG_GAP) {
            const bool* last = sums.used.begin() + std::min(end + STRIDE, slots);
            const bool* there = std::find(sums.used.begin() + end, last, true);
            if (there != last) {
                index.push_back(there - sums.used.begin());
                scale.push_back(end - begin + MAX_SCALE);
            }
        }
        begin = -1;
    }
    return {Table<std::int64_t, 1>::from(std::move(index)), Table<std::int64_t, 1>::from(std::move(scale))};
}

}  // namespace

void bind_changepoints(nanobind::module_& module) {
    kernel(module, "contrast", &contrast);
    kernel(module, "kept_apart", [](Integers index, Integers scale) {
        return Table<std::int64_t, 1>::from(kept_apart(index, scale));
    });
    kernel(module, "refine_in_colour", &refine_in_colour);
    kernel(module, "select", &select);
    kernel(module, "choose", &choose);
    kernel(module, "ends_of_gaps", &ends_of_gaps);
}

}  // namespace rwa
