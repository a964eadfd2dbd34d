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

STAGE(ingest, judge, HANGING_SLOTS, OUTSTANDING_SLOTS, HANGS, STANDS_OUT)

}  // namespace rwa
