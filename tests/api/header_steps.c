/* What a program in C does with nhbm.h, held against closed forms of linear structures. Each step gives the line of the first check
 * that does not hold, 0 where all do. */
#include "nhbm.h"

#include <complex.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#define CHECK(what) do { if (!(what)) return __LINE__; } while (0)
#define SAYS(words) (strstr(nhbm_get_last_error(), words) != NULL) /* the last error */
#define NEAR(a, b, tolerance) (fabs((a) - (b)) <= (tolerance))

int table_step(void);
int feature_step(void);
int progress_step(void);
/* Sets a number by its path. */
static int set_number(nhbm_model *model, const char *path, double value)
{
   int group;
   const int status = nhbm_find_group(model, path, &group);

   return status ? status : nhbm_set_real(model, group, strchr(path, '%') + 1, value);
}

int refusal_step(void);
int motion_step(void);
int curve_step(void);
int record_step(void);
int verdict_step(void);
int structure_step(void);
int rotors_step(void);
int description_step(void);
int doubt_step(void);
int wrong_structure_step(void);
int ending_step(void);
int law_step(void);
int numbers_step(void);

/* m x'' + c x' + (k + a) x = F cos(w t), the spring a being a law. */
static const char *const oscillator =
   "&structure type = 'chain', n_masses = 1, ends = 'free', mass = 2.0, coupling_stiffness = 0.0, ground_stiffness = 1.0,\n"
   " damping_mass = 0.2 /\n"
   "&tones frequency = 0.9 /\n"
   "&harmonics order = 2 /\n"
   "&load dof = 'x1', tuple = 1, cos = 0.3 /\n"
   "&law type = 'polynomial', label = 'spring', dof = 'x1', stiffness = 3.0 /\n";

static nhbm_model *created(void)
{
   nhbm_model *model;

   return nhbm_create(&model) ? NULL : model;
}

static double complex answer(double stiffness, double frequency)
{
   return 0.3/(1.0 + stiffness - 2.0*frequency*frequency + I*2.0*0.2*frequency);
}

/* The first harmonic of x1 is c cos + s sin; its amplitude c - i s. */
static double complex first_harmonic(nhbm_model *model)
{
   nhbm_column found;
   const double *values;

   if (nhbm_get_column(model, "coefficients", &found) || found.data == NULL) return NAN;
   values = (const double *)found.data + found.shape[2];
   return values[0] - I*values[1];
}

/* Texts of a model; NULL if the function fails. */
static const char *labels_of(nhbm_model *model, const char *axis)
{
   const char *labels;

   return nhbm_get_labels(model, axis, &labels) ? NULL : labels;
}

static const char *text_of(nhbm_model *model, int (*get)(const nhbm_model *model, const char **text))
{
   const char *text;

   return get(model, &text) ? NULL : text;
}

static int advice_on_model(const nhbm_model *model, const char **text)
{
   return nhbm_get_advice((nhbm_model *)model, NHBM_ADVICE_ON_MODEL, text);
}

static int advice_on_motion(const nhbm_model *model, const char **text)
{
   return nhbm_get_advice((nhbm_model *)model, NHBM_ADVICE_ON_MOTION, text);
}

static int status_of(nhbm_model *model)
{
   nhbm_column found;

   if (nhbm_get_column(model, "status", &found) || found.kind != NHBM_INTEGER || found.n_axes != 0) return -99;
   return *(const int32_t *)found.data;
}

int table_step(void)
{
   char row[NHBM_KEY_ROW_SIZE];
   const size_t n = nhbm_get_key_count();

   CHECK(nhbm_get_api_version() == NHBM_API_VERSION);
   CHECK(strlen(nhbm_get_version()) >= 5);
   for (size_t k = 0; k < n; ++k) {
      int bars = 0;
      CHECK(nhbm_get_key_row(k, row, sizeof row) == NHBM_SUCCESS);
      for (const char *at = row; *at; ++at) bars += *at == '|';
      CHECK(bars >= 6);
   }
   CHECK(n > 100);
   CHECK(nhbm_get_key_row(0, row, sizeof row) == NHBM_SUCCESS);
   {
      const size_t length = strlen(row);
      CHECK(nhbm_get_key_row(0, row, length + 1) == NHBM_SUCCESS && strlen(row) == length);
      CHECK(nhbm_get_key_row(0, row, length) == NHBM_INVALID_ARGUMENT && row[0] == '\0');
   }
   return 0;
}

int feature_step(void)
{
   int major, minor, patch;

   CHECK(sscanf(nhbm_get_version(), "%d.%d.%d", &major, &minor, &patch) == 3);
   CHECK(nhbm_get_version_number() == 10000*major + 100*minor + patch);
   CHECK(nhbm_has_feature("cvode") == 1); /* this build */
   CHECK(nhbm_has_feature("curve") == 1 && nhbm_has_feature("law jenkins") == 1);
   CHECK(nhbm_has_feature("law") == 1 && nhbm_has_feature("law jenkin") == 0);
   CHECK(nhbm_has_feature("") == 0 && nhbm_has_feature(NULL) == 0 && nhbm_has_feature("curve ") == 0 &&
         nhbm_has_feature("cvode ") == 0);
   return 0;
}

