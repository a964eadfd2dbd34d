// Memory of the onboard detector: blocks of one range of bytes that the caller provides, and no other.
#pragma once

#include <cstddef>
#include <cstdlib>

namespace rwa {

// A stack: blocks one above the other, each freed when all above it are. What a window keeps is small or taken at once, so
// that the room below it that cannot be had again is.
struct Pool {
    struct Block {
        Block* below;
        std::size_t size;  // [bytes], with this head; 0 once it is given back
    };
    static constexpr std::size_t HEAD = sizeof(Block), ALIGNED = alignof(std::max_align_t);

    void open(void* memory, std::size_t bytes) {
        first = static_cast<unsigned char*>(memory);
        given = bytes;
        used = most_used = 0;
        top = nullptr;
    }

    void* take(std::size_t bytes) {
        const std::size_t size = (bytes + HEAD + ALIGNED - 1) / ALIGNED * ALIGNED;
        if (used + size > given) std::abort();  // the size that is demanded at open rules it out
        Block* const block = reinterpret_cast<Block*>(first + used);
        *block = {top, size};
        top = block;
        used += size;
        if (used > most_used) most_used = used;
        return block + 1;
    }

    void give_back(void* memory) {
        (static_cast<Block*>(memory) - 1)->size = 0;
        for (; top && top->size == 0; top = top->below) used = reinterpret_cast<unsigned char*>(top) - first;
    }

    unsigned char* first = nullptr;
    Block* top = nullptr;
    std::size_t given = 0, used = 0, most_used = 0;
};

inline thread_local Pool* pool = nullptr;  // of the detector that is at work

template <typename T>
struct Pooled {
    using value_type = T;
    Pooled() = default;
    template <typename Other>
    Pooled(const Pooled<Other>&) {}
    T* allocate(std::size_t count) { return static_cast<T*>(pool->take(count * sizeof(T))); }
    void deallocate(T* memory, std::size_t) { pool->give_back(memory); }
    template <typename Other>
    bool operator==(const Pooled<Other>&) const { return true; }
};

}  // namespace rwa
