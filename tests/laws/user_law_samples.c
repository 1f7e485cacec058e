/* Laws for the tests of hb_law_user: one that works and several that fail, each in its own way. */
#include "nhbm_user_law.h"
#include <math.h>
#include <stddef.h>

static int describe(nhbm_law_info_t *info, int n_coordinates, int n_parameters, int needs_velocity)
{
   info->api_version = NHBM_USER_LAW_API;
   info->n_coordinates = n_coordinates;
   info->n_parameters = n_parameters;
   info->needs_velocity = needs_velocity;
   return 0;
}

/* Two coordinates, not symmetric: f_0 = a z_0 z_1**2 + b v_0 z_1, f_1 = -v_0**2 v_1. */
int coupled_info(nhbm_law_info_t *info)
{
   return describe(info, 2, 2, 1);
}

int coupled_evaluate(int n, int n_coordinates, int stride, const double *z, const double *v, int n_parameters,
                     const double *parameters, double *f, double *df_dz, double *df_dv)
{
   const double a = parameters[0], b = parameters[1];

   (void)n_parameters;
   for (int i = 0; i < n; i++) {
      const double x = z[i], y = z[i + stride], u = v[i], w = v[i + stride];
      f[i] = a * x * y * y + b * u * y;
      f[i + stride] = -u * u * w;
      if (df_dz != NULL) {
         df_dz[i] = a * y * y;
         df_dz[i + stride] = 0.0;
         df_dz[i + stride * n_coordinates] = 2.0 * a * x * y + b * u;
         df_dz[i + stride * (1 + n_coordinates)] = 0.0;
      }
      if (df_dv != NULL) {
         df_dv[i] = b * y;
         df_dv[i + stride] = -2.0 * u * w;
         df_dv[i + stride * n_coordinates] = 0.0;
         df_dv[i + stride * (1 + n_coordinates)] = -u * u;
      }
   }
   return 0;
}

/* A spring of stiffness 1 in one coordinate. */
static void spring(int n, const double *z, double *f, double *df_dz, double slope)
{
   for (int i = 0; i < n; i++) {
      f[i] = z[i];
      if (df_dz != NULL)
         df_dz[i] = slope;
   }
}

/* A spring that cannot be stretched beyond 1, f = z/sqrt(1 - z**2), and is not a number there. */
int asymptote_info(nhbm_law_info_t *info)
{
   return describe(info, 1, 0, 0);
}

int asymptote_evaluate(int n, int n_coordinates, int stride, const double *z, const double *v, int n_parameters,
                     const double *parameters, double *f, double *df_dz, double *df_dv)
{
   (void)n_coordinates, (void)stride, (void)v, (void)n_parameters, (void)parameters, (void)df_dv;
   for (int i = 0; i < n; i++) {
      const double root = fabs(z[i]) < 1.0 ? sqrt(1.0 - z[i] * z[i]) : (double)NAN;
      f[i] = z[i] / root;
      if (df_dz != NULL)
         df_dz[i] = 1.0 / (root * root * root);
   }
   return 0;
}

static int is_beyond(int n, const double *z, double limit)
{
   for (int i = 0; i < n; i++)
      if (fabs(z[i]) > limit)
         return 1;
   return 0;
}

/* Its derivative has the wrong sign. */
int wrong_sign_info(nhbm_law_info_t *info)
{
   return describe(info, 1, 0, 0);
}

int wrong_sign_evaluate(int n, int n_coordinates, int stride, const double *z, const double *v, int n_parameters,
                        const double *parameters, double *f, double *df_dz, double *df_dv)
{
   (void)n_coordinates, (void)stride, (void)v, (void)n_parameters, (void)parameters, (void)df_dv;
   spring(n, z, f, df_dz, -1.0);
   return 0;
}

/* Out of range, to be tried elsewhere, beyond |z| = parameter. */
int limited_info(nhbm_law_info_t *info)
{
   return describe(info, NHBM_ANY_NUMBER, 1, 0);
}

int limited_evaluate(int n, int n_coordinates, int stride, const double *z, const double *v, int n_parameters,
                     const double *parameters, double *f, double *df_dz, double *df_dv)
{
   (void)n_coordinates, (void)stride, (void)v, (void)n_parameters, (void)df_dv;
   spring(n, z, f, df_dz, 1.0);
   return is_beyond(n, z, parameters[0]) ? 3 : 0;
}

