/* The aim: the same tops with explicit 512-bit vectors and as few operations as we know, time loop inside, state in registers.
 *
 * Rows, step and result as in tops.c (which see), to rounding. Where the operations go:
 *   - moves w = h/4 omega instead of l: no product by 1/I in any stage; l only on the way in and out
 *   - a stage is q + x o w in 12 multiply-adds (o the quaternion product), not 12 and then 4 to scale and add
 *   - 3 q(t+h) = x + 2 y + z - q + z o w with the stages x, y, z: nothing is summed twice; the norm 3 goes with the normalisation
 * 91 products and multiply-adds free, 147 heavy, against 127 and 183 in tops.c; additions run beside them on Zen 4.
 *
 * Tried, in M member-steps/s free | heavy, measured as in tops.c (which had 411 | 297 in the same rounds):
 *   vectors at once 1: 563 | 352   2: 597 | 373   4: 602 | 373;   2 with -fschedule-insns: 533 | 364
 *   1/sqrt instead of Newton: 93 % of it;   l instead of w: 505 | 329, with lanes inside and steps outside 502 | 319
 */
#ifdef __AVX512F__
#include <immintrin.h>

#ifndef VECTORS
#define VECTORS 2
#endif

typedef __m512d v;
typedef struct { v a, b, c; } v3;
typedef struct { v a, b, c, d; } v4;
typedef struct { v3 k, k2; v p12, p13, p21, p23, p31, p32; v3 scale; } body;
#define MUL _mm512_mul_pd
#define ADD _mm512_add_pd
#define SUB _mm512_sub_pd
#define FMA _mm512_fmadd_pd
#define FNMA _mm512_fnmadd_pd
#define SET _mm512_set1_pd
#define INLINE static inline __attribute__((always_inline))

/* q + p o (0, w) */
INLINE v4 turned(v4 q, v4 p, v3 w) {
  return (v4){FNMA(p.d, w.c, FNMA(p.c, w.b, FNMA(p.b, w.a, q.a))), FNMA(p.d, w.b, FMA(p.c, w.c, FMA(p.a, w.a, q.b))),
              FNMA(p.b, w.c, FMA(p.d, w.a, FMA(p.a, w.b, q.c))), FNMA(p.c, w.a, FMA(p.b, w.b, FMA(p.a, w.c, q.d)))};
}

/* onto + h/2 dw/dt at (q, w); twice that where `twice` */
INLINE v3 kicked(v3 onto, v4 q, v3 w, body b, const int heavy, const int twice) {
  v3 k = twice ? b.k2 : b.k;
  if (heavy) { /* x, y = u/2 and z = u of the vertical u; the missing factors are in p */
    v x = FNMA(q.a, q.c, MUL(q.b, q.d)), y = FMA(q.a, q.b, MUL(q.c, q.d));
    v z = FNMA(q.c, q.c, FNMA(q.b, q.b, FMA(q.d, q.d, MUL(q.a, q.a))));
    if (twice) x = ADD(x, x), y = ADD(y, y), z = ADD(z, z);
    onto = (v3){FNMA(z, b.p12, FMA(y, b.p13, onto.a)), FNMA(x, b.p23, FMA(z, b.p21, onto.b)),
                FNMA(y, b.p31, FMA(x, b.p32, onto.c))};
  }
  return (v3){FMA(k.a, MUL(w.b, w.c), onto.a), FMA(k.b, MUL(w.c, w.a), onto.b), FMA(k.c, MUL(w.a, w.b), onto.c)};
}

INLINE v sum(v s, v x, v y, v z) { return FMA(SET(2), y, ADD(SUB(x, s), z)); }                     /* x + 2 y + z - s */
INLINE v change(v s, v x, v y, v z) { return FMA(SET(2), SUB(y, s), ADD(SUB(x, s), SUB(z, s))); } /* the same - 3 s: small, exact */