int refusal_step(void)
{
   nhbm_column found;
   nhbm_model *model = created();
   int group;

   CHECK(nhbm_read_input(model, "&structure type = 'chian' /\n", "wrong") == NHBM_INVALID_INPUT);
   CHECK(SAYS("chian") && SAYS("wrong"));
   CHECK(nhbm_read_input(model, oscillator, "oscillator") == NHBM_SUCCESS);
   CHECK(nhbm_find_group(model, "law(sprung)%stiffness", &group) == NHBM_INVALID_INPUT && group == 0);
   CHECK(SAYS("'law(sprung)%stiffness'"));
   CHECK(nhbm_find_group(model, "tones%frequensy", &group) == NHBM_INVALID_INPUT && SAYS("did you mean 'frequency'?"));
   CHECK(nhbm_find_group(model, "law(1)%stifness", &group) == NHBM_INVALID_INPUT && SAYS("unknown key 'stifness'"));
   CHECK(nhbm_find_group(model, "solver%tolerence", &group) == NHBM_INVALID_INPUT && SAYS("'tolerance'"));
   CHECK(nhbm_solve(model, NHBM_COLD_START) == NHBM_SUCCESS);
   CHECK(nhbm_find_group(model, "tones%frequency", &group) == NHBM_SUCCESS && group > 0);
   CHECK(nhbm_set_real(model, 0, "frequency", 1.0) == NHBM_INVALID_ARGUMENT && SAYS("handle"));
   CHECK(nhbm_set_real(model, 1000, "frequency", 1.0) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_set_real(model, group, "frequensy", 1.0) == NHBM_INVALID_ARGUMENT && SAYS("did you mean 'frequency'?"));
   CHECK(nhbm_set_real(model, group, "frequency", -1.0) == NHBM_SUCCESS);
   CHECK(nhbm_solve(model, NHBM_COLD_START) == NHBM_INVALID_INPUT && SAYS("frequenc"));
   CHECK(nhbm_find_group(model, "tones%frequency(1", &group) == NHBM_INVALID_INPUT);
   CHECK(nhbm_find_group(model, "tones%frequency", &group) == NHBM_SUCCESS);
   CHECK(nhbm_set_real(model, group, "frequency(1", 1.0) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_set_real(model, group, "frequency", 1.0) == NHBM_SUCCESS);
   CHECK(nhbm_solve(model, NHBM_COLD_START) == NHBM_SUCCESS);
   CHECK(nhbm_get_column(model, "coefficient", &found) == NHBM_INVALID_ARGUMENT && found.kind == NHBM_NO_VALUES &&
         found.data == NULL);
   CHECK(SAYS("'coefficient'; known: ") && SAYS(" coefficients "));
   CHECK(nhbm_verify(model, 5) == NHBM_SUCCESS);
   CHECK(nhbm_get_time_column(model, "displacement", &found) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_integrate(model) == NHBM_INVALID_INPUT && SAYS("missing integration%duration"));
   CHECK(nhbm_curve_begin(model) == NHBM_INVALID_INPUT && SAYS("curve"));
   nhbm_destroy(&model);
   CHECK(model == NULL);
   nhbm_destroy(&model);
   return 0;
}

int motion_step(void)
{
   nhbm_column found;
   nhbm_model *model = created();
   int tones, spring;

   CHECK(nhbm_read_input(model, oscillator, "oscillator") == NHBM_SUCCESS);
   CHECK(nhbm_solve(model, NHBM_WARM_START) == NHBM_SUCCESS);
   CHECK(status_of(model) == 1 && strcmp(text_of(model, nhbm_get_message), "") == 0);
   CHECK(cabs(first_harmonic(model) - answer(3.0, 0.9)) < 1e-12);
   CHECK(nhbm_get_column(model, "coefficients", &found) == NHBM_SUCCESS);
   CHECK(found.kind == NHBM_REAL && found.n_axes == 3 && found.shape[0] == 1 && found.shape[1] == 3 && found.shape[2] == 2);
   CHECK(strcmp(found.axes, "dof harmonic component") == 0 && strcmp(found.unit, "m") == 0);
   CHECK(nhbm_get_column(model, "frequency", &found) == NHBM_SUCCESS && strcmp(found.unit, "rad/s") == 0);
   CHECK(NEAR(*(const double *)found.data, 0.9, 0.0));
   CHECK(strstr(text_of(model, nhbm_get_column_names), "status") &&
         strstr(text_of(model, nhbm_get_column_names), " coefficients "));
   CHECK(strcmp(labels_of(model, "dof"), "x1") == 0 && strcmp(labels_of(model, "law"), "spring") == 0);
   CHECK(strcmp(labels_of(model, "law_dof"), "x1") == 0 && strcmp(labels_of(model, "state_dof"), "x1") == 0);
   CHECK(strcmp(labels_of(model, "tone"), "") == 0);
   CHECK(nhbm_find_group(model, "tones%frequency", &tones) == NHBM_SUCCESS);
   CHECK(nhbm_find_group(model, "law(spring)%stiffness(1)", &spring) == NHBM_SUCCESS);
   CHECK(nhbm_set_real(model, tones, "frequency", 1.7) == NHBM_SUCCESS);
   CHECK(nhbm_set_real(model, spring, "stiffness(1)", 5.0) == NHBM_SUCCESS);
   CHECK(nhbm_solve(model, NHBM_WARM_START) == NHBM_SUCCESS && status_of(model) == 1);
   CHECK(cabs(first_harmonic(model) - answer(5.0, 1.7)) < 1e-12);
   CHECK(strstr(text_of(model, nhbm_get_input), "frequency = 1.7") && strstr(text_of(model, nhbm_get_input), "&solver"));
   CHECK(set_number(model, "load(1)%cos", 0.6) == NHBM_SUCCESS && nhbm_solve(model, NHBM_COLD_START) == NHBM_SUCCESS);
   CHECK(cabs(first_harmonic(model) - 2.0*answer(5.0, 1.7)) < 1e-12);
   nhbm_destroy(&model);
   return 0;
}

