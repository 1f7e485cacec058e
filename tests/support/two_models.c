/* Two threads, each with models of its own: errors of the input, points of laws, one of them given by this program. Both print what
 * they found, so that a race shows as a difference, too; a race detector sees more. */
#include <pthread.h>
#include <stdio.h>
#include <string.h>

#include "nhbm.h"

#define OSCILLATOR \
   "&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0, ground_stiffness = 1.0,\n" \
   " damping_mass = 0.1 /\n&tones frequency = 0.9 /\n&load dof = 'x1', tuple = 1, cos = 0.3 /\n&harmonics order = 5 /\n"

static const char *const texts[] = {
   OSCILLATOR "&law type = 'cubic_spring', dof = 'x1', stifness = 0.5 /\n",
   OSCILLATOR "&law type = 'cubic_sprin', dof = 'x2', stiffness = -0.5 /\n",
   OSCILLATOR "&law type = 'cubic_spring', dof = 'x1', stiffness = 0.5 /\n",
   OSCILLATOR "&law type = 'elastic_stop', label = 'stop', dof = 'x1', stiffness = 5.0, gap = 0.2 /\n",
   OSCILLATOR "&law type = 'jenkins', label = 'joint', dof = 'x1', stiffness = 1.0, limit = 0.1 /\n",
   OSCILLATOR "&law type = 'user', library = '', name = 'given', dof = 'x1' /\n",
};
enum { n_texts = sizeof texts / sizeof texts[0] };

typedef struct {
   char lines[n_texts][400];
} found_t;

/* A cubic spring, of version 2 of the interface for laws. */
static int given(const nhbm_law_samples_t *s) {
   for (int i = 0; i < s->n_samples; ++i) {
      s->f[i] = *(const double *)s->context * s->z[i] * s->z[i] * s->z[i];
      if (s->df_dz) s->df_dz[i] = 3.0 * *(const double *)s->context * s->z[i] * s->z[i];
   }
   return 0;
}

static void *run(void *data) {
   found_t *found = data;

   for (int i = 0; i < n_texts; ++i) {
      nhbm_column amplitude;
      nhbm_model *model = NULL;

      if (nhbm_create(&model) || nhbm_read_input(model, texts[i], "two_models") || nhbm_solve(model, NHBM_COLD_START) ||
          nhbm_get_column(model, "coefficients", &amplitude)) {
         snprintf(found->lines[i], sizeof found->lines[i], "%s", nhbm_get_last_error());
      } else {
         snprintf(found->lines[i], sizeof found->lines[i], "%.17g", ((const double *)amplitude.data)[amplitude.shape[2]]);
      }
      nhbm_destroy(&model);
   }
   return NULL;
}

int main(void) {
   static found_t alone, found[2];
   pthread_t threads[2];
   static double stiffness = 0.5;
   nhbm_law_info_t info = {.api_version = NHBM_USER_LAW_API_2, .n_coordinates = 1, .context = &stiffness};

   if (nhbm_register_law("given", &info, given)) return 2;
   run(&alone);
   for (int i = 0; i < 2; ++i) pthread_create(&threads[i], NULL, run, &found[i]);
   for (int i = 0; i < 2; ++i) pthread_join(threads[i], NULL);
   for (int i = 0; i < n_texts; ++i) {
      puts(alone.lines[i]);
      if (strcmp(alone.lines[i], found[0].lines[i]) || strcmp(alone.lines[i], found[1].lines[i])) return 1;
   }
   return 0;
}
