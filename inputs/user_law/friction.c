/* Elastic Coulomb friction, a law with memory: a spring k in series with a slider that slips at the force limit R. Its state is the
 * position w of the slider, f = k (z - w), |z - w| <= R/k: the law `jenkins` of nhbm. The functions are documented in nhbm_user_law.h.
 *
 *    cc -O2 -shared -fPIC -I ../../src/laws -o friction.so friction.c -lm
 */
#include "nhbm_user_law.h"
#include <math.h>
#include <stddef.h>

enum { Z, Z_BEFORE, RISE, RISE_BEFORE, N_PARTS };

/* The weights of what is known of z in the value where its cubic turns within the step. */
static void turning_point(const double path[N_PARTS], double weights[N_PARTS])
{
   const double h = path[Z] - path[Z_BEFORE], c = path[RISE_BEFORE];
   const double a = 3 * (path[RISE] + c - 2 * h), b = 2 * (3 * h - 2 * c - path[RISE]);
   const double q = -.5 * (b + copysign(sqrt(fmax(b * b - 4 * a * c, 0)), b));
   double x = 1;
   if (fabs(c) <= fabs(q) && c * q > 0)
      x = c / q;
   else if (fabs(q) <= fabs(a) && q * a > 0)
      x = q / a;
   weights[Z_BEFORE] = (1 + 2 * x) * (1 - x) * (1 - x);
   weights[Z] = (3 - 2 * x) * x * x;
   weights[RISE_BEFORE] = x * (1 - x) * (1 - x);
   weights[RISE] = (x - 1) * x * x;
}

/* The slider stays, unless z - half or z + half pushes it: at the start, where z turns, at the end. */
static double slide(double w, const double path[N_PARTS], double half, double *by_before, double by_path[N_PARTS])
{
   double weights[3][N_PARTS] = {{0}};
   int i, k;
   weights[0][Z_BEFORE] = weights[2][Z] = 1;
   if (path[RISE] * path[RISE_BEFORE] < 0) turning_point(path, weights[1]);
   *by_before = 1;
   for (k = 0; k < N_PARTS; k++) by_path[k] = 0;
   for (i = 0; i < 3; i++) {
      double z = 0;
      const int may_turn = path[RISE] * path[RISE_BEFORE] < 0;
      for (k = 0; k < N_PARTS; k++) z += weights[i][k] * path[k];
      if (i == 1 && !may_turn) continue;
      if (fabs(z - w) <= half || (i == 1 && (z > w) != (path[RISE_BEFORE] > 0))) continue;
      w = z > w ? z - half : z + half;
      *by_before = 0;
      for (k = 0; k < N_PARTS; k++) by_path[k] = weights[i][k];
   }
   return w;
}

static int advance(const nhbm_law_step_t *s)
{
   const double *known[N_PARTS] = {s->z, s->z_before, s->rise, s->rise_before};
   double *slope[N_PARTS] = {s->ds_dz, s->ds_dz_before, s->ds_drise, s->ds_drise_before};
   double by_before, by_path[N_PARTS], path[N_PARTS];
   int i, k;
   for (i = 0; i < s->n_samples; i++) {
      for (k = 0; k < N_PARTS; k++) path[k] = known[k][i];
      s->states[i] = slide(s->states_before[i], path, s->parameters[1] / s->parameters[0], &by_before, by_path);
      if (s->ds_dbefore == NULL) continue;
      s->ds_dbefore[i] = by_before;
      for (k = 0; k < N_PARTS; k++) slope[k][i] = by_path[k];
   }
   return 0;
}

int friction_info(nhbm_law_info_t *info)
{
   info->api_version = NHBM_USER_LAW_API_2;
   info->n_coordinates = 1;
   info->n_parameters = 2; /* k [N/m], R [N] */
   info->n_states = 1;
   info->advance = advance;
   return 0;
}

int friction_evaluate(const nhbm_law_samples_t *s)
{
   int i;
   for (i = 0; i < s->n_samples; i++) {
      s->f[i] = s->parameters[0] * (s->z[i] - s->states[i]);
      if (s->df_dz != NULL) s->df_dz[i] = s->parameters[0];
      if (s->df_ds != NULL) s->df_ds[i] = -s->parameters[0];
   }
   return 0;
}