/* Cannot go on beyond |z| = parameter. */
int fatal_info(nhbm_law_info_t *info)
{
   return describe(info, 1, 1, 0);
}

int fatal_evaluate(int n, int n_coordinates, int stride, const double *z, const double *v, int n_parameters,
                   const double *parameters, double *f, double *df_dz, double *df_dv)
{
   (void)n_coordinates, (void)stride, (void)v, (void)n_parameters, (void)df_dv;
   spring(n, z, f, df_dz, 1.0);
   return is_beyond(n, z, parameters[0]) ? -7 : 0;
}

/* Not a number beyond |z| = parameter, without saying so: 0/0, which raises a floating-point exception as well. */
int undefined_info(nhbm_law_info_t *info)
{
   return describe(info, 1, 1, 0);
}

int undefined_evaluate(int n, int n_coordinates, int stride, const double *z, const double *v, int n_parameters,
                       const double *parameters, double *f, double *df_dz, double *df_dv)
{
   volatile double zero = 0.0;

   (void)n_coordinates, (void)stride, (void)v, (void)n_parameters, (void)df_dv;
   spring(n, z, f, df_dz, 1.0);
   for (int i = 0; i < n; i++)
      if (fabs(z[i]) > parameters[0])
         f[i] = zero / zero;
   return 0;
}

/* Its force is fine, its derivative is not. */
int undefined_slope_info(nhbm_law_info_t *info)
{
   return describe(info, 1, 1, 0);
}

int undefined_slope_evaluate(int n, int n_coordinates, int stride, const double *z, const double *v, int n_parameters,
                             const double *parameters, double *f, double *df_dz, double *df_dv)
{
   (void)n_coordinates, (void)stride, (void)v, (void)n_parameters, (void)parameters, (void)df_dv;
   spring(n, z, f, df_dz, NAN);
   return 0;
}

/* A cubic spring of version 2 of the interface: its stiffness is its context. */
int with_context_info(nhbm_law_info_t *info)
{
   static double stiffness = 1.5;
   info->api_version = NHBM_USER_LAW_API_2;
   info->n_coordinates = 1;
   info->context = &stiffness;
   return 0;
}

int with_context_evaluate(const nhbm_law_samples_t *s)
{
   const double k = *(const double *)s->context;
   for (int i = 0; i < s->n_samples; ++i) {
      s->f[i] = k*s->z[i]*s->z[i]*s->z[i];
      if (s->df_dz) s->df_dz[i] = 3.0*k*s->z[i]*s->z[i];
   }
   return s->v || s->df_dv ? -1 : 0;
}

/* A spring whose stiffness, its first parameter, may be any but those as near to the second as the third. */
int gapped_info(nhbm_law_info_t *info)
{
   return describe(info, 1, 3, 0);
}

int gapped_evaluate(int n, int n_coordinates, int stride, const double *z, const double *v, int n_parameters,
                    const double *parameters, double *f, double *df_dz, double *df_dv)
{
   (void)n_coordinates, (void)stride, (void)v, (void)n_parameters, (void)df_dv;
   for (int i = 0; i < n; i++) {
      f[i] = parameters[0] * z[i];
      if (df_dz != NULL)
         df_dz[i] = parameters[0];
   }
   return fabs(parameters[0] - parameters[1]) < parameters[2] ? 3 : 0;
}

/* Of phases and frequencies of two tones: f = a cos(tau_1 + 2 tau_2) z + omega_1 omega_2**2. */
int geared_info(nhbm_law_info_t *info)
{
   info->api_version = NHBM_USER_LAW_API_2;
   info->n_coordinates = 1;
   info->n_parameters = 1;
   info->needs_phases = 1;
   info->needs_frequencies = 1;
   return 0;
}

int geared_evaluate(const nhbm_law_samples_t *s)
{
   if (s->n_tones != 2 || s->n_states != 0) return -1;
   for (int i = 0; i < s->n_samples; ++i) {
      const double slope = s->parameters[0]*cos(s->phases[i] + 2.0*s->phases[i + s->stride]);
      s->f[i] = slope*s->z[i] + s->frequencies[0]*s->frequencies[1]*s->frequencies[1];
      if (s->df_dz) s->df_dz[i] = slope;
   }
   return 0;
}

