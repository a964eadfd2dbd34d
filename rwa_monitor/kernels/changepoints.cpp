// From the peaks of all scales to the candidates of a window (see rwa_monitor/changepoints/evidence.py).
#include "detection.hpp"

namespace rwa {
namespace {

constexpr int64_t LONGEST_HALF = 1024;  // slots on each side with which a candidate is tested
constexpr int64_t MOST_CANDIDATES = 1000;  // more are not jumps of friction; the first ones accepted are kept
constexpr int MOST_ROUNDS = 3;  // of slope and candidates alternately; two nearly always agree

// Thresholds of a jump: variance of the contrast by used samples of the shorter half, the χ² threshold, and the largest
// outlier by chance.
struct Threshold {
    Floats variances;
    double threshold, outlier;
    FIELDS(variances, threshold, outlier)
};

struct Candidate : Peak {
    double excess;  // of the statistic over its threshold
};

// The sums of [low, middle) and [middle, high).
tuple<Sums, Sums> halves(int64_t low, int64_t middle, int64_t high, const SumArrays& sums) {
    const Sums split = prefix_moments(middle, sums);
    return {split - prefix_moments(low, sums), prefix_moments(high, sums) - split};
}

// Test for a jump at the candidate's slot between the levels of [low, index) and [index, high), given the slope. The
// threshold is higher where a single outlier of the noise could mimic it. All are 0 where a half has no used sample.
void judge(
    Candidate& candidate, int64_t low, int64_t high, double slope, const SumArrays& sums, const Threshold& required) {
    const auto [left, right] = halves(low, candidate.index, high, sums);
    candidate.statistic = candidate.jump = candidate.excess = 0.0;
    if (left.n < 1.0 || right.n < 1.0) return;
    const double jump = right.level(slope) - left.level(slope);
    const double shorter = min(left.n, right.n), longer = max(left.n, right.n), both = left.n + right.n;
    const double variance = required.variances[min<int64_t>(shorter, required.variances.size() - 1)];
    const double information = left.n * right.n / both;
    // An outlier o in the shorter half shifts its mean by o/n.
    const double by_chance = required.outlier * required.outlier * longer / (shorter * both) / variance;
    candidate.statistic = jump * jump * information / variance;
    candidate.jump = jump;
    candidate.excess = candidate.statistic / max(required.threshold, by_chance);
}

// z - slope x of a sample, relative to the centre of the sums.
double residual(int64_t at, double slope, const SumArrays& sums) {
    return (sums.z[at] - sums.centre[1]) - slope * (sums.x[at] - sums.centre[0]);
}

// The most likely slot of a single jump in [low, high) within `reach` of k.
int64_t refine(int64_t k, int64_t low, int64_t high, int64_t reach, double slope, const SumArrays& sums) {
    const int64_t first = max(low + 1, k - reach), last = min(high - 1, k + reach);
    const Sums a = prefix_moments(low, sums), b = prefix_moments(first, sums), c = prefix_moments(high, sums);
    const double e0 = a.z - slope * a.x, e2 = c.z - slope * c.x;
    double n1 = b.n, e1 = b.z - slope * b.x;
    int64_t best = k;
    double best_value = -1.0;
    for (int64_t at : range(first, last + 1)) {
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
        e1 += residual(at, slope, sums);
    }
    return best;
}

// Accept the peaks, in their order, that are significant between those accepted before; sorted by slot.
vector<Candidate> accept(
    const vector<Peak>& peaks, int64_t slots, double slope, const SumArrays& sums, const Threshold& required) {
    vector<Candidate> accepted;
    for (const Peak& peak : peaks) {
        if (accepted.size() == MOST_CANDIDATES) break;
        const int64_t k = peak.index, w = peak.scale;
        const auto place = lower_bound(accepted, k, {}, &Candidate::index);
        if (place != accepted.end() && place->index == k) continue;
        const int64_t before = place != accepted.begin() ? (place - 1)->index : 0;
        const int64_t after = place != accepted.end() ? place->index : slots;
        const int64_t low = max(k - w, before), high = min(k + w, after);
        Candidate candidate{peak, 0.0};
        judge(candidate, low, high, slope, sums, required);
        if (candidate.excess < 1.0) continue;
        candidate.index = refine(k, max(k - 2 * w, before), min(k + 2 * w, after), w, slope, sums);
        accepted.insert(place, candidate);
    }
    return accepted;
}

// The most likely slot of a jump near k in AR(1) noise. With the levels left and right of k, the likelihood of each
// slot follows from the innovations e_k - φ e_{k-1}, in which a jump is a spike: autocorrelation impairs the location
// of a jump less than its detection.
int64_t refine_in_colour(
    int64_t k, int64_t low, int64_t high, int64_t reach, double slope, double correlation, const SumArrays& sums) {
    const auto [before, behind] = halves(low, k, high, sums);
    if (before.n < 1.0 || behind.n < 1.0) return k;
    const double left = before.level(slope), right = behind.level(slope);
    const auto square = [](double value) { return value * value; };
    const double alone = 1.0 - correlation * correlation;  // weight of a sample whose neighbour is masked
    const int64_t first = max(low + 1, k - reach), last = min(high - 1, k + reach);
    int64_t best = k;
    double cost = 0.0, best_cost = INFINITY;
    for (int64_t at : range(first, last + 1)) {
        if (!sums.used[at]) continue;
        if (cost < best_cost) {
            best = at;
            best_cost = cost;
        }
        // Moving the slot `at` to the left level changes its innovation and the next one.
        const double value = residual(at, slope, sums), was = value - right, now = value - left;
        if (sums.used[at - 1]) {
            const double last_one = correlation * (residual(at - 1, slope, sums) - left);
            cost += square(now - last_one) - square(was - last_one);
        } else {
            cost += alone * (now * now - was * was);
        }
        if (at + 1 < high && sums.used[at + 1]) {
            const double after = residual(at + 1, slope, sums) - right;
            cost += square(after - correlation * now) - square(after - correlation * was);
        }
    }
    return best;
}

// Refine the accepted candidates between their final neighbours, then remove the weakest while it is below threshold.
void settle(
    vector<Candidate>& accepted, int64_t slots, double slope, double correlation, const SumArrays& sums,
    const Threshold& required) {
    const auto before = [&](size_t i) { return i > 0 ? accepted[i - 1].index : 0; };
    const auto after = [&](size_t i) { return i + 1 < accepted.size() ? accepted[i + 1].index : slots; };
    for (int64_t i : range(accepted.size())) {
        auto& index = accepted[i].index;
        const int64_t reach = accepted[i].scale;
        const int64_t low = max(index - 2 * reach, before(i)), high = min(index + 2 * reach, after(i));
        index = refine(index, low, high, reach, slope, sums);
        if (correlation > 0.0) index = refine_in_colour(index, low, high, reach, slope, correlation, sums);
    }
    size_t first = 0, last = accepted.size();  // candidates whose neighbours have changed
    while (true) {
        for (int64_t i : range(first, last)) {
            const int64_t index = accepted[i].index, half = max(LONGEST_HALF, 2 * accepted[i].scale);
            const int64_t low = max(index - half, before(i)), high = min(index + half, after(i));
            judge(accepted[i], low, high, slope, sums, required);
        }
        const auto weakest =
            min_element(accepted, [](const Candidate& a, const Candidate& b) {
                return a.excess < b.excess || (isnan(a.excess) && !isnan(b.excess));
            });
        if (weakest == accepted.end() || weakest->excess >= 1.0) return;
        const size_t place = weakest - accepted.begin();
        accepted.erase(weakest);
        first = place > 0 ? place - 1 : 0;
        last = min(place + 1, accepted.size());
    }
}

}  // namespace

tuple<double, double> contrast(int64_t k, int64_t w, double slope, double weight, const SumArrays& sums) {
    const auto [left, right] = halves(k - w, k, k + w, sums);
    if (left.n < 1.0 || right.n < 1.0) return {0.0, 0.0};
    const Sums whole = prefix_moments(k + w, sums) - prefix_moments(k - w, sums);
    const double xl = left.x / left.n, xr = right.x / right.n;
    const double el = left.z / left.n - slope * xl, er = right.z / right.n - slope * xr;
    const double spread = max(whole.xx - left.n * xl * xl - right.n * xr * xr, 0.0);
    const double tilt = whole.xz - slope * whole.xx - left.n * xl * el - right.n * xr * er;
    const double step = (xr - xl) / (spread + weight);
    const double jump = er - el - step * tilt;
    return {jump * jump / (1.0 / left.n + 1.0 / right.n + (xr - xl) * step), jump};
}

void sort_in_turn(vector<Peak>& peaks) {
    sort(peaks, [](const Peak& a, const Peak& b) {
        return tie(a.scale, b.statistic, a.index) < tie(b.scale, a.statistic, b.index);
    });
}

NewIntegers kept_apart(const vector<Peak>& peaks) {
    NewIntegers taken;
    for (const Peak& peak : peaks) {
        const auto near = [&](int64_t slot) { return abs(slot - peak.index) <= peak.scale; };
        if (none_of(taken, near)) taken.push_back(peak.index);
    }
    sort(taken);
    return taken;
}

// Choose the candidates of a window among the peaks of all scales, in any order: alternately estimate the slope and
// choose given the slope, until the choice does not change.
Columns choose(
    Integers peak_index, Integers peak_scale, Floats peak_statistic, int64_t slots, const SumArrays& sums,
    const Threshold& required, double correlation, double variance, double prior_mean, double prior_std) {
    vector<Peak> peaks;
    for (int64_t i : range(peak_index.size())) {
        peaks.push_back({peak_index[i], peak_scale[i], peak_statistic[i], 0.0});
    }
    sort_in_turn(peaks);
    NewIntegers index = kept_apart(peaks), exclude(index.size(), BLOCK / 4);
    for (int round = 1;; ++round) {
        const double slope = std::get<0>(slope_within(slots, index, exclude, sums, variance, prior_mean, prior_std));
        vector<Candidate> accepted = accept(peaks, slots, slope, sums, required);
        settle(accepted, slots, slope, correlation, sums, required);
        Columns chosen = columns_of(accepted);
        if (round == MOST_ROUNDS || std::get<0>(chosen) == index) return chosen;
        index = std::get<0>(chosen);
        exclude = std::get<1>(chosen);  // half the scale that detected it
        for (auto& slots_around : exclude) slots_around /= 2;
    }
}

STAGE(changepoints, contrast, refine_in_colour, choose)

}  // namespace rwa
