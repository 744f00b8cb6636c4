/* What all parts of the model are written with. Loops run over BLOCK numbers at a time, so that compilers
   make vectors of them with or without -ffast-math; tables are filled up to whole blocks. */
#define BLOCK 32

#if SINGLE
#define EXP expf
#define TANH tanhf
#define SIN sinf
#define COS cosf
#define SQRT sqrtf
#define FABS fabsf
#define R(number) number##f
typedef uint32_t word;
#define MANTISSA 23
#define BIAS 127
#define LEAST_EXPONENT R(-87.0)
#define LN2_HIGH R(0.693145751953125)
#define LN2_LOW R(1.42860682030941723e-6)
#define HALF_PI_1 R(1.5703125)
#define HALF_PI_2 R(4.837512969970703125e-4)
#define HALF_PI_3 R(7.549789948768648e-8)
#else
#define EXP exp
#define TANH tanh
#define SIN sin
#define COS cos
#define SQRT sqrt
#define FABS fabs
#define R(number) number
typedef uint64_t word;
#define MANTISSA 52
#define BIAS 1023
#define LEAST_EXPONENT R(-708.0)
#define LN2_HIGH R(6.93147180369123816490e-01)
#define LN2_LOW R(1.90821492927058770002e-10)
#define HALF_PI_1 R(1.57079632673412561417e+00)
#define HALF_PI_2 R(6.07710050630396597660e-11)
#define HALF_PI_3 R(2.02226624879595063154e-21)
#endif
#define LOG2_E R(1.4426950408889634)
#define TWO_BY_PI R(0.63661977236758134)
#define LARGEST_PHASE R(1.0e5)

/* Whether the bits of a number say that it is one: neither NaN nor infinite. No comparison of numbers does,
   where the compiler was told that there are only finite ones. */
static int is_number(real value)
{
    word bits;
    memcpy(&bits, &value, sizeof bits);
    return ((bits >> MANTISSA) & (word)(2 * BIAS + 1)) != (word)(2 * BIAS + 1);
}

/* e becomes exp(e), of n numbers <= 0, n a multiple of BLOCK: 2^k exp(r) with |r| <= log(2)/2. What is less
   than LEAST_EXPONENT counts as that. */
static inline void exponentials(real *e, int n)
{
    word scale[BLOCK];
    real power[BLOCK];
    int i;
    for (; n > 0; n -= BLOCK, e += BLOCK) {
        for (i = 0; i < BLOCK; ++i) {
            const real x = e[i] < LEAST_EXPONENT ? LEAST_EXPONENT : e[i];
            const int k = (int)(x * LOG2_E - R(0.5));
            const real r = (x - (real)k * LN2_HIGH) - (real)k * LN2_LOW;
            real p;
#if SINGLE
            p = R(1.0) / R(5040.0);
#else
            p = R(1.0) / R(6227020800.0);
            p = p * r + R(1.0) / R(479001600.0);
            p = p * r + R(1.0) / R(39916800.0);
            p = p * r + R(1.0) / R(3628800.0);
            p = p * r + R(1.0) / R(362880.0);
            p = p * r + R(1.0) / R(40320.0);
            p = p * r + R(1.0) / R(5040.0);
#endif
            p = p * r + R(1.0) / R(720.0);
            p = p * r + R(1.0) / R(120.0);
            p = p * r + R(1.0) / R(24.0);
            p = p * r + R(1.0) / R(6.0);
            p = p * r + R(0.5);
            e[i] = R(1.0) + (r + r * r * p);
            scale[i] = (word)(k + BIAS) << MANTISSA;
        }
        memcpy(power, scale, sizeof power);
        for (i = 0; i < BLOCK; ++i)
            e[i] *= power[i];
    }
}

/* c becomes cos(c), s sin(c), of n numbers, n a multiple of BLOCK: polynomials within a quarter turn. */
static inline void cosines_sines(real *c, real *s, int n)
{
    int i;
    for (; n > 0; n -= BLOCK, c += BLOCK, s += BLOCK)
        for (i = 0; i < BLOCK; ++i) {
            const real within = c[i] > LARGEST_PHASE ? LARGEST_PHASE : c[i];
            const real x = within < -LARGEST_PHASE ? -LARGEST_PHASE : within;
            const int k = (int)(x * TWO_BY_PI + (x < R(0.0) ? R(-0.5) : R(0.5)));
            const real q = (real)k;
            const real r = ((x - q * HALF_PI_1) - q * HALF_PI_2) - q * HALF_PI_3;
            const real y = r * r;
            const int turned = k & 1;
            real sine, cosine;
#if SINGLE
            sine = R(-1.9515295891e-4);
            cosine = R(2.443315711809948e-5);
#else
            sine = R(1.58969099521155010221e-10);
            sine = sine * y - R(2.50507602534068634195e-8);
            sine = sine * y + R(2.75573137070700676789e-6);
            sine = sine * y - R(1.98412698298579493134e-4);
            cosine = R(-1.13596475577881948265e-11);
            cosine = cosine * y + R(2.08757232129817482790e-9);
            cosine = cosine * y - R(2.75573143513906633035e-7);
            cosine = cosine * y + R(2.48015872894767294178e-5);
#endif
            sine = sine * y + R(8.33333333332248946124e-3);
            sine = r + r * y * (sine * y - R(1.66666666666666324348e-1));
            cosine = cosine * y - R(1.38888888888741095749e-3);
            cosine = cosine * y + R(4.16666666666666019037e-2);
            cosine = R(1.0) - y * (R(0.5) - y * cosine);
            c[i] = (turned ? sine : cosine) * (((k + 1) & 2) ? R(-1.0) : R(1.0));
            s[i] = (turned ? cosine : sine) * ((k & 2) ? R(-1.0) : R(1.0));
        }
}

/* Sum of a block. */
static inline real total(const real *values)
{
    real sum = R(0.0);
    int i;
    for (i = 0; i < BLOCK; ++i)
        sum += values[i];
    return sum;
}

/* |A k|^2 of a lower triangular A (n, n), its rows one after the other, each filled up to a multiple of 16
   with zeros; k is as long as the last row. Ends where the sum is `enough`: it only grows. */
static inline real squared(const real *A, const real *k, int n, real enough)
{
    real sum = R(0.0), lanes[16];
    int i, j, l;
    for (i = 0; i < n; ++i) {
        const int width = (i / 16 + 1) * 16;
        real row = R(0.0);
        for (l = 0; l < 16; ++l)
            lanes[l] = R(0.0);
        for (j = 0; j < width; j += 16)
            for (l = 0; l < 16; ++l)
                lanes[l] += A[j + l] * k[j + l];
        for (l = 0; l < 16; ++l)
            row += lanes[l];
        sum += row * row;
        if (sum >= enough)
            return sum;
        A += width;
    }
    return sum;
}