/* With one state, of which each step leaves the part r: s = r s_before + z - z_before + c (rise - rise_before), f = a z + b s. */
static int fading_advance(const nhbm_law_step_t *s)
{
   const double r = s->parameters[2], c = s->parameters[3];
   for (int i = 0; i < s->n_samples; ++i) {
      s->states[i] = r*s->states_before[i] + s->z[i] - s->z_before[i] + c*(s->rise[i] - s->rise_before[i]);
      if (!s->ds_dz) continue;
      s->ds_dbefore[i] = r;
      s->ds_dz[i] = 1.0;
      s->ds_dz_before[i] = -1.0;
      s->ds_drise[i] = c;
      s->ds_drise_before[i] = -c;
   }
   return 0;
}

int fading_info(nhbm_law_info_t *info)
{
   info->api_version = NHBM_USER_LAW_API_2;
   info->n_coordinates = 1;
   info->n_parameters = 4;
   info->n_states = 1;
   info->length_scale = 1.0;
   info->advance = fading_advance;
   return 0;
}

int fading_evaluate(const nhbm_law_samples_t *s)
{
   for (int i = 0; i < s->n_samples; ++i) {
      s->f[i] = s->parameters[0]*s->z[i] + s->parameters[1]*s->states[i];
      if (s->df_dz) s->df_dz[i] = s->parameters[0];
      if (s->df_ds) s->df_ds[i] = s->parameters[1];
   }
   return 0;
}

/* Has a state, but nothing that moves it. */
int stuck_info(nhbm_law_info_t *info)
{
   info->api_version = NHBM_USER_LAW_API_2;
   info->n_coordinates = 1;
   info->n_states = 1;
   return 0;
}

int stuck_evaluate(const nhbm_law_samples_t *s)
{
   (void)s;
   return 0;
}

/* Made for another version of the interface. */
int other_version_info(nhbm_law_info_t *info)
{
   info->api_version = NHBM_USER_LAW_API_2 + 1;
   return 0;
}

int other_version_evaluate(void)
{
   return 0;
}

/* Refuses to be used. */
int refusing_info(nhbm_law_info_t *info)
{
   (void)info;
   return 5;
}

int refusing_evaluate(void)
{
   return 0;
}

/* Lacks its evaluate function. */
int half_info(nhbm_law_info_t *info)
{
   return describe(info, 1, 0, 0);
}

/* Springs of stiffness 1 that break a promise each: forces that are never written, ... */
int silent_info(nhbm_law_info_t *info)
{
   return describe(info, 1, 0, 0);
}

int silent_evaluate(int n, int n_coordinates, int stride, const double *z, const double *v, int n_parameters,
                    const double *parameters, double *f, double *df_dz, double *df_dv)
{
   (void)n, (void)n_coordinates, (void)stride, (void)z, (void)v, (void)n_parameters, (void)parameters, (void)f, (void)df_dz;
   (void)df_dv;
   return 0;
}

/* ... other forces at each call, ... */
int restless_info(nhbm_law_info_t *info)
{
   return describe(info, 1, 0, 0);
}

int restless_evaluate(int n, int n_coordinates, int stride, const double *z, const double *v, int n_parameters,
                      const double *parameters, double *f, double *df_dz, double *df_dv)
{
   static int n_calls = 0;

   (void)n_coordinates, (void)stride, (void)v, (void)n_parameters, (void)parameters, (void)df_dv;
   spring(n, z, f, df_dz, 1.0);
   n_calls++;
   for (int i = 0; i < n; i++) f[i] += 1.0e-3 * n_calls;
   return 0;
}

/* ... and inputs that are written. */
int greedy_info(nhbm_law_info_t *info)
{
   return describe(info, 1, 1, 0);
}

int greedy_evaluate(int n, int n_coordinates, int stride, const double *z, const double *v, int n_parameters,
                    const double *parameters, double *f, double *df_dz, double *df_dv)
{
   double *const mine = (double *)(size_t)z, *const parameter = (double *)(size_t)parameters;

   (void)n_coordinates, (void)stride, (void)v, (void)n_parameters, (void)df_dv;
   spring(n, z, f, df_dz, 1.0);
   for (int i = 0; i < n; i++) mine[i] = 0.0;
   parameter[0] = 0.0;
   return 0;
}
