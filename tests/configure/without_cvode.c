/* What a library without CVODE answers where it is needed, and a law of the program in a library made of shared ones. */
#include <stdio.h>
#include <string.h>

#include "nhbm.h"

static const char *const text =
   "&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0, ground_stiffness = 1.0,\n"
   " damping_mass = 0.1 /\n"
   "&tones frequency = 0.9 /\n"
   "&load dof = 'x1', tuple = 1, cos = 0.3 /\n"
   "&law type = 'user', library = '', name = 'mine', dof = 'x1' /\n"
   "&integration duration = 50.0, step = 0.01 /\n";

static int spring(const nhbm_law_samples_t *s)
{
   for (int i = 0; i < s->n_samples; ++i) {
      s->f[i] = 2.0*s->z[i];
      if (s->df_dz) s->df_dz[i] = 2.0;
   }
   return 0;
}

int main(void)
{
   nhbm_law_info_t info = {0};
   nhbm_column verdict;
   nhbm_model *model = NULL;
   int group;

   info.api_version = NHBM_USER_LAW_API_2;
   info.n_coordinates = 1;
   if (nhbm_has_feature("cvode") || nhbm_register_law("mine", &info, spring) || nhbm_create(&model) ||
       nhbm_read_input(model, text, "oscillator"))
      goto failed;
   if (!nhbm_integrate(model) || !strstr(nhbm_get_last_error(), "without SUNDIALS and has no 'cvode'")) goto failed;
   if (nhbm_solve(model, NHBM_COLD_START) || nhbm_verify(model, 0)) goto failed;
   if (nhbm_get_time_column(model, "integration_verdict", &verdict) || *(const int32_t *)verdict.data != 1) goto failed;
   if (nhbm_find_group(model, "integration%method", &group) || nhbm_set_text(model, group, "method", "runge_kutta_4") ||
       nhbm_integrate(model)) goto failed;
   nhbm_unregister_law("mine");
   nhbm_destroy(&model);
   return 0;

failed:
   fprintf(stderr, "%s\n", nhbm_get_last_error());
   nhbm_destroy(&model);
   return 1;
}
