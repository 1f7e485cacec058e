#include "hb_blas.h"

#include <stdlib.h>

/* From OpenBLAS's cblas.h; null where BLAS comes from another library. */
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

int hb_n_blas_threads(void)
{
   return openblas_get_num_threads == NULL ? 0 : openblas_get_num_threads();
}
