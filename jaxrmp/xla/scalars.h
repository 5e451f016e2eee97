/* Arithmetic on single numbers, for programs of one state: R a number, N a whole one, or truth as all bits set or none;
   F(name) is the C library's function for R. A program holds those of these functions that it calls, one a line. */

static inline R select_r(N m, R a, R b) { return m ? a : b; }
static inline N select_n(N m, N a, N b) { return m ? a : b; }
static inline R max_r(R a, R b) { return (a > b) | (a != a) ? a : b; }
static inline R min_r(R a, R b) { return (a < b) | (a != a) ? a : b; }
static inline N max_n(N a, N b) { return a > b ? a : b; }
static inline N min_n(N a, N b) { return a < b ? a : b; }
static inline R abs_r(R a) { return F(fabs)(a); }
static inline N abs_n(N a) { return a < 0 ? -a : a; }
static inline R sign_r(R a) { return a > 0 ? 1 : a < 0 ? -1 : a; }
static inline N is_finite_r(R a) { return -(a - a == 0); }
static inline N whole_r(R a) { return a != a ? 0 : a >= (R)LAST ? LAST : a <= -(R)LAST ? -LAST - 1 : (N)a; }
static inline R round_even_r(R a) { return F(nearbyint)(a); }
static inline R round_away_r(R a) { return F(round)(a); }
static inline R rsqrt_r(R a) { return 1 / F(sqrt)(a); }
static inline R logistic_r(R a) { return 1 / (1 + F(exp)(-a)); }
static inline R rem_r(R a, R b) { return F(fmod)(a, b); }

/* For loops, choices by bits: of others compilers make branches, and then no vectors. */
static inline R picked_r(N m, R a, R b) {
    union { N bits; R number; } p, q;
    p.number = a, q.number = b;
    p.bits = (p.bits & m) | (q.bits & ~m);
    return p.number;
}
static inline R larger_r(R a, R b) { return picked_r(-(a <= b), b, picked_r(-(b == b), a, b)); }
static inline R smaller_r(R a, R b) { return picked_r(-(a >= b), b, picked_r(-(b == b), a, b)); }

/* In single precision, within 2 ulp, or 4 where noted, and nothing that would keep a loop from becoming one of vectors. */
static inline R exp_r(float a) {
    R x = picked_r(-(a > -87.5f), a, -87.5f), r, y = 1.9875691500e-4f;
    union { N bits; R number; } p, q;
    N k, half;
    x = picked_r(-(x < 89.0f), x, 89.0f);
    k = (N)(x * 1.44269504f + F(copysign)(0.5f, x)), half = k / 2;
    r = (x - (R)k * 0.693359375f) + (R)k * 2.12194440e-4f;
    y = (((y * r + 1.3981999507e-3f) * r + 8.3334519073e-3f) * r + 4.1665795894e-2f) * r + 1.6666665459e-1f;
    y = (y * r + 5.0000001201e-1f) * (r * r) + r + 1.0f;
    p.bits = (half + 127) << 23;
    q.bits = (k - half + 127) << 23;
    y = picked_r(-(a < -87.33654f), 0.0f, y * p.number * q.number);
    return picked_r(-(a == a), y, a);
}
static inline R expm1_r(float a) { /* 4 ulp */
    R y = ((1.9875691500e-4f * a + 1.3981999507e-3f) * a + 8.3334519073e-3f) * a + 4.1665795894e-2f;
    y = ((y * a + 1.6666665459e-1f) * a + 5.0000001201e-1f) * (a * a) + a;
    return picked_r(-(F(fabs)(a) < 0.3466f), y, exp_r(a) - 1.0f);
}
/* 1 / sqrt(a) of a normal number, by Newton's method. */
static inline R near_rsqrt_r(float a) {
    union { uint32_t bits; R number; } p;
    p.number = a, p.bits = 0x5f3759dfu - (p.bits >> 1);
    p.number *= 1.5f - 0.5f * a * p.number * p.number;
    return p.number * (1.5f - 0.5f * a * p.number * p.number);
}
/* The square root as loops take it; what is below the normal numbers stays as it is. */
static inline R sqrts_r(float a) {
    R y = near_rsqrt_r(a), s = a * y;
    s += 0.5f * y * (a - s * s);
    return picked_r(-((a >= 1.17549435e-38f) & (a <= 3.4028234e38f)), s, picked_r(-(a < 0), (R)NAN, a));
}
static inline R rsqrts_r(float a) { /* 4 ulp */
    R y = near_rsqrt_r(a);
    y *= 1.5f - 0.5f * a * y * y;
    return picked_r(-((a >= 1.17549435e-38f) & (a <= 3.4028234e38f)), y, 1.0f / sqrts_r(a));
}
static inline R tanh_r(float a) {
    R z = a * a, x = 2.0f * F(fabs)(a), r, y = -5.70498872745e-3f, e = 1.9875691500e-4f;
    union { N bits; R number; } p, q;
    N k;
    p.number = x, q.number = 40.0f, k = -(x < 40.0f); /* chosen by bits: compilers would make branches of these */
    p.bits = (p.bits & k) | (q.bits & ~k);
    x = p.number;
    k = (N)(x * 1.44269504f + 0.5f);
    r = (x - (R)k * 0.693359375f) + (R)k * 2.12194440e-4f;
    e = (((e * r + 1.3981999507e-3f) * r + 8.3334519073e-3f) * r + 4.1665795894e-2f) * r + 1.6666665459e-1f;
    p.bits = (k + 127) << 23;
    e = ((e * r + 5.0000001201e-1f) * (r * r) + r + 1.0f) * p.number;
    y = (((y * z + 2.06390887954e-2f) * z - 5.37397155531e-2f) * z + 1.33314422036e-1f) * z - 3.33332819422e-1f;
    p.number = y * z * a + a;
    q.number = F(copysign)(1.0f - 2.0f / (e + 1.0f), a);
    k = -(F(fabs)(a) >= 0.625f); /* not so for what is no number, and then the first is none, too */
    p.bits = (p.bits & ~k) | (q.bits & k);
    return p.number;
}