int curve_step(void)
{
   nhbm_column found;
   nhbm_model *model = created();
   char text[1000];
   int is_point, n = 0;
   double last = 0.0;

   snprintf(text, sizeof text, "%s%s", oscillator,
            "&curve parameter = 'law(spring)%stiffness(1)', from = 1.0, to = 4.0, values = 2.5 /\n");
   CHECK(nhbm_read_input(model, text, "oscillator") == NHBM_SUCCESS);
   CHECK(nhbm_curve_next(model, &is_point) == NHBM_INVALID_STATE && is_point == 0);
   CHECK(nhbm_curve_begin(model) == NHBM_SUCCESS);
   for (;;) {
      CHECK(nhbm_curve_next(model, &is_point) == NHBM_SUCCESS);
      if (!is_point) break;
      CHECK(status_of(model) == 1);
      CHECK(nhbm_get_column(model, "law_spring_stiffness_1", &found) == NHBM_SUCCESS);
      CHECK(*(const double *)found.data >= last);
      last = *(const double *)found.data;
      CHECK(cabs(first_harmonic(model) - answer(last, 0.9)) < 1e-9);
      ++n;
   }
   CHECK(n > 5 && NEAR(last, 4.0, 0.0));
   CHECK(nhbm_curve_next(model, &is_point) == NHBM_SUCCESS && is_point == 0);
   CHECK(nhbm_verify(model, 5) == NHBM_INVALID_STATE); /* the motion is one of a curve */
   CHECK(nhbm_solve(model, NHBM_COLD_START) == NHBM_SUCCESS && cabs(first_harmonic(model) - answer(3.0, 0.9)) < 1e-9);
   nhbm_destroy(&model);
   return 0;
}

/* From rest: the answer to the load less what decays of it. */
static double from_rest(double t)
{
   const double complex x = answer(3.0, 0.9), rate = -0.1 + I*sqrt(2.0 - 0.01);
   const double position = -creal(x), speed = cimag(x)*0.9;
   /* exp(-0.1 t) (A cos + B sin): A = -x(0), B from the speed */
   const double other = (speed + 0.1*position)/cimag(rate);

   return creal(x*cexp(I*0.9*t)) + exp(-0.1*t)*(position*cos(cimag(rate)*t) + other*sin(cimag(rate)*t));
}

int record_step(void)
{
   nhbm_column times, found;
   nhbm_model *model = created();
   char text[1000];
   double at[3], value[3];
   int64_t n;

   snprintf(text, sizeof text, "%s%s", oscillator, "&integration duration = 12.0, step = 0.25, tolerance = 1e-11, n_peaks = 1 /\n");
   CHECK(nhbm_read_input(model, text, "oscillator") == NHBM_SUCCESS);
   CHECK(nhbm_integrate(model) == NHBM_SUCCESS);
   CHECK(nhbm_get_time_column(model, "time", &times) == NHBM_SUCCESS && times.n_axes == 1);
   n = (int64_t)times.shape[0];
   CHECK(n >= 48);
   for (int i = 0; i < 3; ++i) at[i] = ((const double *)times.data)[i*(n - 1)/2];
   CHECK(nhbm_get_time_column(model, "displacement", &found) == NHBM_SUCCESS && strcmp(found.axes, "dof time") == 0);
   CHECK(found.n_axes == 2 && found.shape[0] == 1 && found.shape[1] == (size_t)n && strcmp(found.unit, "m") == 0);
   for (int i = 0; i < 3; ++i) value[i] = ((const double *)found.data)[i*(n - 1)/2];
   for (int i = 0; i < 3; ++i) CHECK(NEAR(value[i], from_rest(at[i]), 1e-8));
   CHECK(nhbm_get_time_column(model, "force", &found) == NHBM_SUCCESS && strcmp(found.axes, "law_coordinate time") == 0);
   for (int i = 0; i < 3; ++i) CHECK(NEAR(((const double *)found.data)[i*(n - 1)/2], 3.0*value[i], 1e-12));
   CHECK(nhbm_get_time_column(model, "state_displacement", &found) == NHBM_SUCCESS);
   CHECK(NEAR(*(const double *)found.data, from_rest(12.0), 1e-8));
   CHECK(nhbm_get_time_column(model, "state_time", &found) == NHBM_SUCCESS && NEAR(*(const double *)found.data, 12.0, 1e-9));
   CHECK(nhbm_get_time_column(model, "tuple", &found) == NHBM_SUCCESS && found.kind == NHBM_INTEGER && found.shape[0] == 3);
   CHECK(((const int32_t *)found.data)[0] == 0 && ((const int32_t *)found.data)[2] == 2);
   CHECK(nhbm_get_time_column(model, "coefficients", &found) == NHBM_SUCCESS && found.n_axes == 3 && found.shape[2] == 2);
   CHECK(nhbm_get_time_column(model, "peak_frequency", &found) == NHBM_SUCCESS && found.shape[1] == 1);
   CHECK(nhbm_get_time_column(model, "period", &found) == NHBM_INVALID_ARGUMENT && SAYS("known: time displacement"));
   CHECK(strncmp(text_of(model, nhbm_get_time_column_names), "time displacement velocity force", 32) == 0);
   CHECK(strcmp(labels_of(model, "law_coordinate"), "") != 0);
   nhbm_destroy(&model);
   return 0;
}

