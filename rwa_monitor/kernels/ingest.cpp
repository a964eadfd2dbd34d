#include "arrays.hpp"

namespace rwa {
namespace {

constexpr int64_t HANGING_SLOTS = 24;     // repetitions of a value in a row: with noise, a probability of 6e-8
constexpr int64_t OUTSTANDING_SLOTS = 3;  // slots in a row that may be outliers together
enum { HANGS = 1, STANDS_OUT };
// A channel is noisy ("restless") while its second differences change sign in more than this share of the recent slots:
// they do so in 73 % with white noise, in 67 % with a random walk, hardly ever in smooth motion without noise.
constexpr double RESTLESS = 0.5;
constexpr double ROUNDING = 1e-9;        // smaller second differences, relative to the value, are rounding, not noise
constexpr double RECENT_SLOTS = 128;     // over which restlessness and roughness are averaged
constexpr double ROUGHNESS_FACTOR = 6;   // mean steps between neighbours: seven standard deviations of white noise
constexpr double STEPS_TO_JUDGE = 16;    // needed before roughness is known well enough

// Python's // for integers: rounded down, also below zero.
int64_t floor_divide(int64_t a, int64_t b) { return a / b - (a % b != 0 && (a < 0) != (b < 0)); }

// Assign samples to slots, as SlotGrid.slot_of, up to a clock step or a slot beyond `furthest`; mark those later than
// all before. Returns the number of samples in the piece, how many of them are ahead, and how many of those are good.
tuple<int64_t, int64_t, int64_t> assign_slots(
    Integers time_ns, Flags good, int64_t origin_ns, int64_t period_ns, int64_t frontier, int64_t furthest,
    int64_t window_slots, bool passed, Vector<int64_t> slots, Vector<bool> ahead) {
    int64_t before = frontier - 1, ahead_count = 0, used = 0;
    for (int64_t k : range(time_ns.size())) {
        const int64_t doubled = 2 * (time_ns[k] - origin_ns) + period_ns;
        const int64_t slot = floor_divide(doubled, 2 * period_ns), step = slot - before;
        const bool far = abs(step) > window_slots;
        if ((far && !passed) || (k > 0 && slot > furthest)) return {k, ahead_count, used};
        slots[k] = slot;
        ahead[k] = step > 0 && !(passed && far);
        ahead_count += ahead[k];
        used += ahead[k] && good[k];
        before = max(before, slot);
    }
    return {time_ns.size(), ahead_count, used};
}

// The state of a channel, see slots.Channel.
struct Memory {
    double recent[OUTSTANDING_SLOTS], last, step, bend, restless, repeated, restless_before, rough, steps;
};

// Test the next slots of a channel, each with the one after it (see slots.Channel); returns whether a fault is found.
bool judge(
    Floats values, Floats following, double limit, Vector<double> state, Vector<std::int8_t> kind,
    Vector<int64_t> since) {
    Memory memory = *reinterpret_cast<Memory*>(state.data);  // a copy, which the loop keeps in registers
    auto& [recent, last, step, bend, restless, repeated, restless_before, rough, steps] = memory;
    const auto at = [&](int64_t k) { return k < 0 ? recent[k + OUTSTANDING_SLOTS] : values[k]; };
    const int64_t n = values.size();
    bool found = false;
    for (int64_t k : range(n)) {
        const double value = values[k];
        if (isnan(value)) continue;
        const double after = following[k], far = limit + ROUGHNESS_FACTOR * rough / max(steps, 1.0);
        // Are this slot, and perhaps some before it, far from both the slot before them and the one after?
        if (steps >= STEPS_TO_JUDGE && abs(value - after) > far) {
            for (int64_t count : range(1, OUTSTANDING_SLOTS + 1)) {
                const double anchor = at(k - count);
                if (abs(after - anchor) <= 0.5 * far && abs(value - anchor) > count * far) {
                    kind[k] = STANDS_OUT, since[k] = count - 1;
                    found = true;
                    break;
                }
            }
        }
        const double distance = abs(value - at(k - 1));
        if (distance <= far) {
            rough += distance - rough / RECENT_SLOTS;
            steps += 1.0 - steps / RECENT_SLOTS;
        }
        if (!isnan(last)) {
            if (value != last) {
                repeated = 0.0;
            } else {
                if (repeated == 0.0) restless_before = restless;
                repeated += 1.0;
            }
            const double next_step = value - last, next_bend = next_step - step;
            // Without a branch: in noise it would be unpredictable.
            const bool turns = (next_bend * bend < 0.0) & (abs(next_bend) > ROUNDING * abs(value));
            restless += (turns - restless) / RECENT_SLOTS;
            step = next_step, bend = next_bend;
        }
        last = value;
        if (repeated >= HANGING_SLOTS && restless_before > RESTLESS) {
            kind[k] = HANGS, since[k] = repeated == HANGING_SLOTS ? HANGING_SLOTS - 1 : 0;
            found = true;
        }
    }
    for (int64_t i : range(OUTSTANDING_SLOTS)) recent[i] = at(n - OUTSTANDING_SLOTS + i);
    *reinterpret_cast<Memory*>(state.data) = memory;
    return found;
}

}  // namespace

STAGE(ingest, assign_slots, judge, HANGING_SLOTS, OUTSTANDING_SLOTS, HANGS, STANDS_OUT)

}  // namespace rwa
