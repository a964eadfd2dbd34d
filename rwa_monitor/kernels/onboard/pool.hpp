// Memory of the onboard detector: blocks of one range of bytes that the caller provides, and no other.
#pragma once

#include <cstddef>
#include <cstdlib>
#include <cstring>

namespace rwa {

// First fit; free blocks in the order of their addresses, neighbours merged.
struct Pool {
    struct Block {
        std::size_t size;  // [bytes], with this head
        Block* next;
    };
    static constexpr std::size_t HEAD = sizeof(Block), ALIGNED = alignof(std::max_align_t);

    void open(void* memory, std::size_t bytes) {
        free_blocks = static_cast<Block*>(memory);
        *free_blocks = {bytes - bytes % ALIGNED, nullptr};
        used = most_used = 0;
    }

    void* take(std::size_t bytes) {
        const std::size_t size = (bytes + HEAD + ALIGNED - 1) / ALIGNED * ALIGNED;
        for (Block** at = &free_blocks; *at; at = &(*at)->next) {
            Block* const block = *at;
            if (block->size < size) continue;
            if (block->size >= size + 2 * HEAD) {
                Block* const rest = reinterpret_cast<Block*>(reinterpret_cast<char*>(block) + size);
                *rest = {block->size - size, block->next};
                block->size = size;
                *at = rest;
            } else {
                *at = block->next;
            }
            used += block->size;
            if (used > most_used) most_used = used;
            return block + 1;
        }
        std::abort();  // the size that is demanded at open rules it out
    }

    void give_back(void* memory) {
        Block* const block = static_cast<Block*>(memory) - 1;
        used -= block->size;
        Block** at = &free_blocks;
        Block* before = nullptr;
        while (*at && *at < block) before = *at, at = &(*at)->next;
        block->next = *at;
        *at = block;
        if (block->next && ends_at(block, block->next)) block->size += block->next->size, block->next = block->next->next;
        if (before && ends_at(before, block)) before->size += block->size, before->next = block->next;
    }

    static bool ends_at(const Block* block, const Block* next) {
        return reinterpret_cast<const char*>(block) + block->size == reinterpret_cast<const char*>(next);
    }

    Block* free_blocks = nullptr;
    std::size_t used = 0, most_used = 0;
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
    template <typename Other>
    bool operator!=(const Pooled<Other>&) const { return false; }
};

}  // namespace rwa