/* Averages over whole periods of what has come to rest are the answer to the load. */
int verdict_step(void)
{
   nhbm_column found;
   nhbm_model *model = created();
   char text[1000];

   snprintf(text, sizeof text, "%s%s", oscillator, "&integration transient = 250.0, duration = 70.0, tolerance = 1e-11 /\n");
   CHECK(nhbm_read_input(model, text, "oscillator") == NHBM_SUCCESS);
   CHECK(nhbm_verify(model, 0) == NHBM_INVALID_STATE && SAYS("no motion"));
   CHECK(nhbm_integrate(model) == NHBM_SUCCESS);
   CHECK(nhbm_get_time_column(model, "coefficients", &found) == NHBM_SUCCESS);
   CHECK(NEAR(((const double *)found.data)[2], creal(answer(3.0, 0.9)), 1e-7));
   CHECK(NEAR(((const double *)found.data)[3], -cimag(answer(3.0, 0.9)), 1e-7));
   CHECK(nhbm_solve(model, NHBM_COLD_START) == NHBM_SUCCESS && nhbm_verify(model, 0) == NHBM_SUCCESS);
   CHECK(nhbm_get_time_column(model, "integration_verdict", &found) == NHBM_SUCCESS && found.kind == NHBM_INTEGER &&
         found.n_axes == 0);
   CHECK(*(const int32_t *)found.data == 1);
   CHECK(nhbm_get_time_column(model, "integration_difference", &found) == NHBM_SUCCESS);
   CHECK(*(const double *)found.data < 1e-6);
   CHECK(nhbm_get_time_column(model, "integration_growth", &found) == NHBM_SUCCESS && strcmp(found.unit, "1/s") == 0);
   { /* a motion of the caller: the right one, and one of another amplitude */
      const double frequency = 0.9;
      const int32_t tuples[] = {1};
      double pair[] = {creal(answer(3.0, 0.9)), -cimag(answer(3.0, 0.9))};
      const nhbm_motion motion = {1, 1, 1, &frequency, tuples, pair, 0.0, 0.0, NULL, 1, 0};
      CHECK(nhbm_verify_motion(model, &motion, 0) == NHBM_SUCCESS);
      CHECK(nhbm_get_time_column(model, "integration_verdict", &found) == NHBM_SUCCESS && *(const int32_t *)found.data == 1);
      pair[0] *= 2.0;
      CHECK(nhbm_verify_motion(model, &motion, 0) == NHBM_SUCCESS);
      CHECK(nhbm_get_time_column(model, "integration_verdict", &found) == NHBM_SUCCESS && *(const int32_t *)found.data == 3);
   }
   nhbm_destroy(&model);
   return 0;
}

/* Names, units and words of columns; the input as it was given; the structure. */
int description_step(void)
{
   nhbm_column_description about;
   nhbm_model *model = created();
   const double *frequencies;
   const char *text;
   size_t n;

   CHECK(nhbm_read_input(model, oscillator, "oscillator") == NHBM_SUCCESS && nhbm_solve(model, NHBM_COLD_START) == NHBM_SUCCESS);
   CHECK(nhbm_describe_column(model, "coefficients", &about) == NHBM_SUCCESS);
   CHECK(strcmp(about.long_name, "coefficients of the motion") == 0 && strcmp(about.dof_units, "m") == 0);
   CHECK(strcmp(about.flag_meanings, "") == 0 && about.lowest_flag == 0);
   CHECK(nhbm_describe_column(model, "is_stable", &about) == NHBM_SUCCESS && about.lowest_flag == -1);
   CHECK(strcmp(about.flag_meanings, "unstable unknown stable") == 0);
   CHECK(about.kind == NHBM_INTEGER && nhbm_describe_column(model, "artificial_damping", &about) == NHBM_SUCCESS);
   CHECK(about.kind == NHBM_REAL); /* of a normal mode: its value is not known here */
   CHECK(nhbm_describe_column(model, "coefficient", &about) == NHBM_INVALID_ARGUMENT && SAYS("did you mean 'coefficients'?"));
   CHECK((text = text_of(model, nhbm_get_given_input)) && strstr(text, "damping_mass = 0.2") && !strstr(text, "&solver"));
   CHECK((text = text_of(model, nhbm_get_libraries)) && strcmp(text, "") == 0);
   CHECK(nhbm_get_natural_frequencies(model, &n, &frequencies) == NHBM_SUCCESS && n == 1 && NEAR(frequencies[0], sqrt(0.5), 1e-14));
   CHECK((text = text_of(model, advice_on_model)) && strcmp(text, "") == 0);
   CHECK(set_number(model, "load%cos", 0.0) == NHBM_SUCCESS);
   CHECK((text = text_of(model, advice_on_model)) && strstr(text, "no load acts"));
   CHECK(nhbm_describe_advice(model, "curve_ended_at_graze", 0, NULL, "", &text) == NHBM_SUCCESS && strstr(text, "grazed"));
   CHECK(strlen(nhbm_get_commit()) > 0);
   nhbm_destroy(&model);
   return 0;
}

