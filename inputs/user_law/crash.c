/* A law that ends the process: a spring whose stiffness must not be negative, and that calls abort() where it is. Its point gets the
 * status `crashed`; nhbm resume solves the points behind it.
 *
 *    cc -O2 -shared -fPIC -I ../../src/laws -o crash.so crash.c
 */
#include "nhbm_user_law.h"
#include <stddef.h>
#include <stdlib.h>

int crash_info(nhbm_law_info_t *info)
{
   info->api_version = NHBM_USER_LAW_API;
   info->n_coordinates = 1;
   info->n_parameters = 1; /* stiffness [N/m] */
   return 0;
}

int crash_evaluate(int n_samples, int n_coordinates, int stride, const double *z, const double *v, int n_parameters,
                   const double *parameters, double *f, double *df_dz, double *df_dv)
{
   const double stiffness = parameters[0];
   int i;

   (void)n_coordinates, (void)stride, (void)v, (void)n_parameters, (void)df_dv;
   if (stiffness < 0) abort();
   for (i = 0; i < n_samples; i++) {
      f[i] = stiffness * z[i];
      if (df_dz != NULL) df_dz[i] = stiffness;
   }
   return 0;
}
