// Arrays at the border between Python and the kernels, and the few functions of numbers that stages share.
//
// Array<T, N>   a view of a NumPy array that Python owns; const T is only read. It must be contiguous and of just this
//               type: anything else is a TypeError, never a silent copy.
// Table<T, N>   an array that a kernel makes; it becomes a NumPy array when it is returned.
// A struct with a member `fields()` that ties its members in their order is taken from the NamedTuple of that shape.
//
// Kernels run without the interpreter's lock (`kernel(module, "name", function)`) and check no index: what calls them
// does. `make sanitize` runs the tests with every index checked, under AddressSanitizer.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
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

// What such loops share is compiled into each of them.
#define ALWAYS_INLINE [[gnu::always_inline]] inline

#ifdef RWA_SANITIZE
#define REQUIRE(condition) ((condition) ? void() : std::abort())
#else
#define REQUIRE(condition) void()
#endif

namespace rwa {
using std::int64_t;

template <typename T, std::size_t N>
struct Array {
    T* data = nullptr;
    std::array<std::size_t, N> shape{};

    int64_t size() const {
        std::size_t product = 1;
        for (auto extent : shape) product *= extent;
        return static_cast<int64_t>(product);
    }
    int64_t extent(std::size_t axis) const { return static_cast<int64_t>(shape[axis]); }
    T* begin() const { return data; }
    T* end() const { return data + size(); }

    template <typename... Index>
    T& operator()(Index... index) const {
        static_assert(sizeof...(Index) == N, "one index for each axis");
        std::size_t place = 0, axis = 0;
        ((REQUIRE(static_cast<std::size_t>(index) < shape[axis]),
          place = place * shape[axis++] + static_cast<std::size_t>(index)), ...);
        return data[place];
    }
    T& operator[](int64_t index) const {
        static_assert(N == 1, "use (i, j)");
        REQUIRE(static_cast<std::size_t>(index) < shape[0]);
        return data[index];
    }
    // The sub-array at the first index: a row of a table.
    Array<T, N - 1> row(int64_t index) const {
        static_assert(N > 1, "a vector has no rows");
        REQUIRE(static_cast<std::size_t>(index) < shape[0]);
        Array<T, N - 1> part;
        std::size_t product = 1;
        for (std::size_t axis = 1; axis < N; ++axis) product *= part.shape[axis - 1] = shape[axis];
        part.data = data + static_cast<std::size_t>(index) * product;
        return part;
    }
    // The elements [start, stop) of a vector.
    Array slice(int64_t start, int64_t stop) const {
        static_assert(N == 1, "only of a vector");
        REQUIRE(start >= 0 && (stop <= start || static_cast<std::size_t>(stop) <= shape[0]));
        return {data + start, {static_cast<std::size_t>(stop > start ? stop - start : 0)}};
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
template <typename T>
Vector<const T> view(const std::vector<T>& values) {
    return {values.data(), {values.size()}};
}

template <typename T, std::size_t N>
struct Table {
    std::vector<T> values;
    std::array<std::size_t, N> shape{};

    Table() = default;
    // Filled with `value`, as numpy.full.
    template <typename... Extent>
    static Table full(T value, Extent... extents) {
        static_assert(sizeof...(Extent) == N, "one extent for each axis");
        Table table;
        table.shape = {static_cast<std::size_t>(extents)...};
        std::size_t product = 1;
        for (auto extent : table.shape) product *= extent;
        table.values.assign(product, value);
        return table;
    }
    template <typename... Extent>
    static Table zeros(Extent... extents) {
        return full(T{}, extents...);
    }
    static Table from(std::vector<T> values) {
        static_assert(N == 1, "only a vector");
        Table table;
        table.shape = {values.size()};
        table.values = std::move(values);
        return table;
    }
    Array<T, N> view() { return {values.data(), shape}; }
    Array<const T, N> view() const { return {values.data(), shape}; }
    template <typename... Index>
    T& operator()(Index... index) {
        return view()(index...);
    }
    T& operator[](int64_t index) { return values[static_cast<std::size_t>(index)]; }
};

using NewFloats = Table<double, 1>;
using NewIntegers = Table<int64_t, 1>;

// Python's // and % for whole numbers: rounded down, also below zero.
inline int64_t floor_divide(int64_t a, int64_t b) {
    int64_t quotient = a / b;
    return (a % b != 0 && ((a < 0) != (b < 0))) ? quotient - 1 : quotient;
}
inline int64_t modulo(int64_t a, int64_t b) { return a - b * floor_divide(a, b); }

// The mean of the two values in the middle, as numpy.median, in linear time; the values are reordered.
inline double median_in_place(std::vector<double>& values) {
    const std::size_t n = values.size(), half = n / 2;
    std::nth_element(values.begin(), values.begin() + half, values.end());
    const double above = values[half];
    return n % 2 == 1 ? above : 0.5 * (*std::max_element(values.begin(), values.begin() + half) + above);
}

template <typename Function, typename... Extra>
void kernel(nanobind::module_& module, const char* name, Function&& function, const Extra&... extra) {
    module.def(name, std::forward<Function>(function), nanobind::call_guard<nanobind::gil_scoped_release>(), extra...);
}

}  // namespace rwa

namespace nanobind::detail {

template <typename T, std::size_t N>
struct type_caster<rwa::Array<T, N>> {
    using View = rwa::Array<T, N>;
    using Held = nanobind::ndarray<T, nanobind::ndim<N>, nanobind::c_contig, nanobind::device::cpu>;
    NB_TYPE_CASTER(View, make_caster<Held>::Name)