/* Two masses with a spring between them, the second one on a spring to ground, with structural damping there. */
static int two_masses(void *context, const char *file, nhbm_structure *s)
{
   static const int32_t diagonal[] = {0, 1, 2}, full[] = {0, 2, 4}, at[] = {0, 1}, both[] = {0, 1, 0, 1};
   static const int32_t node[] = {0, 1}, last[] = {1};
   static const double mass[] = {1.0, 2.0}, stiffness[] = {4.0, -4.0, -4.0, 7.0}, loss[] = {0.0, 0.3}, push[] = {1.0, -2.0};
   static const double damping[] = {0.1, -0.1, -0.1, 0.1};

   *(int *)context += 1;
   if (strcmp(file, "two_masses") != 0) {
      nhbm_structure_set_error(s, "only two_masses is known");
      return 1;
   }
   return nhbm_structure_set_dofs(s, "tip root", "mm rad", 50.0) ||
          nhbm_structure_set_matrix(s, "mass", 2, 2, diagonal, at, mass) ||
          nhbm_structure_set_matrix(s, "stiffness", 2, 4, full, both, stiffness) ||
          nhbm_structure_set_matrix(s, "damping", 2, 4, full, both, damping) ||
          nhbm_structure_set_matrix(s, "structural", 2, 2, diagonal, at, loss) || nhbm_structure_add_load(s, "push", 2, at, push) ||
          nhbm_structure_set_nodes(s, 2, 2, node, "x y") || nhbm_structure_add_node_set(s, "ground", 1, last);
}

static const char *const of_structure =
   "&structure type = 'model', file = 'two_masses', structural_frequency = 1.3 /\n"
   "&tones frequency = 1.3 /\n"
   "&harmonics order = 1 /\n"
   "&load vector = 'push', tuple = 1, cos = 0.3 /\n"
   "&law type = 'polynomial', dof = 'tip', stiffness = 3.0 /\n"
   "&output dofs = 'tip', 'ground.y' /\n";

int structure_step(void)
{
   const double w = 1.3;
   const double complex a = 4.0 + 3.0 - w*w + I*0.1*w, b = -4.0 - I*0.1*w, d = 7.0 - 2.0*w*w + I*(0.1*w + 0.3);
   const double complex tip = (0.3*d + 0.6*b)/(a*d - b*b), root = (-0.6*a - 0.3*b)/(a*d - b*b);
   nhbm_column found;
   nhbm_model *model = created();
   const double *values;
   int n_calls = 0;

   nhbm_set_structure_callback(model, two_masses, &n_calls);
   CHECK(nhbm_read_input(model, of_structure, "masses") == NHBM_SUCCESS && n_calls == 1);
   CHECK(nhbm_solve(model, NHBM_COLD_START) == NHBM_SUCCESS && status_of(model) == 1);
   CHECK(cabs(first_harmonic(model) - tip) < 1e-12);
   CHECK(nhbm_get_column(model, "coefficients", &found) == NHBM_SUCCESS && found.shape[0] == 2);
   values = (const double *)found.data + 6;
   CHECK(cabs(values[0] - I*values[1] - root) < 1e-12);
   CHECK(strcmp(labels_of(model, "dof"), "tip\nroot") == 0 && strcmp(labels_of(model, "law_dof"), "tip") == 0);
   nhbm_destroy(&model);
   return 0;
}

/* A disk with two speeds, such as those of two shafts: each matrix has a factor of its own. */
static int disk(void *context, const char *file, nhbm_structure *s)
{
   static const int32_t diagonal[] = {0, 1, 2}, at[] = {0, 1}, across[] = {1, 0};
   static const struct {
      const char *name;
      double factor;
      int is_skew;
   } matrices[] = {
      {"mass", 1.0, 0},
      {"stiffness", 9.0, 0},
      {"damping", 0.2, 0},
      {"gyroscopic", 0.1, 1},
      {"gyroscopic_by_speed", 0.03, 1},
      {"stiffness_by_speed", 0.05, 1},
      {"stiffness_by_speed_squared", -0.02, 0},
      {"gyroscopic_by_speed_2", 0.07, 1},
      {"stiffness_by_speed_2", 0.11, 1},
      {"stiffness_by_speed_squared_2", -0.013, 0},
   };
   int code = nhbm_structure_set_dofs(s, "x y", "", 0.0);

   (void)context;
   (void)file;
   for (size_t i = 0; i < sizeof matrices / sizeof matrices[0] && code == 0; i++) {
      const double factor = matrices[i].factor, plain[] = {factor, factor}, skew[] = {-factor, factor};
      code = matrices[i].is_skew ? nhbm_structure_set_matrix(s, matrices[i].name, 2, 2, diagonal, across, skew)
                                 : nhbm_structure_set_matrix(s, matrices[i].name, 2, 2, diagonal, at, plain);
   }
   return code;
}

