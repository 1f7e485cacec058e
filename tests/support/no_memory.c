/* Creates models until memory is exhausted, which the library must report, frees them, and solves one. */
#include <stdio.h>
#include <sys/resource.h>

#include "nhbm.h"

static const char *const text =
   "&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0, ground_stiffness = 1.0,\n"
   " damping_mass = 0.1 /\n&tones frequency = 0.9 /\n&load dof = 'x1', tuple = 1, cos = 0.3 /\n&harmonics order = 5 /\n";

int main(void) {
   static nhbm_model *models[1000000];
   const rlim_t megabyte = 1048576;
   struct rlimit limit = {1024*megabyte, 1024*megabyte};
   int n = 0, status;
   nhbm_column column;

   if (setrlimit(RLIMIT_AS, &limit)) return 2;
   while ((status = nhbm_create(&models[n])) == NHBM_SUCCESS && n < 999999) ++n;
   if (status != NHBM_OUT_OF_MEMORY || models[n] != NULL) return 3;
   printf("%s: %s\n", nhbm_status_text(status), nhbm_get_last_error());
   while (n-- > 0)
      if (nhbm_destroy(&models[n])) return 4;
   if (nhbm_create(&models[0]) || nhbm_read_input(models[0], text, "model") || nhbm_solve(models[0], NHBM_COLD_START)) return 5;
   if (nhbm_get_column(models[0], "status", &column) || *(const int32_t *)column.data != 1) return 6;
   return nhbm_destroy(&models[0]) ? 7 : 0;
}
