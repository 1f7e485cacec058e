/* Solves inputs in one process by nhbm.h and looks at each number of each result, for tests/valgrind: what a process starts with is
 * paid for once, and a number that was never set is found where it is looked at.
 *
 * usage: solve_inputs INPUT...
 *
 * Prints what it has looked at, and what was refused: not all laws can be integrated by all methods. Exit status: 0, 1 an input is wrong,
 * 2 wrong use. */
#define _POSIX_C_SOURCE 200809L
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "nhbm.h"

typedef int (*column_function)(const nhbm_model *, const char *, nhbm_column *);
typedef int (*names_function)(const nhbm_model *, const char **);
enum { converged = 1, n_periods = 2 };

/* Whether a function succeeded; says so if it did not. */
static int succeeded(const char *what, int status) {
   if (status == NHBM_SUCCESS) return 1;
   printf("   %s: %s\n", what, nhbm_get_last_error());
   return 0;
}

static char *text_of(const char *path) {
   FILE *file = fopen(path, "rb");
   char *text = calloc(1, 1 << 20);

   if (file == NULL || text == NULL || fread(text, 1, (1 << 20) - 1, file) == 0) {
      fprintf(stderr, "solve_inputs: cannot read %s\n", path);
      exit(2);
   }
   fclose(file);
   return text;
}

/* Decides by each value, which a checker reports if it was not set; how many are above zero. */
static size_t look_at(const nhbm_column *column) {
   size_t n_positive = 0;

   for (size_t i = 0; i < column->n_values && column->kind != NHBM_NO_VALUES; ++i) {
      if (column->kind == NHBM_REAL) {
         if (((const double *)column->data)[i] > 0.0) ++n_positive;
      } else {
         if (((const int32_t *)column->data)[i] > 0) ++n_positive;
      }
   }
   return n_positive;
}

static void look_at_columns(const nhbm_model *model, names_function list, column_function get) {
   const char *names = NULL;
   char *copy, *rest = NULL;

   if (!succeeded("names", list(model, &names))) return;
   copy = malloc(strlen(names) + 1);
   if (copy == NULL) exit(2);
   strcpy(copy, names);
   for (char *name = strtok_r(copy, " ", &rest); name != NULL; name = strtok_r(NULL, " ", &rest)) {
      nhbm_column column;
      if (succeeded(name, get(model, name, &column))) printf("   %s: %zu\n", name, look_at(&column));
   }
   free(copy);
}

/* The texts about the model and its last motion. */
static void look_at_texts(nhbm_model *model) {
   static const char *const axes[] = {"dof", "law_dof", "law", "law_coordinate", "gradient_value", "state_dof"};
   const char *text = NULL;

   if (succeeded("message", nhbm_get_message(model, &text))) printf("   message: %s\n", text);
   if (succeeded("advice", nhbm_get_advice(model, NHBM_ADVICE_ON_MOTION, &text))) printf("   advice: %s\n", text);
   if (succeeded("laws", nhbm_get_advice(model, NHBM_ADVICE_ON_LAWS, &text))) printf("   laws: %s\n", text);
   for (size_t i = 0; i < sizeof axes / sizeof *axes; ++i) {
      if (succeeded(axes[i], nhbm_get_labels(model, axes[i], &text))) printf("   labels: %s\n", text);
   }
}

/* The last motion: its columns and texts; its status. */
static int look_at_motion(const char *name, const char *what, nhbm_model *model) {
   nhbm_column status;
   int value = -1;

   if (succeeded("status", nhbm_get_column(model, "status", &status)) && status.kind == NHBM_INTEGER) {
      value = *(const int32_t *)status.data;
   }
   printf("%s: %s, status %d\n", name, what, value);
   look_at_columns(model, nhbm_get_column_names, nhbm_get_column);
   look_at_texts(model);
   return value;
}

static void look_at_record(const char *name, const char *what, nhbm_model *model) {
   printf("%s: %s\n", name, what);
   look_at_columns(model, nhbm_get_time_column_names, nhbm_get_time_column);
}

static void look_at_model(nhbm_model *model) {
   const double *frequencies = NULL;
   const char *text = NULL;
   size_t n = 0;

   if (succeeded("advice", nhbm_get_advice(model, NHBM_ADVICE_ON_MODEL, &text))) printf("   advice: %s\n", text);
   if (succeeded("input", nhbm_get_input(model, &text))) printf("   input: %zu characters\n", strlen(text));
   if (succeeded("natural frequencies", nhbm_get_natural_frequencies(model, &n, &frequencies))) {
      nhbm_column column = {.data = frequencies, .kind = NHBM_REAL, .n_values = n};
      printf("   natural frequencies: %zu\n", look_at(&column));
   }
}

/* What the groups of an input ask for: its curve, or its motion, time integration along it and the next motion from there; its record.
 * Whether the input was read. */
static int solve(const char *name) {
   nhbm_model *model = NULL;
   char *text = text_of(name);
   int tones, has_point = 0, is_read, status = -1;

   if (!succeeded("model", nhbm_create(&model))) exit(2);
   is_read = succeeded("input", nhbm_read_input(model, text, name));
   if (is_read) {
      look_at_model(model);
      if (strstr(text, "&curve") != NULL) {
         if (succeeded("curve", nhbm_curve_begin(model))) {
            while (succeeded("curve", nhbm_curve_next(model, &has_point)) && has_point) look_at_motion(name, "curve", model);
         }
      } else {
         if (succeeded("motion", nhbm_solve(model, NHBM_COLD_START))) status = look_at_motion(name, "motion", model);
         if (status == converged && succeeded("verification", nhbm_verify(model, n_periods))) look_at_record(name, "verification", model);
         if (succeeded("frequency", nhbm_find_group(model, "tones%frequency(1)", &tones)) &&
             succeeded("value", nhbm_set_real(model, tones, "frequency(1)", 0.9)) &&
             succeeded("next motion", nhbm_solve(model, NHBM_WARM_START))) look_at_motion(name, "next motion", model);
      }
      if (strstr(text, "&integration") != NULL && succeeded("record", nhbm_integrate(model))) look_at_record(name, "record", model);
   }
   nhbm_destroy(&model);
   free(text);
   return is_read;
}

int main(int n, char **words) {
   int n_wrong = 0;

   if (n < 2) {
      fprintf(stderr, "usage: solve_inputs INPUT...\n");
      return 2;
   }
   setvbuf(stdout, NULL, _IOLBF, 0);                                  /* in order with the reports of a checker */
   for (int i = 1; i < n; ++i) n_wrong += !solve(words[i]);
   return n_wrong > 0;
}
