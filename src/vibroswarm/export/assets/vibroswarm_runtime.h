/* Numbers of the robot program: one floating-point type, and Python's meaning of its operators.

   VS_PRECISION is 3: double; 2: double, with arrays of float; 1: float. With 3 and -ffp-contract=off, results are those
   of the program in Python bit by bit where exp, log, lgamma and others of the C library give the same bits: where lgamma
   is another, beliefs differ by up to 2.4e-15. */
#ifndef VIBROSWARM_RUNTIME_H
#define VIBROSWARM_RUNTIME_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

#if VS_PRECISION == 2
#include "vibroswarm_mathematics.h"
#endif

#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__)
#error "vibroswarm uses NaN and infinity: compile without -ffast-math and -ffinite-math-only"
#endif
#if VS_PRECISION >= 2 && defined(__SIZEOF_DOUBLE__) && __SIZEOF_DOUBLE__ < 8
#error "double has 4 bytes here, as on an AVR: this strategy needs 8; take another board, or compare VS_PRECISION 1"
#endif

#if VS_PRECISION >= 2
typedef double vs_real;
#define VS_OF(name) name
#else
typedef float vs_real;
#define VS_OF(name) name##f
#endif
#if VS_PRECISION >= 3
typedef double vs_stored;
#else
typedef float vs_stored;
#endif

typedef int32_t vs_int;

#define VS_LOAD(stored) ((vs_real)stored)
#define VS_STORE(number) ((vs_stored)(number))
#define VS_R(number) ((vs_real)number)
#define VS_NAN ((vs_real)NAN)
#define VS_INFINITY ((vs_real)INFINITY)

#define vs_sqrt VS_OF(sqrt)
#define vs_exp VS_OF(exp)
#define vs_log VS_OF(log)
#define vs_log1p VS_OF(log1p)
#if VS_PRECISION == 2
#define vs_sin vs_small_sin
#define vs_cos vs_small_cos
#define vs_tan vs_small_tan
#define vs_erfc vs_small_erfc
#else
#define vs_sin VS_OF(sin)
#define vs_cos VS_OF(cos)
#define vs_tan VS_OF(tan)
#define vs_erfc VS_OF(erfc)
#endif
#define vs_atan VS_OF(atan)
#define vs_atan2 VS_OF(atan2)
#define vs_erf VS_OF(erf)
#define vs_lgamma VS_OF(lgamma)
#define vs_floor VS_OF(floor)
#define vs_ceil VS_OF(ceil)
#define vs_pow VS_OF(pow)
#define vs_round VS_OF(rint) /* to even, as Python's round */
#define vs_isnan(x) ((bool)isnan(x))

static inline vs_real vs_min(vs_real a, vs_real b) { return b < a ? b : a; }
static inline vs_real vs_max(vs_real a, vs_real b) { return b > a ? b : a; }
static inline vs_real vs_abs(vs_real x) { return VS_OF(fabs)(x); }

#define VS_INTEGERS(type, suffix) \
    static inline type vs_min_##suffix(type a, type b) { return b < a ? b : a; } \
    static inline type vs_max_##suffix(type a, type b) { return b > a ? b : a; } \
    static inline type vs_abs_##suffix(type x) { return x < 0 ? -x : x; } \
    static inline type vs_floordiv_##suffix(type a, type b) \
    { \
        const type q = a / b; \
        return q * b != a && (a < 0) != (b < 0) ? q - 1 : q; \
    } \
    static inline type vs_mod_##suffix(type a, type b) { return a - b * vs_floordiv_##suffix(a, b); }

VS_INTEGERS(vs_int, i)
VS_INTEGERS(int64_t, l)

static inline vs_real vs_mod(vs_real a, vs_real b)
{
    const vs_real rest = VS_OF(fmod)(a, b);
    if (rest == 0)
        return b < 0 ? -(vs_real)0 : 0; /* with the sign of b, as in Python */
    return (rest < 0) != (b < 0) ? rest + b : rest;
}

/* A whole power by products, as Numba computes it; pow may differ from it in the last bit. */
static inline vs_real vs_power(vs_real x, int64_t n)
{
    vs_real power = 1;
    if (n > 0x10000 || n < -0x10000)
        return vs_pow(x, (vs_real)n);
    for (int64_t rest = n < 0 ? -n : n; rest != 0; rest >>= 1) {
        if (rest & 1)
            power *= x;
        x *= x;
    }
    return n < 0 ? 1 / power : power;
}

/* The bits of a number, whatever the order of bytes in memory. */
#if VS_PRECISION >= 2
typedef uint64_t vs_Bits;
#else
typedef uint32_t vs_Bits;
#endif

static inline vs_Bits vs_bits(vs_real number)
{
    vs_Bits bits;
    memcpy(&bits, &number, sizeof bits);
    return bits;
}

static inline vs_real vs_of_bits(uint64_t found)
{
    const vs_Bits bits = (vs_Bits)found;
    vs_real number;
    memcpy(&number, &bits, sizeof number);
    return number;
}

/* The number in (0, 1) at an address: ten rounds of Philox4x32 (Salmon et al., "Parallel random numbers", SC 2011). */
static inline vs_real vs_uniform(int64_t seed, vs_int run, vs_int robot, vs_int purpose, vs_int index, vs_int peer)
{
    uint32_t a = (uint32_t)index, b = (uint32_t)(robot | purpose << 16), c = (uint32_t)run, d = (uint32_t)peer;
    uint32_t k0 = (uint32_t)seed, k1 = (uint32_t)(seed >> 32);
    for (int round = 0; round < 10; round++) {
        const uint64_t left = UINT64_C(0xD2511F53) * a, right = UINT64_C(0xCD9E8D57) * c;
        a = (uint32_t)(right >> 32) ^ b ^ k0;
        b = (uint32_t)right;
        c = (uint32_t)(left >> 32) ^ d ^ k1;
        d = (uint32_t)left;
        k0 += UINT32_C(0x9E3779B9);
        k1 += UINT32_C(0xBB67AE85);
    }
#if VS_PRECISION >= 2
    return ((double)((uint64_t)a << 20 | b >> 12) + 0.5) * 0x1p-52;
#else
    return ((float)(a >> 9) + 0.5f) * 0x1p-23f; /* 23 bits: never 1 */
#endif
}

#endif
