/* Arithmetic on single numbers, for programs of one state: R a number, N a whole one, or truth as all bits set or none;
   F(name) is the C library's function for R. A program holds those of these functions that it calls, one a line. */

static inline R select_r(N m, R a, R b) { return m ? a : b; }
static inline N select_n(N m, N a, N b) { return m ? a : b; }
static inline R max_r(R a, R b) { return a > b || a != a ? a : b; }
static inline R min_r(R a, R b) { return a < b || a != a ? a : b; }
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
