/* A Duffing oscillator at five frequencies, each motion starting from the one before: frequency and cosine of the first harmonic.
 *
 *    cc duffing.c -lnhbm -o duffing */
#include <stdio.h>

#include "nhbm.h"

static const char *const text =
   "&structure type = 'matrices', n_dofs = 1, mass = 1.0, stiffness = 1.0,\n"
   " damping_mass = 0.1 /\n"
   "&tones frequency = 0.9 /\n"
   "&load dof = 'x1', tuple = 1, cos = 0.3 /\n"
   "&law type = 'cubic_spring', label = 'spring', dof = 'x1', stiffness = 0.5 /\n";

int main(void) {
   nhbm_model *model = NULL;
   nhbm_column coefficients;
   int tones, k;

   if (nhbm_get_api_version() != NHBM_API_VERSION || nhbm_create(&model) || nhbm_read_input(model, text, "duffing")) goto failed;
   if (nhbm_find_group(model, "tones%frequency", &tones)) goto failed;
   for (k = 0; k < 5; ++k) {
      const double value = 0.5 + 0.25 * k;
      if (nhbm_set_real(model, tones, "frequency", value)) goto failed;
      if (nhbm_solve(model, k > 0 ? NHBM_WARM_START : NHBM_COLD_START)) goto failed;
      if (nhbm_get_column(model, "coefficients", &coefficients)) goto failed;
      /* (dof, harmonic, component): the second harmonic of the set is that of the tone, its first component the cosine */
      printf("%.2f %.17g\n", value, ((const double *)coefficients.data)[coefficients.shape[2]]);
   }
   nhbm_destroy(&model);
   return 0;

failed:
   fprintf(stderr, "%s\n", nhbm_get_last_error());
   nhbm_destroy(&model);
   return 1;
}
