/* The C baseline: tops in structure-of-arrays form, textbook rk4, vectorised by the compiler. Built on the spot by bench/baselines.
 *
 * Same physics as rigidmc/integrators/rk4.py: quaternion q and body angular momentum l, q normalised after each step.
 * s holds rows of n doubles: q0..q3, l1..l3, reciprocal moments i1..i3, a1..a3 with dl1/dt = a1 l2 l3 + tau1, weight times
 * centre of mass p1..p3. n is a multiple of CHUNK.
 *
 * Tried, in M member-steps/s free | heavy per two cores of a Zen 4 (FMA peak 116 GFLOP/s, gcc 12, CPU time, medians of 7):
 *   chunk   8: 412 | 285    16: 394 | 294    32: 427 | 290    64: 422 | 305    128: 422 | 304    256: 415 | 293    512: 324 | 245
 *   1/sqrt instead of the Newton step, chunk 64: 400 | 288;  -fschedule-insns: 432 | 302;  -fno-schedule-insns2: 417 | 293
 *   `heavy` as a run-time argument of the parallel region: 287 | 286, the compiler keeps both cases in the loop
 * 512 tops are 64 KB, twice the L1 cache. With 127 multiply-adds free and 183 heavy this is 90 % of what the FMA units can do.
 */
#include <math.h>

#ifndef CHUNK
#define CHUNK 64
#endif
#ifndef NEWTON
#define NEWTON 1 /* (3 - |q|^2)/2 differs from 1/|q| by 3/8 (|q|^2 - 1)^2: under 1e-17 for rk4 steps that turn by 0.05 rad */
#endif

