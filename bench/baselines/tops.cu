/* The CUDA C baseline: textbook rk4, one thread per top, its state in registers from the first step
 * to the last. Built on the spot by bench/baselines.
 *
 * Rows as in tops.c: q0..q3, l1..l3, reciprocal moments i1..i3, a1..a3 with dl1/dt = a1 l2 l3 + tau1,
 * weight times centre of mass p1..p3. nvcc fuses products with sums and rounds divisions and roots.
 */
#include <cuda_runtime.h>

#define ROWS 16
#define STATE 7

/* d = rates of y = (q, l): q' = q (0, omega)/2, l' = l x omega - p x u, u the vertical in the body */
template <bool HEAVY> __device__ __forceinline__ void rates(const double *y, const double *hi, const double *a, const double *p, double *d) {
  double w1 = hi[0] * y[4], w2 = hi[1] * y[5], w3 = hi[2] * y[6];
  d[0] = -y[1] * w1 - y[2] * w2 - y[3] * w3;
  d[1] = y[0] * w1 + y[2] * w3 - y[3] * w2;
  d[2] = y[0] * w2 + y[3] * w1 - y[1] * w3;
  d[3] = y[0] * w3 + y[1] * w2 - y[2] * w1;
  d[4] = a[0] * y[5] * y[6], d[5] = a[1] * y[6] * y[4], d[6] = a[2] * y[4] * y[5];
  if (HEAVY) {
    double u1 = 2 * (y[1] * y[3] - y[0] * y[2]), u2 = 2 * (y[2] * y[3] + y[0] * y[1]);
    double u3 = y[0] * y[0] - y[1] * y[1] - y[2] * y[2] + y[3] * y[3];
    d[4] += u2 * p[2] - u3 * p[1], d[5] += u3 * p[0] - u1 * p[2], d[6] += u1 * p[1] - u2 * p[0];
  }
}

template <bool HEAVY> __global__ void __launch_bounds__(128) steps(double *s, long n, long count, double h) {
  long i = blockIdx.x * (long)blockDim.x + threadIdx.x;
  if (i >= n) return;
  double y[STATE], hi[3], a[3], p[3], x[STATE], k[4][STATE];
  for (int r = 0; r < STATE; r++) y[r] = s[r * n + i];
  for (int r = 0; r < 3; r++) hi[r] = 0.5 * s[(7 + r) * n + i], a[r] = s[(10 + r) * n + i], p[r] = s[(13 + r) * n + i];
  for (long t = 0; t < count; t++) {
    rates<HEAVY>(y, hi, a, p, k[0]);
    for (int j = 1; j < 4; j++) {
      double c = j < 3 ? 0.5 * h : h;
      for (int r = 0; r < STATE; r++) x[r] = y[r] + c * k[j - 1][r];
      rates<HEAVY>(x, hi, a, p, k[j]);
    }
    for (int r = 0; r < STATE; r++) y[r] += h / 6 * (k[0][r] + 2 * (k[1][r] + k[2][r]) + k[3][r]);
    double length = 1 / sqrt(y[0] * y[0] + y[1] * y[1] + y[2] * y[2] + y[3] * y[3]);
    for (int r = 0; r < 4; r++) y[r] *= length;
  }
  for (int r = 0; r < STATE; r++) s[r * n + i] = y[r];
}

/* Moves n tops by `count` steps; returns the seconds of the kernel alone, or minus the CUDA error. */
extern "C" double rk4_cuda(double *rows, long n, long count, double h, int heavy) {
  double *there = 0;
  float milliseconds = 0;
  cudaEvent_t begin, end;
  cudaMalloc(&there, ROWS * n * sizeof(double));
  cudaMemcpy(there, rows, ROWS * n * sizeof(double), cudaMemcpyHostToDevice);
  cudaEventCreate(&begin), cudaEventCreate(&end);
  unsigned blocks = (unsigned)((n + 127) / 128);
  cudaEventRecord(begin);
  if (heavy) steps<true><<<blocks, 128>>>(there, n, count, h);
  else steps<false><<<blocks, 128>>>(there, n, count, h);
  cudaEventRecord(end), cudaEventSynchronize(end);
  cudaEventElapsedTime(&milliseconds, begin, end);
  cudaMemcpy(rows, there, STATE * n * sizeof(double), cudaMemcpyDeviceToHost);
  cudaError_t error = cudaGetLastError();
  cudaEventDestroy(begin), cudaEventDestroy(end), cudaFree(there);
  return error ? -(double)error : milliseconds / 1e3;
}
