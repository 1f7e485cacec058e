/* Cubic spring f = k3 z**3 as a law of one's own, in C. The functions are documented in nhbm_user_law.h.
 *
 *    cc -O2 -shared -fPIC -I ../../src/laws -o cubic_c.so cubic_spring.c
 *
 * -I names the folder of the header; where nhbm is installed that is its folder `include`.
 */
#include "nhbm_user_law.h"
#include <stddef.h>

int cubic_c_info(nhbm_law_info_t *info)
{
   info->api_version = NHBM_USER_LAW_API;
   info->n_coordinates = 1;
   info->n_parameters = 1; /* k3 [N/m3] */
   info->needs_velocity = 0;
   info->degree = 3;
   return 0;
}

int cubic_c_evaluate(int n_samples, int n_coordinates, int stride, const double *z, const double *v, int n_parameters,
                     const double *parameters, double *f, double *df_dz, double *df_dv)
{
   const double k3 = parameters[0];

   (void)n_coordinates, (void)stride, (void)v, (void)n_parameters, (void)df_dv;
   for (int i = 0; i < n_samples; i++)
      f[i] = k3 * (z[i] * z[i] * z[i]);
   if (df_dz != NULL)
      for (int i = 0; i < n_samples; i++)
         df_dz[i] = 3.0 * k3 * (z[i] * z[i]);
   return 0;
}
