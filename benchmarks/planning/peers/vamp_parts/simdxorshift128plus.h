// The names of the sampler that is left out: calling it ends the program.
#pragma once
#include <immintrin.h>
#include <stdint.h>

typedef struct
{
    int unused;
} avx_xorshift128plus_key_t;

static inline void avx_xorshift128plus_init(uint64_t, uint64_t, avx_xorshift128plus_key_t *)
{
    __builtin_trap();
}

static inline __m256i avx_xorshift128plus(avx_xorshift128plus_key_t *)
{
    __builtin_trap();
}
