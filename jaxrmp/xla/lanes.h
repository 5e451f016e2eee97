/* Arithmetic on several states at once, one in each lane of a vector, for programs that jaxrmp.xla writes.

   Before this file REAL is float or double, WIDTH its size in bytes. A V holds one number of LANES states, a VI whole
   numbers, or truth as all bits set or none. R and N are the same for one number that all states share. */

#include <math.h>
#include <stdint.h>
#include <stdlib.h>

#define LANES (32 / WIDTH)
#if WIDTH == 4
#define N int32_t
#define F(name) name##f
#define MATH(name, arguments, v) _ZGVdN8##arguments##_##name##f
#else
#define N int64_t
#define F(name) name
#define MATH(name, arguments, v) _ZGVdN4##arguments##_##name
#endif
#define R REAL
typedef R V __attribute__((vector_size(32)));
typedef N VI __attribute__((vector_size(32)));

#define INLINE static inline __attribute__((always_inline, unused))
#define ALL(x) ((x) - (V){0}) /* the same in every lane; exact, for -0 - 0 = -0 */
#define ALL_N(x) ((x) - (VI){0})

INLINE V select_v(VI m, V a, V b) { return (V)((m & (VI)a) | (~m & (VI)b)); }
INLINE VI select_vi(VI m, VI a, VI b) { return (m & a) | (~m & b); }
INLINE R select_r(N m, R a, R b) { return m ? a : b; }
INLINE N select_n(N m, N a, N b) { return m ? a : b; }

/* As in JAX, NaN wins. */
INLINE V max_v(V a, V b) { return select_v((a > b) | (a != a), a, b); }
INLINE V min_v(V a, V b) { return select_v((a < b) | (a != a), a, b); }
INLINE R max_r(R a, R b) { return (a > b) | (a != a) ? a : b; }
INLINE R min_r(R a, R b) { return (a < b) | (a != a) ? a : b; }
INLINE VI max_vi(VI a, VI b) { return select_vi(a > b, a, b); }
INLINE VI min_vi(VI a, VI b) { return select_vi(a < b, a, b); }
INLINE N max_n(N a, N b) { return a > b ? a : b; }
INLINE N min_n(N a, N b) { return a < b ? a : b; }
INLINE V abs_v(V a) { return (V)((VI)a & ~(VI)ALL((R)-0.0)); }
INLINE R abs_r(R a) { return F(fabs)(a); }
INLINE VI abs_vi(VI a) { return select_vi(a < 0, -a, a); }
INLINE N abs_n(N a) { return a < 0 ? -a : a; }
INLINE R sign_r(R a) { return a > 0 ? 1 : a < 0 ? -1 : a; }
INLINE V sign_v(V a) { return select_v(a > 0, ALL((R)1), select_v(a < 0, ALL((R)-1), a)); }
INLINE N is_finite_r(R a) { return -(a - a == 0); }
INLINE VI is_finite_v(V a) { return a - a == 0; }

/* Whole numbers, as in JAX: none for what is no number, and the last one for what is beyond it. */
#if WIDTH == 4
#define LAST INT32_MAX
#else
#define LAST INT64_MAX
#endif
INLINE N whole_r(R a) { return a != a ? 0 : a >= (R)LAST ? LAST : a <= -(R)LAST ? -LAST - 1 : (N)a; }
INLINE VI whole_v(V a) {
    VI in_range = (a < ALL((R)LAST)) & (a > ALL(-(R)LAST));
    VI found = __builtin_convertvector(select_v(in_range, a, ALL((R)0)), VI);
    VI beyond = select_vi(a > 0, ALL_N((N)LAST), select_vi(a < 0, ALL_N((N)(-LAST - 1)), ALL_N((N)0)));
    return select_vi(in_range, found, beyond);
}

/* Lane by lane where the processor or the C library has nothing better. */
#define EACH(name, of)                                                                                                 \
    INLINE R name##_r(R a) { return of(a); }                                                                           \
    INLINE V name##_v(V a) {                                                                                           \
        V y;                                                                                                           \
        for (int l = 0; l < LANES; l++) y[l] = of(a[l]);                                                               \
        return y;                                                                                                      \
    }
#define EACH_2(name, of)                                                                                               \
    INLINE R name##_r(R a, R b) { return of(a, b); }                                                                   \
    INLINE V name##_v(V a, V b) {                                                                                      \
        V y;                                                                                                           \
        for (int l = 0; l < LANES; l++) y[l] = of(a[l], b[l]);                                                         \
        return y;                                                                                                      \
    }
#if defined(__AVX2__)
#define BY_PROCESSOR(name, of, lanes)                                                                                  \
    INLINE R name##_r(R a) { return of(a); }                                                                           \
    INLINE V name##_v(V a) { return (V)lanes; }
#if WIDTH == 4
BY_PROCESSOR(sqrt, F(sqrt), __builtin_ia32_sqrtps256(a))
BY_PROCESSOR(floor, F(floor), __builtin_ia32_roundps256(a, 1))
BY_PROCESSOR(ceil, F(ceil), __builtin_ia32_roundps256(a, 2))
BY_PROCESSOR(round_even, F(nearbyint), __builtin_ia32_roundps256(a, 0))
#else
BY_PROCESSOR(sqrt, F(sqrt), __builtin_ia32_sqrtpd256(a))
BY_PROCESSOR(floor, F(floor), __builtin_ia32_roundpd256(a, 1))
BY_PROCESSOR(ceil, F(ceil), __builtin_ia32_roundpd256(a, 2))
BY_PROCESSOR(round_even, F(nearbyint), __builtin_ia32_roundpd256(a, 0))
#endif
#else
EACH(sqrt, F(sqrt))
EACH(floor, F(floor))
EACH(ceil, F(ceil))
EACH(round_even, F(nearbyint))
#endif
EACH(round_away, F(round))
INLINE R rsqrt_r(R a) { return 1 / F(sqrt)(a); }
INLINE V rsqrt_v(V a) { return 1 / sqrt_v(a); }

