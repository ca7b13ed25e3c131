/* The machine's FMA peak: twelve independent chains of the widest vectors, enough to hide a latency of 4 to 6 cycles on 2 units. */
#if defined(__AVX512F__)
#define BYTES 64
#elif defined(__AVX__)
#define BYTES 32
#else
#define BYTES 16
#endif
typedef double v __attribute__((vector_size(BYTES)));

static __attribute__((noinline)) double chains(long count) {
  v c0 = {0.1}, c1 = {0.2}, c2 = {0.3}, c3 = {0.4}, c4 = {0.5}, c5 = {0.6}, c6 = {0.7}, c7 = {0.8}, c8 = {0.9}, c9 = {1.0};
  v ca = {1.1}, cb = {1.2}, m = c0 * 0 + 0.999, a = c0 * 0 + 0.001;
  for (long i = 0; i < count; i++) {
    c0 = c0 * m + a, c1 = c1 * m + a, c2 = c2 * m + a, c3 = c3 * m + a, c4 = c4 * m + a, c5 = c5 * m + a;
    c6 = c6 * m + a, c7 = c7 * m + a, c8 = c8 * m + a, c9 = c9 * m + a, ca = ca * m + a, cb = cb * m + a;
#ifdef __x86_64__ /* gcc must not reshape the loop: an array of chains went through memory, 20 GFLOP/s instead of 58 */
    __asm__ volatile("" : "+v"(c0), "+v"(c1), "+v"(c2), "+v"(c3), "+v"(c4), "+v"(c5));
    __asm__ volatile("" : "+v"(c6), "+v"(c7), "+v"(c8), "+v"(c9), "+v"(ca), "+v"(cb));
#endif
  }
  c0 += c1 + c2 + c3 + c4 + c5 + c6 + c7 + c8 + c9 + ca + cb;
  return c0[0];
}

/* 12 chains x BYTES/8 lanes x 2 flops x count on each thread; returns the flops */
double fma_peak(long count, int threads) {
  static volatile double kept; /* so that the chains are not optimised away */
  double total = 0;
#pragma omp parallel for num_threads(threads) reduction(+ : total) schedule(static, 1)
  for (int k = 0; k < threads; k++) total += chains(count);
  kept = total;
  return 12.0 * (BYTES / 8) * 2.0 * count * threads;
}
