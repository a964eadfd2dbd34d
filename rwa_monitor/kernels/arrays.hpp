// Arrays at the interface between Python and the kernels, and the few numeric functions that stages share.
//
// Array<T, N>   a view of a NumPy array that Python owns; const T is only read. It must be contiguous and of exactly
//               this type: anything else is a TypeError, never a silent copy.
// Table<T, N>   an array that a kernel creates; like a std::vector, it becomes a NumPy array when it is returned.
// A struct with FIELDS is converted from the NamedTuple with the same fields, and returned as a tuple.
//
// Kernels run without the interpreter's lock and check no index: their callers do. `make sanitize` runs the tests with
// every index checked, under AddressSanitizer.
#pragma once

#ifdef RWA_ONBOARD  // without Python, all memory comes from a block of fixed size
#include "onboard/pool.hpp"
#else
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/tuple.h>
#endif

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <limits>
#include <map>
#include <numeric>
#include <ranges>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

// Vectorised loops are compiled for processors with AVX-512, with AVX2 and without; fused multiply-add stays off in all,
// so that they give the same bits.
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && !defined(RWA_SANITIZE)
#define VECTORISED __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define VECTORISED
#endif

// Functions that such loops call are compiled into each of them.
#define ALWAYS_INLINE [[gnu::always_inline]] inline

#ifdef RWA_SANITIZE
#define REQUIRE(condition) ((condition) ? void() : std::abort())
#else
#define REQUIRE(condition) void()
#endif

// The members of a struct, in the order of the fields of its NamedTuple in Python.
#define FIELDS(...) \
    auto fields() { return tie(__VA_ARGS__); }

// A stage: exports its functions and constants under their C++ names.
#ifdef RWA_ONBOARD
#define STAGE(stage, ...)
#else
#define EXPORT(...) define(module, #__VA_ARGS__, __VA_ARGS__)
#define STAGE(stage, ...) \
    const Stage stage_##stage(#stage, [](nanobind::module_& module) { EXPORT(__VA_ARGS__); });
#endif

namespace rwa {
using std::abs, std::clamp, std::erfc, std::exp, std::floor, std::hypot, std::isfinite, std::isnan, std::log, std::log1p,
    std::max, std::min, std::pow, std::rint, std::sqrt;
using std::iota, std::swap;
using std::ranges::all_of, std::ranges::any_of, std::ranges::copy, std::ranges::copy_n,
    std::ranges::fill, std::ranges::fill_n, std::ranges::find, std::ranges::lower_bound, std::ranges::max_element,
    std::ranges::min_element, std::ranges::none_of, std::ranges::nth_element, std::ranges::partial_sort,
    std::ranges::reverse, std::ranges::sort, std::ranges::stable_sort;
using std::array, std::int64_t, std::move, std::size_t, std::tie, std::tuple;
#ifdef RWA_ONBOARD
template <typename T>
using vector = std::vector<T, Pooled<T>>;
#else
using std::vector;
#endif

// The integers from `first` to `last`, exclusive.
constexpr auto range(int64_t first, int64_t last) { return std::views::iota(first, max(first, last)); }
constexpr auto range(int64_t count) { return range(0, count); }

template <typename T, size_t N>
struct Array {
    T* data = nullptr;
    array<int64_t, N> shape{};

    Array() = default;
    Array(T* first, const array<int64_t, N>& extents) : data(first), shape(extents) {}
    // View of a vector.
    template <typename Values>
    Array(Values& values) requires(N == 1) && std::convertible_to<decltype(values.data()), T*>
        : Array(values.data(), {static_cast<int64_t>(values.size())}) {}

    int64_t size() const {
        int64_t product = 1;
        for (auto extent : shape) product *= extent;
        return product;
    }
    T* begin() const { return data; }
    T* end() const { return data + size(); }

    template <typename... Index>
    T& operator()(Index... index) const requires(sizeof...(Index) == N) {
        int64_t place = 0;
        size_t axis = 0;
        ((REQUIRE(index >= 0 && index < shape[axis]), place = place * shape[axis++] + index), ...);
        return data[place];
    }
    T& operator[](int64_t index) const { return (*this)(index); }
    // The sub-array at the first index: a row of a table.
    Array<T, N - 1> row(int64_t index) const {
        REQUIRE(index >= 0 && index < shape[0]);
        Array<T, N - 1> part;
        copy(shape.begin() + 1, shape.end(), part.shape.begin());
        part.data = data + index * part.size();
        return part;
    }
    // The elements [start, stop) of a vector.
    Array slice(int64_t start, int64_t stop) const {
        REQUIRE(start >= 0 && (stop <= start || stop <= shape[0]));
        return {data + start, {max<int64_t>(stop - start, 0)}};
    }
    operator Array<const T, N>() const { return {data, shape}; }
};

template <typename T>
using Vector = Array<T, 1>;
template <typename T>
using Matrix = Array<T, 2>;
using Floats = Vector<const double>;
using Integers = Vector<const int64_t>;
using Flags = Vector<const bool>;
using FloatMatrix = Matrix<const double>;
using IntegerMatrix = Matrix<const int64_t>;
using FloatCube = Array<const double, 3>;
using NewFloats = vector<double>;
using NewIntegers = vector<int64_t>;

template <typename T, size_t N>
struct Table : Array<T, N> {
    vector<T> values;

