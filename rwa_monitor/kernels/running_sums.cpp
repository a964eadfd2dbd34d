// Running sums; slope and residuals of friction over them (rwa_monitor/changepoints/running_sums.py, estimation.py).
#include "detection.hpp"

namespace rwa {
namespace {
// The statistics, not centred, of the slots [start, stop).
Sums moments(int64_t start, int64_t stop, const SumArrays& arrays) {
    if (stop <= start) return {};
    return moments_between(prefix_moments(start, arrays), prefix_moments(stop, arrays), arrays.centre);
}

// Centre empty sums on the medians of the first used slots of [start, stop), about to be added: a first sample that is
// an outlier must not become the centre. Not inlined: that would halve the speed of the loop of `extend_sums`.
[[gnu::noinline]] void find_centre(const SumArrays& arrays, Floats running, int64_t start, int64_t stop) {
    if (running[0] > 0.0) return;
    const bool* const first = find(arrays.used.data + start, arrays.used.data + stop, true);
    const int64_t begin = first - arrays.used.data;
    if (begin >= stop) return;
    NewFloats x, z;
    for (int64_t k : range(begin, min(stop, begin - begin % BLOCK + BLOCK))) {
        if (!arrays.used[k]) continue;
        x.push_back(arrays.x[k]);
        z.push_back(arrays.z[k]);
    }
    arrays.centre[0] = median_in_place(x);
    arrays.centre[1] = median_in_place(z);
}

}  // namespace

void extend_sums(const SumArrays& arrays, Vector<double> running, int64_t start, int64_t stop) {
    find_centre(arrays, running, start, stop);
    const double* __restrict x = arrays.x.data;
    const double* __restrict z = arrays.z.data;
    const bool* __restrict used = arrays.used.data;
    const double x_centre = arrays.centre[0], z_centre = arrays.centre[1];
    double sums[6];  // one array: with six variables GCC vectorises half of them, which takes twice the time
    copy(running, sums);
    for (int64_t k = start; k < stop;) {
        const int64_t checkpoint = k - k % STRIDE + STRIDE;
        for (; k < min(checkpoint, stop); ++k) {
            if (!used[k]) continue;
            const double u = x[k] - x_centre, v = z[k] - z_centre;
            const double terms[6] = {1.0, u, v, u * u, u * v, v * v};
            for (int64_t i : range(6)) sums[i] += terms[i];
        }
        if (k == checkpoint) copy(sums, sums + 6, &arrays.checkpoints(k / STRIDE, 0));
    }
    copy(sums, running.begin());
}

// Write the statistics of each range [start, stop), not centred, to `out` (6, m); returns whether all slots lie in
// [0, slots].
bool range_moments(Integers start, Integers stop, int64_t slots, const SumArrays& arrays, Matrix<double> out) {
    for (int64_t i : range(start.size())) {
        if (min(start[i], stop[i]) < 0 || max(start[i], stop[i]) > slots) return false;
        moments(start[i], stop[i], arrays).write(&out(0, i), start.size());
    }
    return true;
}

// Each interval is used without `exclude` slots on each side of each changepoint, at most a quarter of it at each end;
// where that leaves no used sample, with all its slots.
tuple<double, double> slope_within(
    int64_t slots, Integers index, Integers exclude, const SumArrays& arrays, double variance, double prior_mean,
    double prior_std) {
    double sxx = 0.0, sxz = 0.0, xx = 0.0;  // the first two about the intervals' own means
    for (int64_t i : range(index.size() + 1)) {
        const int64_t first = i > 0 ? index[i - 1] : 0, last = i < index.size() ? index[i] : slots;
        const int64_t most = (last - first) / 4;
        Sums sum = moments(
            first + (i > 0 ? min(exclude[i - 1], most) : 0),
            last - (i < index.size() ? min(exclude[i], most) : 0), arrays);
        if (sum.n == 0.0) sum = moments(first, last, arrays);
        const double share = 1.0 / max(sum.n, 1.0);
        sxx += max(sum.xx - sum.x * sum.x * share, 0.0);
        sxz += sum.xz - sum.x * sum.z * share;
        xx += sum.xx;
    }
    if (!(sxx > 1e-11 * xx)) sxx = sxz = 0.0;  // below this, S_xx is the rounding of Σx²
    if (!isnan(prior_std)) {
        const double weight = variance / (prior_std * prior_std);
        sxx += weight;
        sxz += weight * prior_mean;
    }
    if (sxx == 0.0) return {0.0, INFINITY};
    return {sxz / sxx, sqrt(variance / sxx)};
}

// ---- direction, dead band and wheel angle: not used before the close of a window ------------------------------------

#ifndef RWA_ONBOARD
namespace {
// Slots of a segment in which the friction is compared with the angle: long enough that a ripple of half the noise's
// standard deviation has five times the power of noise in a segment, short enough that the phase stays coherent in
// spite of the speed's noise (`torque_ripple.coherent_slots`: 278 slots for the 48th harmonic at 0.01 rad/s and 8 Hz).
constexpr int64_t STRETCH = 256;
constexpr int64_t SIDE = 16;  // √STRETCH
// A tachometer's dead zone: readings of exactly zero, then a first one further from zero than the speed's noise and
// than the next ones are from each other. With coarse quantisation it is not; a reading of zero from full speed is a
// telemetry fault.
constexpr double FEWEST_ZEROS = 3.0, GAP_IN_STEPS = 3.0;
constexpr double LARGEST_GAP = 0.1;  // of the nominal speed
// Turns in a slot, modulo whole ones, below which a harmonic mimics slow friction: four in a segment. For faster ones
// the power of a jump in a segment is at most 0.81 / (STRETCH·turns²) = 13, where that of noise is 2, whatever its
// size. At constant speed a harmonic has the same turns in each segment: for slower ones, jumps would add up to a
// ripple.
constexpr double SLOWEST_TURNS = 4.0 / STRETCH;

// A quarter of a turn in two parts, of which the first has so few digits that any whole multiple of it is exact.
constexpr double QUARTER_HIGH = static_cast<float>(0.5 * M_PI), QUARTER_LOW = 0.5 * M_PI - QUARTER_HIGH;

// (-1)ⁿ/(2n + 1)! and (-1)ⁿ/(2n)!, the highest power first; the next ones are below 1e-16 at an eighth of a turn.
constexpr double SINE_TERMS[] = {-1.0 / 1307674368000.0, 1.0 / 6227020800.0, -1.0 / 39916800.0, 1.0 / 362880.0,
                                 -1.0 / 5040.0,          1.0 / 120.0,        -1.0 / 6.0,        1.0};
constexpr double COSINE_TERMS[] = {1.0 / 20922789888000.0, -1.0 / 87178291200.0, 1.0 / 479001600.0, -1.0 / 3628800.0,
                                   1.0 / 40320.0,          -1.0 / 720.0,         1.0 / 24.0,        -1.0 / 2.0,
                                   1.0};

// cos and sin of each angle [rad]: vectorised, and the same on every machine, unlike libm's. Taylor's series, exact to
// the last digit within an eighth of a turn of the nearest quarter; the error from rounding the quarters is below 1e-16
// of the angle.
VECTORISED void rotations(
    const double* __restrict angle, int64_t n, double* __restrict cosine, double* __restrict sine) {
    for (int64_t k : range(n)) {
        const double quarters = rint(angle[k] * (2.0 / M_PI));
        const double r = (angle[k] - quarters * QUARTER_HIGH) - quarters * QUARTER_LOW;
        const double y = r * r;
        double near_sine = SINE_TERMS[0], near_cosine = COSINE_TERMS[0];
#pragma GCC unroll 8
        for (int64_t term : range(1, 8)) near_sine = near_sine * y + SINE_TERMS[term];
#pragma GCC unroll 8
        for (int64_t term : range(1, 9)) near_cosine = near_cosine * y + COSINE_TERMS[term];
        near_sine *= r;
        const double place = quarters - 4.0 * floor(0.25 * quarters);  // 0, 1, 2 or 3
        const bool odd = (place == 1.0) | (place == 3.0);
        sine[k] = (odd ? near_cosine : near_sine) * (place >= 2.0 ? -1.0 : 1.0);
        cosine[k] = (odd ? near_sine : near_cosine) * ((place == 1.0) | (place == 2.0) ? -1.0 : 1.0);
    }
}

// The sum of each column of (SIDE, SIDE), by pairwise additions, vectorised over the columns.
inline void add_up_columns(const double* square, double* sums) {
    for (int64_t c : range(SIDE)) {
        const auto at = [&](int64_t row) { return square[row * SIDE + c]; };
        sums[c] = (((at(0) + at(1)) + (at(2) + at(3))) + ((at(4) + at(5)) + (at(6) + at(7)))) +
                  (((at(8) + at(9)) + (at(10) + at(11))) + ((at(12) + at(13)) + (at(14) + at(15))));
    }
}

// 2|Σ e exp(ihθ)|² / Σ e² of each harmonic h, e the friction of a segment less a straight line in time; not written for
// harmonics slower than SLOWEST_TURNS.
VECTORISED void ripple_power(const double* x, const double* z, double angle_per_x, double* power, int64_t harmonics) {
    double mean = 0.0, tilt = 0.0, spread = 0.0;
    for (int64_t k : range(STRETCH)) {
        const double time = k - 0.5 * (STRETCH - 1);
        mean += z[k];
        tilt += time * z[k];
        spread += time * time;
    }
    mean /= STRETCH;
    tilt /= spread;
    double angle[STRETCH], c[STRETCH], s[STRETCH], real[STRETCH], imaginary[STRETCH];
    angle[0] = 0.0;
    for (int64_t k : range(1, STRETCH)) angle[k] = angle[k - 1] + 0.5 * (x[k - 1] + x[k]) * angle_per_x;
    rotations(angle, STRETCH, c, s);
    double energy = 0.0;
    for (int64_t k : range(STRETCH)) {
        const double e = z[k] - mean - tilt * (k - 0.5 * (STRETCH - 1));
        energy += e * e;
        real[k] = e * c[k];
        imaginary[k] = e * s[k];
    }
    for (int64_t h : range(harmonics)) {
        double real_sums[SIDE], imaginary_sums[SIDE];
        add_up_columns(real, real_sums);
        add_up_columns(imaginary, imaginary_sums);
        for (int64_t k : range(STRETCH)) {  // rotate all to the next harmonic
            const double turned = real[k] * c[k] - imaginary[k] * s[k];
            imaginary[k] = real[k] * s[k] + imaginary[k] * c[k];
            real[k] = turned;
        }
        const double turns = (h + 1) * angle[STRETCH - 1] / (2.0 * M_PI * (STRETCH - 1));
        if (abs(turns - rint(turns)) < SLOWEST_TURNS) continue;
        double r = 0.0, i = 0.0;
        for (int64_t column : range(SIDE)) {
            r += real_sums[column];
            i += imaginary_sums[column];
        }
        power[h] = 2.0 * (r * r + i * i) / max(energy, 1e-300);
    }
}

// Count runs of zeros, and those that end in a gap (plateaus). `state` (5,), carried from piece to piece: zeros in a
// row, the first and the second reading after them, runs of zeros and plateaus so far.
void find_plateaus(Floats x, Flags good, double certain, Vector<double> state) {
    for (int64_t k : range(x.size())) {
        if (state[0] == 0.0 && x[k] != 0.0) continue;
        if (good[k] && x[k] == 0.0) {
            state[0] += 1.0;
            state[1] = state[2] = 0.0;  // noise may carry a reading over the zone's edge and back
        } else if (!good[k] || state[0] < FEWEST_ZEROS) {
            state[0] = state[1] = state[2] = 0.0;
        } else if (state[1] == 0.0) {
            state[1] = x[k];
        } else if (state[2] == 0.0) {
            state[2] = x[k];
        } else {
            const double largest = max(abs(x[k] - state[2]), abs(state[2] - state[1]));
            state[3] += 1.0;
            if (largest > 0.0 && max(GAP_IN_STEPS * largest, certain) < state[1] && state[1] < LARGEST_GAP) {
                state[4] += 1.0;
            }
            state[0] = state[1] = state[2] = 0.0;
        }
    }
}
}  // namespace

// Add the good slots, and the forward less the backward ones, to their blocks; `first` is the slot of the first sample.
VECTORISED void count_signs(int64_t first, Floats speed, Flags good, Vector<int64_t> signs, Vector<int64_t> counts) {
    const double* __restrict turning = speed.data;
    const auto* __restrict there = reinterpret_cast<const unsigned char*>(good.data);  // else not vectorised
    for (int64_t start = 0; start < speed.size();) {
        const int64_t block = (first + start) / BLOCK, stop = min((block + 1) * BLOCK - first, speed.size());
        int64_t count = 0, forward = 0;
        for (; start < stop; ++start) {
            const int64_t is_good = there[start];
            count += is_good;
            forward += turning[start] > 0.0 ? is_good : 0;
        }
        counts[block] += count;
        signs[block] += 2 * forward - count;
    }
}

// Add the slots [start, stop), which follow those added before, to the samples near zero, the plateaus and the ripple.
void extend_structure(
    Floats motion, Floats x, Floats z, Flags good, Flags used, int64_t start, int64_t stop, double certain,
    double angle_per_x, int64_t hop, const StructureArrays& arrays) {
    for (int64_t first = start; first < stop;) {
        const int64_t block = first / BLOCK, end = min((block + 1) * BLOCK, stop), n = end - first;
        if (!std::equal(&good[first], &good[first] + n, &used[first])) {  // in few blocks, as below
            for (int64_t k : range(first, end)) {
                if (!good[k] || used[k] || !(motion[k] > certain)) continue;
                arrays.near_zero(0, block) += 1.0;
                arrays.near_zero(1, block) += x[k];
                arrays.near_zero(2, block) += z[k];
                arrays.near_zero(3, block) += z[k] * z[k];
            }
        }
        if (arrays.zeros[0] != 0.0 || find(&motion[first], &motion[first] + n, 0.0) != &motion[first] + n) {
            find_plateaus(motion.slice(first, end), good.slice(first, end), certain, arrays.zeros);
        }
        first = end;
    }
    for (int64_t stretch : range(pieces_before(start, STRETCH, hop), pieces_before(stop, STRETCH, hop))) {
        const int64_t from = stretch * hop;
        if (all_of(&used[from], &used[from] + STRETCH, [](bool taken) { return taken; })) {
            ripple_power(&motion[from], &z[from], angle_per_x, &arrays.ripple(stretch, 0), arrays.ripple.shape[1]);
        }
    }
}
#endif

STAGE(running_sums, STRIDE, extend_sums, range_moments, slope_within, BLOCK, STRETCH, count_signs,
      extend_structure)

}  // namespace rwa
