// The detector of rwa_detector.h, around the kernel of a window: what rwa_monitor/changepoints/evidence.py does there.
#include "rwa_detector.h"

#include "../evidence.cpp"

#include <new>

// What libstdc++'s vectors call where a size is absurd, so that the library links without it: they never do.
namespace std {
[[noreturn, gnu::weak]] void __throw_length_error(const char*) { abort(); }
}  // namespace std

namespace rwa {
namespace {
constexpr int64_t ALL_SCALES[] = {1, 2, 4, 8, 16, 32, 64, 128};
// Fixed: histogram, prefix sums, peaks and what sorts them; measured with windows full of jumps, and half as much again.
constexpr std::size_t FIXED_BYTES = 3'000'000, BYTES_PER_SLOT = 40;

double interpolate(double at, const double* x, const double* y, int64_t n) {
    if (!(at > x[0])) return y[0];
    for (int64_t i : rwa::range(1, n)) {
        if (at <= x[i]) return y[i - 1] + (y[i] - y[i - 1]) / (x[i] - x[i - 1]) * (at - x[i - 1]);
    }
    return y[n - 1];
}
}  // namespace
}  // namespace rwa

struct rwa_detector {
    rwa_detector(const rwa_detector_settings& by, rwa::Pool* memory)
        : settings(by), pool(memory), x(by.slots), z(by.slots), running(6), centre(2), good(by.slots), used(by.slots),
          checkpoints({by.slots / rwa::STRIDE + 1, 6}), block_sums({by.slots / by.block_hop + 1, rwa::LAGS}),
          block_pairs(block_sums.shape), window(arrays(), kernel_settings(), scales()) {}

    static rwa::Vector<bool> flags(rwa::vector<unsigned char>& values) {
        return {reinterpret_cast<bool*>(values.data()), {static_cast<int64_t>(values.size())}};
    }
    rwa::WindowArrays arrays() {
        return {x, flags(good), {checkpoints, x, z, flags(used), centre}, running, block_sums, block_pairs, {}};
    }
    rwa::WindowSettings kernel_settings() const {
        return {settings.speed_unit, settings.torque_unit, 0.0, settings.block_hop, 0, settings.dead_band,
                settings.start_std, settings.prior_mean, settings.prior_std, settings.nominal_slope,
                settings.outlier, settings.sure_outlier, settings.sure_margin,
                settings.sure_statistic, settings.jump_share};
    }
    // Without any idea of the slope, two neighbouring samples show nothing of a jump.
    rwa::Integers scales() const {
        const int64_t first = rwa::isnan(settings.prior_std);
        return {rwa::ALL_SCALES + first, {8 - first}};
    }

    // `_outliers` of evidence.py, of tails that are heavy.
    void learn_tails() {
        const auto [total, median, far] = window.quantiles;
        const double std = rwa::sqrt(median / rwa::CHI_MEDIAN), ratio = far / median;
        const auto size = [&](const double* of) {
            return std * rwa::interpolate(ratio, settings.tail_ratio, of, RWA_TAIL_NODES);
        };
        window.set_outlier(size(settings.tail_outlier), size(settings.tail_sure));
    }

    rwa_detector_settings settings;
    rwa::Pool* pool;
    rwa::NewFloats x, z, running, centre;
    rwa::vector<unsigned char> good, used;
    rwa::NewMatrix checkpoints, block_sums, block_pairs;
    rwa::Window window;
};

namespace {
// In front of the memory that the pool gives.
struct Opened {
    rwa::Pool pool;
    alignas(rwa_detector) unsigned char detector[sizeof(rwa_detector)];
};
}  // namespace

size_t rwa_detector_bytes(const rwa_detector_settings* settings) {
    return sizeof(Opened) + rwa::FIXED_BYTES + rwa::BYTES_PER_SLOT * static_cast<std::size_t>(settings->slots);
}

rwa_detector* rwa_detector_open(const rwa_detector_settings* settings, void* memory, size_t bytes) {
    if (!memory || settings->slots < 1 || bytes < rwa_detector_bytes(settings)) return nullptr;
    Opened* const opened = new (memory) Opened;
    opened->pool.open(opened + 1, bytes - sizeof(Opened));
    rwa::pool = &opened->pool;
    return new (opened->detector) rwa_detector(*settings, &opened->pool);
}

int64_t rwa_detector_add(
    rwa_detector* detector, const double* speed, const double* friction, int64_t count, rwa_jump* jumps, int64_t most) {
    rwa_detector& of = *detector;
    if (count < 0 || of.window.filled + count > of.settings.slots) return -1;
    rwa::pool = of.pool;
    bool there[rwa::BLOCK];  // NaN is not good
    rwa::fill_n(there, rwa::BLOCK, true);
    int64_t found = 0;
    for (int64_t first = 0; first < count; first += rwa::BLOCK) {
        int64_t n = rwa::min(rwa::BLOCK, count - first), reported = 0;
        for (bool heavy = true; heavy; n = 0) {
            std::tie(std::ignore, reported, heavy) =
                of.window.gather({speed + first, {n}}, {friction + first, {n}}, {there, {n}}, {}, false);
            const auto& [slots, sizes, stds, normalised] = of.window.reported;
            for (int64_t i = 0; i < reported; ++i, ++found) {
                if (found >= most) continue;
                const double unit = of.settings.torque_unit;
                jumps[found] = {slots[i], sizes[i] * unit, stds[i] * unit};
            }
            if (heavy) of.learn_tails();
        }
    }
    return found;
}

size_t rwa_detector_most_used(const rwa_detector* detector) { return sizeof(Opened) + detector->pool->most_used; }