    bool from_python(handle source, std::uint8_t flags, cleanup_list* cleanup) noexcept {
        // Without conversion: a copy of what a kernel writes to would be lost, one of what it reads hidden work.
        if (!held.from_python(source, flags & ~static_cast<std::uint8_t>(cast_flags::convert), cleanup)) return false;
        const Held& array = held.value;
        value.data = array.data();
        for (std::size_t axis = 0; axis < N; ++axis) value.shape[axis] = array.shape(axis);
        return true;
    }

    make_caster<Held> held;  // keeps the array alive for the call
};

template <typename T, std::size_t N>
struct type_caster<rwa::Table<T, N>> {
    using Made = rwa::Table<T, N>;
    using Array = nanobind::ndarray<nanobind::numpy, T, nanobind::ndim<N>>;
    static constexpr auto Name = make_caster<Array>::Name;

    static handle from_cpp(Made&& table, rv_policy, cleanup_list* cleanup) noexcept {
        auto* owned = new std::vector<T>(std::move(table.values));
        capsule owner(owned, [](void* memory) noexcept { delete static_cast<std::vector<T>*>(memory); });
        return make_caster<Array>::from_cpp(Array(owned->data(), N, table.shape.data(), owner), rv_policy::reference, cleanup);
    }
};

template <typename T, typename = int>
struct is_named_tuple : std::false_type {};
template <typename T>
struct is_named_tuple<T, decltype((void)std::declval<T&>().fields(), 0)> : std::true_type {};

template <typename T>
struct type_caster<T, enable_if_t<is_named_tuple<T>::value>> {
    NB_TYPE_CASTER(T, const_name("tuple"))

    using Fields = decltype(std::declval<T&>().fields());
    template <std::size_t I>
    using Field = std::remove_reference_t<std::tuple_element_t<I, Fields>>;
    static constexpr std::size_t Count = std::tuple_size_v<Fields>;

    bool from_python(handle source, std::uint8_t flags, cleanup_list* cleanup) noexcept {
        if (!PyTuple_Check(source.ptr()) || PyTuple_GET_SIZE(source.ptr()) != Count) return false;
        return each(source, flags, cleanup, std::make_index_sequence<Count>());
    }

   private:
    template <std::size_t... I>
    bool each(handle source, std::uint8_t flags, cleanup_list* cleanup, std::index_sequence<I...>) noexcept {
        auto fields = value.fields();
        return (one<I>(PyTuple_GET_ITEM(source.ptr(), I), flags, cleanup, std::get<I>(fields)) && ...);
    }
    template <std::size_t I>
    bool one(handle source, std::uint8_t flags, cleanup_list* cleanup, Field<I>& field) noexcept {
        auto& caster = std::get<I>(casters);
        if (!caster.from_python(source, flags, cleanup)) return false;
        field = caster.operator Field<I>&();
        return true;
    }
    template <typename Sequence>
    struct Casters;
    template <std::size_t... I>
    struct Casters<std::index_sequence<I...>> {
        using type = std::tuple<make_caster<Field<I>>...>;
    };
    typename Casters<std::make_index_sequence<Count>>::type casters;
};

}  // namespace nanobind::detail