int rotors_step(void)
{
   const double w = 1.3, first = 2.0, second = 3.0;
   const double complex a = 9.0 - 0.02*first*first - 0.013*second*second - w*w + I*0.2*w;
   const double complex b = 0.05*first + 0.11*second + I*w*(0.1 + 0.03*first + 0.07*second);
   const double complex x = 0.3*a/(a*a + b*b), y = -0.3*b/(a*a + b*b);
   nhbm_column found;
   nhbm_model *model = created();
   const double *values;

   nhbm_set_structure_callback(model, disk, NULL);
   CHECK(nhbm_read_input(model, "&structure type = 'model', file = 'disk', speed = 2.0, 3.0 /\n"
                                "&tones frequency = 1.3 /\n&harmonics order = 1 /\n&load dof = 'x', tuple = 1, cos = 0.3 /\n",
                         "disk") == NHBM_SUCCESS);
   CHECK(nhbm_solve(model, NHBM_COLD_START) == NHBM_SUCCESS && status_of(model) == 1);
   CHECK(cabs(first_harmonic(model) - x) < 1e-12);
   CHECK(nhbm_get_column(model, "coefficients", &found) == NHBM_SUCCESS && found.shape[0] == 2);
   values = (const double *)found.data + 6;
   CHECK(cabs(values[0] - I*values[1] - y) < 1e-12);
   nhbm_destroy(&model);
   return 0;
}

/* Makes one mistake, the one of the number in the context. */
static int mistaken(void *context, const char *file, nhbm_structure *s)
{
   static const int32_t starts[] = {0, 1, 2}, at[] = {0, 1}, beyond[] = {0, 2}, node[] = {0, 1}, far_off[] = {0, 2};
   static const double mass[] = {1.0, 2.0};
   const int mistake = *(const int *)context;
   int code = nhbm_structure_set_dofs(s, "tip root", mistake == 0 ? "mm" : "", 0.0);

   (void)file;
   if (mistake == 1) code = nhbm_structure_set_matrix(s, "weight", 2, 2, starts, at, mass);
   if (mistake == 2) code = nhbm_structure_set_matrix(s, "mass", 2, 2, starts, beyond, mass);
   if (mistake == 3) code = nhbm_structure_set_nodes(s, 2, 2, node, "x");
   if (mistake == 4) code = nhbm_structure_set_nodes(s, 2, 2, far_off, "x y");
   if (mistake == 5) code = nhbm_structure_add_node_set(s, "ground", 1, at);
   if (mistake < 6) return code == NHBM_INVALID_ARGUMENT ? 1 : 99;
   if (mistake == 6) return nhbm_structure_set_matrix(s, "mass", 2, 2, starts, at, mass);
   return 7;
}

int wrong_structure_step(void)
{
   static const char *const words[] = {"1 units for 2 labels", "no matrix 'weight'", "matrix 'mass'", "1 directions for 2 degrees",
                                       "must be 0 to 1, or -1", "nhbm_structure_set_nodes comes before",
                                       "mass and stiffness must be given", "callback returned 7"};

   for (int mistake = 0; mistake < 8; ++mistake) {
      nhbm_model *model = created();
      nhbm_set_structure_callback(model, mistaken, &mistake);
      CHECK(nhbm_read_input(model, of_structure, "masses") == NHBM_INVALID_INPUT);
      if (!SAYS(words[mistake])) return 1000 + mistake;
      nhbm_destroy(&model);
   }
   {
      nhbm_model *model = created();
      int n_calls = 0;
      nhbm_set_structure_callback(model, two_masses, &n_calls);
      CHECK(nhbm_read_input(model, "&structure type = 'model', file = 'three' /\n&tones frequency = 1.0 /\n",
            "m") == NHBM_INVALID_INPUT);
      CHECK(SAYS("only two_masses is known"));
      nhbm_destroy(&model);
   }
   return 0;
}

static int at_once(void *context)
{
   ++*(int *)context;
   return 1;
}

int ending_step(void)
{
   nhbm_column found;
   nhbm_model *model = created();
   char text[1000];
   int n_asked = 0;

   snprintf(text, sizeof text, "%s%s", oscillator, "&integration duration = 1e6 /\n");
   CHECK(nhbm_read_input(model, text, "oscillator") == NHBM_SUCCESS);
   CHECK(nhbm_set_interrupt_callback(model, at_once, &n_asked) == NHBM_SUCCESS);
   CHECK(nhbm_integrate(model) == NHBM_SUCCESS && n_asked == 1);
   CHECK(nhbm_get_time_column(model, "time", &found) == NHBM_INVALID_STATE); /* it left no record */
   CHECK(nhbm_set_interrupt_callback(model, NULL, NULL) == NHBM_SUCCESS);
   CHECK(nhbm_solve(model, NHBM_COLD_START) == NHBM_SUCCESS && status_of(model) == 1 && n_asked == 1);
   nhbm_destroy(&model);
   return 0;
}

static void note(void *context, const nhbm_progress *progress)
{
   nhbm_progress *last = context;

   if (progress->n_steps > 0 && progress->n_done >= last->n_done && progress->seconds >= last->seconds) *last = *progress;
}