INLINE void step(v4 *at, v3 *rate, body b, const int heavy) {
  v4 s = *at;
  v3 w = *rate;
  v4 x = turned(s, s, w);
  v3 wx = kicked(w, s, w, b, heavy, 0);
  v4 y = turned(s, x, wx);
  v3 wy = kicked(w, x, wx, b, heavy, 0);
  v4 z = turned(s, y, (v3){ADD(wy.a, wy.a), ADD(wy.b, wy.b), ADD(wy.c, wy.c)});
  v3 wz = kicked(w, y, wy, b, heavy, 1);
  v4 q = turned((v4){sum(s.a, x.a, y.a, z.a), sum(s.b, x.b, y.b, z.b), sum(s.c, x.c, y.c, z.c), sum(s.d, x.d, y.d, z.d)}, z, wz);
  v3 d = {change(w.a, wx.a, wy.a, wz.a), change(w.b, wx.b, wy.b, wz.b), change(w.c, wx.c, wy.c, wz.c)};
  d = kicked(d, z, wz, b, heavy, 0);
  *rate = (v3){FMA(SET(1.0 / 3), d.a, w.a), FMA(SET(1.0 / 3), d.b, w.b), FMA(SET(1.0 / 3), d.c, w.c)};
  v square = FMA(q.d, q.d, FMA(q.c, q.c, FMA(q.b, q.b, MUL(q.a, q.a))));
  v r = FNMA(square, SET(1.0 / 54), SET(0.5)); /* (3 - |q/3|^2)/2/3 */
  *at = (v4){MUL(r, q.a), MUL(r, q.b), MUL(r, q.c), MUL(r, q.d)};
}

#define IN(row) _mm512_loadu_pd(s + (row) * n + i)
#define OUT(row, x) _mm512_storeu_pd(s + (row) * n + i, x)

INLINE void group(double *s, long n, long low, long steps, double h, const int heavy) {
  v4 q[VECTORS];
  v3 w[VECTORS];
  body b[VECTORS];
  for (int j = 0; j < VECTORS; j++) {
    long i = low + 8 * j;
    v3 f = {SET(h / 4) * IN(7), SET(h / 4) * IN(8), SET(h / 4) * IN(9)};
    q[j] = (v4){IN(0), IN(1), IN(2), IN(3)};
    w[j] = (v3){f.a * IN(4), f.b * IN(5), f.c * IN(6)};
    b[j].scale = f;
    v3 a = {SET(h / 2) * IN(10), SET(h / 2) * IN(11), SET(h / 2) * IN(12)};
    b[j].k = (v3){a.a * f.a / (f.b * f.c), a.b * f.b / (f.c * f.a), a.c * f.c / (f.a * f.b)};
    b[j].k2 = (v3){b[j].k.a + b[j].k.a, b[j].k.b + b[j].k.b, b[j].k.c + b[j].k.c};
    if (heavy) {
      v p1 = SET(h) * IN(13), p2 = SET(h) * IN(14), p3 = SET(h) * IN(15), half = SET(0.5);
      b[j].p12 = half * f.a * p2, b[j].p13 = f.a * p3, b[j].p21 = half * f.b * p1;
      b[j].p23 = f.b * p3, b[j].p31 = f.c * p1, b[j].p32 = f.c * p2;
    }
  }
  for (long t = 0; t < steps; t++)
#pragma GCC unroll 4
    for (int j = 0; j < VECTORS; j++) step(&q[j], &w[j], b[j], heavy);
  for (int j = 0; j < VECTORS; j++) {
    long i = low + 8 * j;
    OUT(0, q[j].a), OUT(1, q[j].b), OUT(2, q[j].c), OUT(3, q[j].d);
    OUT(4, w[j].a / b[j].scale.a), OUT(5, w[j].b / b[j].scale.b), OUT(6, w[j].c / b[j].scale.c);
  }
}

static __attribute__((noinline)) void group_free(double *s, long n, long low, long steps, double h) {
  group(s, n, low, steps, h, 0);
}
static __attribute__((noinline)) void group_heavy(double *s, long n, long low, long steps, double h) {
  group(s, n, low, steps, h, 1);
}

void rk4_free_512(double *s, long n, long steps, double h) {
#pragma omp parallel for schedule(dynamic, 16)
  for (long low = 0; low < n; low += 8 * VECTORS) group_free(s, n, low, steps, h);
}

void rk4_heavy_512(double *s, long n, long steps, double h) {
#pragma omp parallel for schedule(dynamic, 16)
  for (long low = 0; low < n; low += 8 * VECTORS) group_heavy(s, n, low, steps, h);
}
#endif