/* d0..d6 = rates of (x0..x6) = (q, l); w is half the angular velocity */
#define RATES(d, x)                                                                                                           \
  double d##w1 = hi1 * x##4, d##w2 = hi2 * x##5, d##w3 = hi3 * x##6;                                                          \
  double d##0 = -x##1 * d##w1 - x##2 * d##w2 - x##3 * d##w3;                                                                  \
  double d##1 = x##0 * d##w1 + x##2 * d##w3 - x##3 * d##w2;                                                                   \
  double d##2 = x##0 * d##w2 + x##3 * d##w1 - x##1 * d##w3;                                                                   \
  double d##3 = x##0 * d##w3 + x##1 * d##w2 - x##2 * d##w1;                                                                   \
  double d##4 = a1 * x##5 * x##6, d##5 = a2 * x##6 * x##4, d##6 = a3 * x##4 * x##5;                                           \
  if (heavy) { /* torque -p x u, u the vertical in the body */                                                                \
    double u1 = 2 * (x##1 * x##3 - x##0 * x##2), u2 = 2 * (x##2 * x##3 + x##0 * x##1);                                        \
    double u3 = x##0 * x##0 - x##1 * x##1 - x##2 * x##2 + x##3 * x##3;                                                        \
    d##4 += u2 * p3 - u3 * p2, d##5 += u3 * p1 - u1 * p3, d##6 += u1 * p2 - u2 * p1;                                          \
  }

#define AHEAD(x, c, d)                                                                                                        \
  double x##0 = s0 + (c) * d##0, x##1 = s1 + (c) * d##1, x##2 = s2 + (c) * d##2, x##3 = s3 + (c) * d##3;                      \
  double x##4 = s4 + (c) * d##4, x##5 = s5 + (c) * d##5, x##6 = s6 + (c) * d##6;

#define SUM(i) (s##i + h / 6 * (a_##i + 2 * (b_##i + c_##i) + d_##i))

/* omega, attitude, energy of motion and |L|^2 of a chunk, to nine rows of n doubles */
static inline __attribute__((always_inline)) void save(double *out, long n, double w[16][CHUNK]) {
#pragma omp simd aligned(w : 64)
  for (int k = 0; k < CHUNK; k++) {
    double l1 = w[4][k], l2 = w[5][k], l3 = w[6][k], o1 = 2 * w[7][k] * l1, o2 = 2 * w[8][k] * l2, o3 = 2 * w[9][k] * l3;
    out[k] = o1, out[n + k] = o2, out[2 * n + k] = o3;
    out[3 * n + k] = w[0][k], out[4 * n + k] = w[1][k], out[5 * n + k] = w[2][k], out[6 * n + k] = w[3][k];
    out[7 * n + k] = 0.5 * (o1 * l1 + o2 * l2 + o3 * l3), out[8 * n + k] = l1 * l1 + l2 * l2 + l3 * l3;
  }
}

static inline __attribute__((always_inline)) void chunk(double *s, long n, long low, long steps, double h, const int heavy, long stride, double *out) {
  double w[16][CHUNK] __attribute__((aligned(64)));
  for (int row = 0; row < 16; row++)
    for (int k = 0; k < CHUNK; k++) w[row][k] = s[row * n + low + k] * (row >= 7 && row < 10 ? 0.5 : 1.0);
  for (long t = 0; t < steps; t++) {
    if (stride && t % stride == 0) save(out + t / stride * 9 * n + low, n, w);
#pragma omp simd aligned(w : 64)
    for (int k = 0; k < CHUNK; k++) {
      double s0 = w[0][k], s1 = w[1][k], s2 = w[2][k], s3 = w[3][k], s4 = w[4][k], s5 = w[5][k], s6 = w[6][k];
      double hi1 = w[7][k], hi2 = w[8][k], hi3 = w[9][k], a1 = w[10][k], a2 = w[11][k], a3 = w[12][k];
      double p1 = 0, p2 = 0, p3 = 0;
      if (heavy) p1 = w[13][k], p2 = w[14][k], p3 = w[15][k];
      RATES(a_, s)
      AHEAD(x, h / 2, a_)
      RATES(b_, x)
      AHEAD(y, h / 2, b_)
      RATES(c_, y)
      AHEAD(z, h, c_)
      RATES(d_, z)
      double q0 = SUM(0), q1 = SUM(1), q2 = SUM(2), q3 = SUM(3), square = q0 * q0 + q1 * q1 + q2 * q2 + q3 * q3;
      double r = NEWTON ? 1.5 - 0.5 * square : 1 / sqrt(square);
      w[0][k] = r * q0, w[1][k] = r * q1, w[2][k] = r * q2, w[3][k] = r * q3;
      w[4][k] = SUM(4), w[5][k] = SUM(5), w[6][k] = SUM(6);
    }
  }
  if (stride) save(out + steps / stride * 9 * n + low, n, w);
  for (int row = 0; row < 7; row++)
    for (int k = 0; k < CHUNK; k++) s[row * n + low + k] = w[row][k];
}

/* functions of their own: gcc outlines a parallel region before it inlines, and `heavy` would be a variable there */
static __attribute__((noinline)) void chunk_free(double *s, long n, long low, long steps, double h) {
  chunk(s, n, low, steps, h, 0, 0, 0);
}
static __attribute__((noinline)) void chunk_heavy(double *s, long n, long low, long steps, double h) {
  chunk(s, n, low, steps, h, 1, 0, 0);
}

static __attribute__((noinline)) void chunk_saves(double *s, long n, long low, long steps, double h, long stride, double *out) {
  chunk(s, n, low, steps, h, 0, stride, out);
}

void rk4_free(double *s, long n, long steps, double h) {
#pragma omp parallel for schedule(dynamic, 4)
  for (long low = 0; low < n; low += CHUNK) chunk_free(s, n, low, steps, h);
}

void rk4_heavy(double *s, long n, long steps, double h) {
#pragma omp parallel for schedule(dynamic, 4)
  for (long low = 0; low < n; low += CHUNK) chunk_heavy(s, n, low, steps, h);
}

/* the same, saved every `stride` steps and at the end to out (steps/stride + 1, 9, n); stride divides steps */
void rk4_free_saves(double *s, long n, long steps, double h, long stride, double *out) {
#pragma omp parallel for schedule(dynamic, 4)
  for (long low = 0; low < n; low += CHUNK) chunk_saves(s, n, low, steps, h, stride, out);
}