/* Nothing is lost by it, and it ends with its call. */
int progress_step(void)
{
   nhbm_column found;
   nhbm_model *model = created();
   nhbm_progress last = {-1.0, -1, 0}, solved = {-1.0, -1, 0};
   char text[1000];

   snprintf(text, sizeof text, "%s%s", oscillator, "&integration duration = 2e4, step = 0.5, tolerance = 1e-11 /\n");
   CHECK(nhbm_read_input(model, text, "oscillator") == NHBM_SUCCESS);
   CHECK(nhbm_set_progress_callback(model, note, &last) == NHBM_SUCCESS && last.n_done == -1);
   CHECK(nhbm_integrate(model) == NHBM_SUCCESS);
   CHECK(last.seconds > 0.0 && last.n_done > 0 && last.n_done <= last.n_steps);
   CHECK(nhbm_get_time_column(model, "time", &found) == NHBM_SUCCESS && found.shape[0] > (size_t)last.n_done);
   CHECK(nhbm_set_progress_callback(model, note, &solved) == NHBM_SUCCESS && nhbm_solve(model, NHBM_COLD_START) == NHBM_SUCCESS);
   CHECK(solved.n_done == -1 && status_of(model) == 1);
   CHECK(nhbm_set_progress_callback(model, NULL, NULL) == NHBM_SUCCESS && nhbm_integrate(model) == NHBM_SUCCESS &&
         solved.n_done == -1);
   nhbm_destroy(&model);
   return 0;
}

static int spring_evaluate(const nhbm_law_samples_t *s)
{
   const double stiffness = *(const double *)s->context;

   for (int i = 0; i < s->n_samples; ++i) {
      s->f[i] = stiffness*s->z[i];
      if (s->df_dz) s->df_dz[i] = stiffness;
   }
   return 0;
}

/* A cubic spring; `context`: the factor of its derivative, which should be 3. */
static int cubic_evaluate(const nhbm_law_samples_t *s)
{
   const double factor = *(const double *)s->context;

   for (int i = 0; i < s->n_samples; ++i) {
      s->f[i] = 5.0*s->z[i]*s->z[i]*s->z[i];
      if (s->df_dz) s->df_dz[i] = factor*5.0*s->z[i]*s->z[i];
   }
   return 0;
}

/* What is doubtful about a motion: harmonics that are missing, derivatives of a law that are wrong, said once. */
int doubt_step(void)
{
   nhbm_model *model = created();
   nhbm_law_info_t info = {0};
   double factor = 3.0;
   char input[1000];
   const char *text;

   info.api_version = NHBM_USER_LAW_API_2;
   info.n_coordinates = 1;
   info.context = &factor;
   CHECK(nhbm_register_law("cubic", &info, cubic_evaluate) == 0);
   snprintf(input, sizeof input, "%.*s&law type = 'user', library = '', name = 'cubic', label = 'mine', dof = 'x1' /\n"
            "&error_estimate truncation = 1e-12 /\n", (int)(strstr(oscillator, "&law") - oscillator), oscillator);
   CHECK(nhbm_read_input(model, input, "oscillator") == NHBM_SUCCESS && (text = text_of(model, advice_on_motion)) && !*text);
   CHECK(nhbm_solve(model, NHBM_COLD_START) == NHBM_SUCCESS && status_of(model) == 7 && (text = text_of(model, advice_on_motion)));
   CHECK(strstr(text, "truncated") && strstr(text, "by truncation (limit 1.0E-12)") && strstr(text, "double it"));
   CHECK(!strstr(text, "derivative"));
   CHECK(set_number(model, "error_estimate%truncation", 1.0) == NHBM_SUCCESS);
   CHECK(nhbm_solve(model, NHBM_COLD_START) == NHBM_SUCCESS && status_of(model) == 1);
   CHECK((text = text_of(model, advice_on_motion)) && !*text);
   factor = 2.9;
   CHECK(nhbm_read_input(model, input, "oscillator") == NHBM_SUCCESS);
   CHECK(set_number(model, "error_estimate%truncation", 1.0) == NHBM_SUCCESS);
   CHECK(nhbm_solve(model, NHBM_COLD_START) == NHBM_SUCCESS && (text = text_of(model, advice_on_motion)));
   CHECK(strstr(text, "law 'mine': df/dz is not the derivative of its force"));
   CHECK(nhbm_solve(model, NHBM_COLD_START) == NHBM_SUCCESS && (text = text_of(model, advice_on_motion)));
   CHECK(!strstr(text, "derivative"));
   nhbm_unregister_law("cubic");
   nhbm_destroy(&model);
   return 0;
}

