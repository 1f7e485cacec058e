/* A spring that cannot be stretched beyond a, f = k z/sqrt(1 - (z/a)**2), and that is not a number (NaN) there.
 *
 *    cc -O2 -shared -fPIC -I ../../src/laws -o limited_spring.so limited_spring.c -lm
 */
#include "nhbm_user_law.h"
#include <math.h>
#include <stddef.h>

int limited_spring_info(nhbm_law_info_t *info)
{
   info->api_version = NHBM_USER_LAW_API;
   info->n_coordinates = 1;
   info->n_parameters = 2; /* k [N/m], a [m] */
   return 0;
}

int limited_spring_evaluate(int n_samples, int n_coordinates, int stride, const double *z, const double *v,
                            int n_parameters, const double *parameters, double *f, double *df_dz, double *df_dv)
{
   const double k = parameters[0], a = parameters[1];

   (void)n_coordinates, (void)stride, (void)v, (void)n_parameters, (void)df_dv;
   for (int i = 0; i < n_samples; i++) {
      const double root = sqrt(1.0 - (z[i] / a) * (z[i] / a)); /* NaN beyond a */
      f[i] = k * z[i] / root;
      if (df_dz != NULL)
         df_dz[i] = k / (root * root * root);
   }
   return 0;
}
