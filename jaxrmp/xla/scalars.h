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

/* In single precision, within 1 ulp, and nothing that would keep a loop from becoming one of vectors. */
static inline R exp_r(float a) {
    R x = a > -87.5f ? (a < 89.0f ? a : 89.0f) : -87.5f;
    N k = (N)(x * 1.44269504f + (x < 0 ? -0.5f : 0.5f)), half = k / 2;
    R r = (x - (R)k * 0.693359375f) + (R)k * 2.12194440e-4f, y = 1.9875691500e-4f;
    union { N bits; R number; } p, q;
    y = (((y * r + 1.3981999507e-3f) * r + 8.3334519073e-3f) * r + 4.1665795894e-2f) * r + 1.6666665459e-1f;
    y = (y * r + 5.0000001201e-1f) * (r * r) + r + 1.0f;
    p.bits = (half + 127) << 23;
    q.bits = (k - half + 127) << 23;
    y = y * p.number * q.number;
    y = a < -87.33654f ? 0.0f : y;
    return a != a ? a : y;
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