/* A law of the program takes the place of one of its name, and lives on in models that have it. */
int law_step(void)
{
   nhbm_model *model = created(), *other = created();
   nhbm_law_info_t info = {0};
   double stiffness[2] = {3.0, 5.0};
   char text[1000];

   snprintf(text, sizeof text, "%.*s&law type = 'user', library = '', name = 'mine', dof = 'x1' /\n",
            (int)(strstr(oscillator, "&law") - oscillator), oscillator);
   CHECK(nhbm_read_input(model, text, "oscillator") == NHBM_INVALID_INPUT && SAYS("no law 'mine'"));
   info.api_version = NHBM_USER_LAW_API;
   info.n_coordinates = 1;
   info.context = &stiffness[0];
   CHECK(nhbm_register_law("mine", &info, spring_evaluate) != 0);
   info.api_version = NHBM_USER_LAW_API_2;
   CHECK(nhbm_register_law("mine", &info, spring_evaluate) == 0);
   CHECK(nhbm_read_input(model, text, "oscillator") == NHBM_SUCCESS && nhbm_solve(model, NHBM_COLD_START) == NHBM_SUCCESS);
   CHECK(cabs(first_harmonic(model) - answer(3.0, 0.9)) < 1e-12);
   info.context = &stiffness[1];
   CHECK(nhbm_register_law("mine", &info, spring_evaluate) == 0);
   CHECK(nhbm_read_input(other, text, "oscillator") == NHBM_SUCCESS && nhbm_solve(other, NHBM_COLD_START) == NHBM_SUCCESS);
   CHECK(cabs(first_harmonic(other) - answer(5.0, 0.9)) < 1e-12);
   nhbm_unregister_law("mine");
   nhbm_unregister_law("mine");
   CHECK(nhbm_read_input(other, text, "oscillator") == NHBM_INVALID_INPUT);
   CHECK(nhbm_solve(model, NHBM_COLD_START) == NHBM_SUCCESS && cabs(first_harmonic(model) - answer(3.0, 0.9)) < 1e-12);
   nhbm_destroy(&model);
   nhbm_destroy(&other);
   return 0;
}

/* An input from numbers is that of the text: the same motion, bit for bit, and the text of one can be read as the other. */
int numbers_step(void)
{
   nhbm_model *model = created(), *other = created();
   const double frequency[] = {0.9};
   const int order[] = {2}, tuple[] = {1}, one[] = {1}, off[] = {0};
   const char *const dofs[] = {"x1"}, *text;
   int group;
   double complex first;

   CHECK(!nhbm_add_group(model, "structure", &group) && !nhbm_set_text(model, group, "type", "chain"));
   CHECK(!nhbm_set_integers(model, group, "n_masses", 1, one) && !nhbm_set_text(model, group, "ends", "free"));
   CHECK(!nhbm_set_real(model, group, "mass", 7.0) && !nhbm_set_real(model, group, "MASS", 2.0)); /* the last value counts */
   CHECK(!nhbm_set_real(model, group, "coupling_stiffness", 0.0) && !nhbm_set_real(model, group, "ground_stiffness", 1.0));
   CHECK(!nhbm_set_real(model, group, "damping_mass", 0.2));
   CHECK(!nhbm_add_group(model, "tones", &group) && !nhbm_set_reals(model, group, "frequency", 1, frequency));
   CHECK(!nhbm_add_group(model, "harmonics", &group) && !nhbm_set_integers(model, group, "order", 1, order));
   CHECK(!nhbm_add_group(model, "load", &group) && !nhbm_set_text(model, group, "dof", "x1"));
   CHECK(!nhbm_set_integers(model, group, "tuple", 1, tuple) && !nhbm_set_real(model, group, "cos", 0.3));
   CHECK(!nhbm_add_group(model, "law", &group) && !nhbm_set_text(model, group, "type", "polynomial"));
   CHECK(!nhbm_set_text(model, group, "label", "spring") && !nhbm_set_text(model, group, "dof", "x1"));
   CHECK(!nhbm_set_real(model, group, "stiffness", 3.0));
   CHECK(!nhbm_add_group(model, "error_estimate", &group) && !nhbm_set_logicals(model, group, "is_on", 1, off));
   CHECK(nhbm_check(model) == NHBM_SUCCESS && nhbm_solve(model, NHBM_COLD_START) == NHBM_SUCCESS);
   first = first_harmonic(model);
   CHECK(cabs(first - answer(3.0, 0.9)) < 1e-12);
   CHECK(nhbm_get_given_input(model, &text) == NHBM_SUCCESS && nhbm_read_input(other, text, "numbers") == NHBM_SUCCESS);
   CHECK(nhbm_solve(other, NHBM_COLD_START) == NHBM_SUCCESS && first_harmonic(other) == first);
   CHECK(set_number(model, "law(spring)%stiffness", 5.0) == NHBM_SUCCESS && nhbm_solve(model, NHBM_COLD_START) == NHBM_SUCCESS);
   CHECK(cabs(first_harmonic(model) - answer(5.0, 0.9)) < 1e-12);
   CHECK(!nhbm_add_group(model, "law", &group) && !nhbm_set_text(model, group, "type", "polynomial"));
   CHECK(!nhbm_set_texts(model, group, "dofs", 1, dofs) && !nhbm_set_real(model, group, "stiffness", 7.0));
   CHECK(nhbm_check_group(model, group) == NHBM_INVALID_INPUT && SAYS("&law: ") && SAYS("'weights'"));
   CHECK(!nhbm_set_reals(model, group, "weights", 1, frequency) && nhbm_check_group(model, group) == NHBM_SUCCESS);
   CHECK(nhbm_solve(model, NHBM_COLD_START) == NHBM_SUCCESS);
   CHECK(cabs(first_harmonic(model) - answer(5.0 + 0.81 * 7.0, 0.9)) < 1e-12);
   CHECK(!nhbm_remove_group(model, group) && nhbm_remove_group(model, group) == NHBM_INVALID_ARGUMENT && SAYS("handle"));
   CHECK(nhbm_solve(model, NHBM_COLD_START) == NHBM_SUCCESS && cabs(first_harmonic(model) - answer(5.0, 0.9)) < 1e-12);
   nhbm_destroy(&model);
   nhbm_destroy(&other);
   return 0;
}