#if defined(__AVX2__) && defined(__GLIBC__)
#if __GLIBC__ > 2 || __GLIBC_MINOR__ >= 35
#define VECTOR_LIBRARY
#endif
#endif
#ifdef VECTOR_LIBRARY
#define FUNCTION(name)                                                                                                 \
    extern V MATH(name, v, )(V);                                                                                       \
    INLINE R name##_r(R a) { return F(name)(a); }                                                                      \
    INLINE V name##_v(V a) { return MATH(name, v, )(a); }
#define FUNCTION_2(name)                                                                                               \
    extern V MATH(name, vv, )(V, V);                                                                                   \
    INLINE R name##_r(R a, R b) { return F(name)(a, b); }                                                              \
    INLINE V name##_v(V a, V b) { return MATH(name, vv, )(a, b); }
#else
#define FUNCTION(name) EACH(name, F(name))
#define FUNCTION_2(name) EACH_2(name, F(name))
#endif
#if WIDTH == 4
/* Within 1 ulp. The C library's is lane by lane where one of them underflows, as most of a potential's kernels do. */
INLINE R exp_r(R a) { return expf(a); }
INLINE V exp_v(V a) {
    V x = min_v(max_v(a, ALL(-87.5f)), ALL(89.0f));
    V n = round_even_v(x * ALL(1.44269504f));
    V r = (x - n * ALL(0.693359375f)) + n * ALL(2.12194440e-4f);
    V y = ALL(1.9875691500e-4f);
    y = y * r + ALL(1.3981999507e-3f);
    y = y * r + ALL(8.3334519073e-3f);
    y = y * r + ALL(4.1665795894e-2f);
    y = y * r + ALL(1.6666665459e-1f);
    y = y * r + ALL(5.0000001201e-1f);
    y = y * (r * r) + r + ALL(1.0f);
    VI half = __builtin_convertvector(n, VI) >> 1, rest = __builtin_convertvector(n, VI) - half;
    y = y * (V)((half + 127) << 23) * (V)((rest + 127) << 23);
    y = select_v(a < ALL(-87.33654f), ALL(0.0f), y);
    return select_v(a != a, a, y);
}
INLINE R log_r(R a) { return logf(a); }
INLINE V log_v(V a) {
    VI tiny = a < ALL(1.17549435e-38f);
    VI bits = (VI)select_v(tiny, a * ALL(8388608.0f), a);
    VI e = ((bits >> 23) & 255) - 126 - (tiny & 23);
    V m = (V)((bits & 0x7fffff) | 0x3f000000); /* from 1/2 to 1 */
    VI low = m < ALL(0.70710678f);
    e = e + low;
    V x = m - 1 + (V)(low & (VI)m), z = x * x, n = __builtin_convertvector(e, V);
    V y = ALL(7.0376836292e-2f);
    y = y * x - ALL(1.1514610310e-1f);
    y = y * x + ALL(1.1676998740e-1f);
    y = y * x - ALL(1.2420140846e-1f);
    y = y * x + ALL(1.4249322787e-1f);
    y = y * x - ALL(1.6668057665e-1f);
    y = y * x + ALL(2.0000714765e-1f);
    y = y * x - ALL(2.4999993993e-1f);
    y = y * x + ALL(3.3333331174e-1f);
    y = y * x * z - n * ALL(2.12194440e-4f) - ALL(0.5f) * z;
    y = x + y + n * ALL(0.693359375f);
    y = select_v(a == 0, ALL(-INFINITY), y);
    y = select_v(a < 0, ALL(NAN), y);
    return select_v((a != a) | (a == ALL(INFINITY)), a, y);
}
INLINE R tanh_r(R a) { return tanhf(a); }
INLINE V tanh_v(V a) {
    V x = abs_v(a), z = a * a;
    V far = 1 - 2 / (exp_v(x + x) + 1);
    V near = ALL(-5.70498872745e-3f);
    near = near * z + ALL(2.06390887954e-2f);
    near = near * z - ALL(5.37397155531e-2f);
    near = near * z + ALL(1.33314422036e-1f);
    near = near * z - ALL(3.33332819422e-1f);
    near = near * z * a + a;
    return select_v(x < ALL(0.625f), near, (V)((VI)far | ((VI)a & (VI)ALL(-0.0f))));
}
#else
FUNCTION(exp) FUNCTION(log) FUNCTION(tanh)
#endif
FUNCTION(exp2) FUNCTION(expm1) FUNCTION(log1p) FUNCTION(sin) FUNCTION(cos) FUNCTION(tan)
FUNCTION(asin) FUNCTION(acos) FUNCTION(atan) FUNCTION(sinh) FUNCTION(cosh) FUNCTION(asinh)
FUNCTION(acosh) FUNCTION(atanh) FUNCTION(erf) FUNCTION(cbrt) FUNCTION_2(atan2) FUNCTION_2(pow)
EACH_2(rem, F(fmod))
INLINE R logistic_r(R a) { return 1 / (1 + F(exp)(-a)); }
INLINE V logistic_v(V a) { return 1 / (1 + exp_v(-a)); }
