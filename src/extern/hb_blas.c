#define _DEFAULT_SOURCE /* for MAP_ANONYMOUS */
#include "hb_blas.h"

#include <stdlib.h>
#include <sys/mman.h>

/* From OpenBLAS's cblas.h; null if BLAS is another library. */
void openblas_set_num_threads(int n_threads) __attribute__((weak));
int openblas_get_num_threads(void) __attribute__((weak));

void hb_use_one_blas_thread(void)
{
   static const char *const choices[] = {"OPENBLAS_NUM_THREADS", "GOTO_NUM_THREADS", "OMP_NUM_THREADS"};

   if (openblas_set_num_threads == NULL) return;
   for (size_t i = 0; i < sizeof choices / sizeof choices[0]; i++) {
      const char *value = getenv(choices[i]);
      if (value != NULL && *value != '\0') return;
   }
   openblas_set_num_threads(1);
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
   return openblas_get_num_threads == NULL ? 0 : openblas_get_num_threads();
}