    Table() = default;
    explicit Table(const array<int64_t, N>& extents, T value = T{}) : Array<T, N>(nullptr, extents) {
        values.assign(this->size(), value);
        this->data = values.data();
    }
    Table(const Table& other) : Array<T, N>(other), values(other.values) { this->data = values.data(); }
    Table(Table&& other) = default;
    Table& operator=(Table&& other) = default;
};

using NewMatrix = Table<double, 2>;
using NewCube = Table<double, 3>;

// The median, as numpy.median, in linear time; the values are reordered.
inline double median_in_place(vector<double>& values) {
    const size_t n = values.size(), half = n / 2;
    nth_element(values, values.begin() + half);
    const double above = values[half];
    return n % 2 == 1 ? above : 0.5 * (*max_element(values.begin(), values.begin() + half) + above);
}

#ifndef RWA_ONBOARD
// The name of each stage, and the function that binds it.
inline std::map<std::string, void (*)(nanobind::module_&)> stages;
struct Stage {
    Stage(const char* name, void (*bind)(nanobind::module_&)) { stages[name] = bind; }
};

// Bind functions and constants under their names, given as one text separated by ", ".
template <typename... Values>
void define(nanobind::module_& module, std::string_view names, Values... values) {
    const auto bind = [&](auto value) {
        const std::string name(names.substr(0, names.find(',')));
        names.remove_prefix(min(name.size() + 2, names.size()));
        if constexpr (std::is_pointer_v<decltype(value)>) {
            module.def(name.c_str(), value, nanobind::call_guard<nanobind::gil_scoped_release>());
        } else {
            module.attr(name.c_str()) = +value;  // an enumeration as its number
        }
    };
    (bind(values), ...);
}
#endif

}  // namespace rwa

#ifndef RWA_ONBOARD
namespace nanobind::detail {

template <typename T, std::size_t N>
struct type_caster<rwa::Array<T, N>> {
    using View = rwa::Array<T, N>;
    using Held = nanobind::ndarray<T, nanobind::ndim<N>, nanobind::c_contig, nanobind::device::cpu>;
    NB_TYPE_CASTER(View, make_caster<Held>::Name)

    bool from_python(handle source, std::uint8_t flags, cleanup_list* cleanup) noexcept {
        // Without conversion: output written to a copy would be lost, and a copy of input would be a hidden cost.
        if (!held.from_python(source, flags & ~static_cast<std::uint8_t>(cast_flags::convert), cleanup)) return false;
        const Held& array = held.value;
        value.data = array.data();
        for (int64_t axis : rwa::range(N)) value.shape[axis] = array.shape(axis);
        return true;
    }

    make_caster<Held> held;  // keeps the array alive for the call
};

template <typename T, std::size_t N>
struct type_caster<rwa::Table<T, N>> {
    using Made = nanobind::ndarray<nanobind::numpy, T, nanobind::ndim<N>>;
    static constexpr auto Name = make_caster<Made>::Name;

    static handle from_cpp(rwa::Table<T, N>&& table, rv_policy, cleanup_list* cleanup) noexcept {
        auto* owned = new std::vector<T>(std::move(table.values));
        capsule owner(owned, [](void* memory) noexcept { delete static_cast<std::vector<T>*>(memory); });
        std::size_t extents[N];
        std::copy(table.shape.begin(), table.shape.end(), extents);
        return make_caster<Made>::from_cpp(Made(owned->data(), N, extents, owner), rv_policy::reference, cleanup);
    }
};

template <typename T>
struct type_caster<std::vector<T>> : type_caster<rwa::Table<T, 1>> {
    static handle from_cpp(std::vector<T>&& values, rv_policy policy, cleanup_list* cleanup) noexcept {
        rwa::Table<T, 1> table;
        table.shape[0] = values.size();
        table.values = std::move(values);
        return type_caster<rwa::Table<T, 1>>::from_cpp(std::move(table), policy, cleanup);
    }
};

template <typename... Field>
std::tuple<Field...> values_of(const std::tuple<Field&...>&);

template <typename T>
    requires requires(T& value) { value.fields(); }
struct type_caster<T> {
    using Values = decltype(values_of(std::declval<T&>().fields()));
    NB_TYPE_CASTER(T, make_caster<Values>::Name)

    bool from_python(handle source, std::uint8_t flags, cleanup_list* cleanup) noexcept {
        if (!held.from_python(source, flags, cleanup)) return false;
        value.fields() = static_cast<Values>(held);
        return true;
    }

    static handle from_cpp(T&& made, rv_policy policy, cleanup_list* cleanup) noexcept {
        const auto converted = [&](auto&... field) {
            return make_caster<Values>::from_cpp(Values(std::move(field)...), policy, cleanup);
        };
        return std::apply(converted, made.fields());
    }

    make_caster<Values> held;
};

}  // namespace nanobind::detail
#endif
