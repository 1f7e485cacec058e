#define _DEFAULT_SOURCE /* for MAP_ANONYMOUS */
#include "hb_blas.h"

#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>

/* From cblas.h of OpenBLAS, mkl_service.h and blis.h (its dim_t has the width of a pointer); null if BLAS is another library. */
void openblas_set_num_threads(int n_threads) __attribute__((weak));
int openblas_get_num_threads(void) __attribute__((weak));
void MKL_Set_Num_Threads(int n_threads) __attribute__((weak));
int MKL_Get_Max_Threads(void) __attribute__((weak));
void bli_thread_set_num_threads(intptr_t n_threads) __attribute__((weak));
intptr_t bli_thread_get_num_threads(void) __attribute__((weak));

/* Number of threads that the user of nhbm requests. */
static int requested_threads(void)
{
   const char *value = getenv("NHBM_BLAS_THREADS");
   const long n = value == NULL ? 1 : strtol(value, NULL, 10);
   return n < 1 || n > 1024 ? 1 : (int)n;
}

static void set_threads(int n_threads)
{
   if (openblas_set_num_threads != NULL) openblas_set_num_threads(n_threads);
   if (MKL_Set_Num_Threads != NULL) MKL_Set_Num_Threads(n_threads);
   if (bli_thread_set_num_threads != NULL) bli_thread_set_num_threads(n_threads);
}

void hb_limit_blas_threads(void)
{
   set_threads(requested_threads());
}

int hb_borrow_blas(void)
{
   const int n_before = hb_n_blas_threads();
   const int n = requested_threads();
   if (n_before > 0 && n_before != n) set_threads(n);
   return n_before;
}

void hb_return_blas(int n_before)
{
   if (n_before > 0 && n_before != hb_n_blas_threads()) set_threads(n_before);
}

/* Size of the buffer that each thread of OpenBLAS 0.3 allocates at its first call; its own constant is not exported. */
static const size_t buffer_bytes = 144u << 20;

int hb_allocate_blas_memory(void)
{
   void dpotrf_(const char *, const int *, double *, const int *, int *, size_t);
   const int n = 1;
   int info;
   double one = 1.0;

   if (openblas_set_num_threads != NULL) {
      const size_t n_bytes = buffer_bytes * (size_t)openblas_get_num_threads();
      void *const room = mmap(NULL, n_bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
      if (room == MAP_FAILED) return -1;
      munmap(room, n_bytes);
   }
   dpotrf_("L", &n, &one, &n, &info, 1);
   return 0;
}

int hb_n_blas_threads(void)
{
   if (openblas_get_num_threads != NULL) return openblas_get_num_threads();
   if (MKL_Get_Max_Threads != NULL) return MKL_Get_Max_Threads();
   return bli_thread_get_num_threads == NULL ? 0 : (int)bli_thread_get_num_threads();
}
