/* What a program in C does with nhbm.h, held against closed forms of linear structures. Each step gives the line of the first check
 * that does not hold, 0 where all do. */
#include "nhbm.h"

#include <complex.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#define CHECK(what) do { if (!(what)) return __LINE__; } while (0)
#define NEAR(a, b, tolerance) (fabs((a) - (b)) <= (tolerance))

int table_step(void);
int feature_step(void);
int progress_step(void);
int refusal_step(void);
int motion_step(void);
int curve_step(void);
int record_step(void);
int verdict_step(void);
int structure_step(void);
int wrong_structure_step(void);
int ending_step(void);
int law_step(void);

/* m x'' + c x' + (k + a) x = F cos(w t), the spring a being a law. */
static const char *const oscillator =
   "&structure type = 'chain', n_masses = 1, ends = 'free', mass = 2.0, coupling_stiffness = 0.0, ground_stiffness = 1.0,\n"
   " damping_mass = 0.2 /\n"
   "&tones frequency = 0.9 /\n"
   "&harmonics order = 2 /\n"
   "&load dof = 'x1', tuple = 1, cos = 0.3 /\n"
   "&law type = 'polynomial', label = 'spring', dof = 'x1', stiffness = 3.0 /\n";

static double complex answer(double stiffness, double frequency)
{
   return 0.3/(1.0 + stiffness - 2.0*frequency*frequency + I*2.0*0.2*frequency);
}

/* The first harmonic of x1 is c cos + s sin; its amplitude c - i s. */
static double complex first_harmonic(nhbm_model *model)
{
   nhbm_error error;
   nhbm_column found;
   const double *values;

   if (nhbm_column_of(model, "coefficients", &found, &error) || found.data == NULL) return NAN;
   values = (const double *)found.data + found.shape[2];
   return values[0] - I*values[1];
}

static int status_of(nhbm_model *model)
{
   nhbm_error error;
   nhbm_column found;

   if (nhbm_column_of(model, "status", &found, &error) || found.kind != 1 || found.n_axes != 0) return -99;
   return *(const int32_t *)found.data;
}

int table_step(void)
{
   char row[1200], start[4];
   int n = 0;

   CHECK(nhbm_api() == NHBM_API);
   CHECK(strlen(nhbm_version()) >= 5);
   CHECK(!nhbm_key(-1, row, sizeof row));
   CHECK(!nhbm_key(0, row, 0));
   while (nhbm_key(n, row, sizeof row)) {
      int bars = 0;
      for (const char *at = row; *at; ++at) bars += *at == '|';
      CHECK(bars >= 6);
      ++n;
   }
   CHECK(n > 100);
   CHECK(nhbm_key(n - 1, row, sizeof row) && nhbm_key(n - 1, start, sizeof start));
   CHECK(strlen(start) == 3 && strncmp(start, row, 3) == 0);
   return 0;
}

int feature_step(void)
{
   int major, minor, patch;

   CHECK(sscanf(nhbm_version(), "%d.%d.%d", &major, &minor, &patch) == 3);
   CHECK(nhbm_version_number() == 10000*major + 100*minor + patch);
   CHECK(nhbm_has("cvode") == 1); /* this build */
   CHECK(nhbm_has("curve") == 1 && nhbm_has("law jenkins") == 1);
   CHECK(nhbm_has("law") == 1 && nhbm_has("law jenkin") == 0 && nhbm_has("") == 0 && nhbm_has("curve ") == 0 && nhbm_has("cvode ") == 0);
   return 0;
}

int refusal_step(void)
{
   nhbm_error error;
   nhbm_column found;
   nhbm_model *model = nhbm_new();
   int handle;

   CHECK(nhbm_read(model, "&structure type = 'chian' /\n", "wrong", &error) == NHBM_INPUT && error.code == NHBM_INPUT);
   CHECK(strstr(error.text, "chian") && strstr(error.text, "wrong"));
   CHECK(nhbm_read(model, oscillator, "oscillator", &error) == NHBM_OK && error.code == NHBM_OK && error.text[0] == '\0');
   CHECK(nhbm_parameter(model, "law(sprung)%stiffness", &handle, &error) == NHBM_INPUT && handle == 0);
   CHECK(strstr(error.text, "'law(sprung)%stiffness'"));
   CHECK(nhbm_set(model, 1, 1.0, &error) == NHBM_USE);
   CHECK(nhbm_parameter(model, "tones%frequensy", &handle, &error) == NHBM_INPUT && strstr(error.text, "did you mean 'frequency'?"));
   CHECK(nhbm_set_text(model, "tones%frequensy", "1.0", &error) == NHBM_INPUT && strstr(error.text, "did you mean 'frequency'?"));
   CHECK(nhbm_set_text(model, "law(1)%stifness", "1.0", &error) == NHBM_INPUT && strstr(error.text, "unknown key 'stifness'"));
   CHECK(nhbm_set_text(model, "solver%tolerence", "1.0", &error) == NHBM_INPUT && strstr(error.text, "'tolerance'"));
   CHECK(nhbm_solve(model, NHBM_COLD, &error) == NHBM_OK);
   CHECK(nhbm_parameter(model, "tones%frequency", &handle, &error) == NHBM_OK && handle == 1);
   CHECK(nhbm_set(model, 0, 1.0, &error) == NHBM_USE);
   CHECK(nhbm_set(model, 2, 1.0, &error) == NHBM_USE);
   CHECK(nhbm_set(model, 1, -1.0, &error) == NHBM_OK);
   CHECK(nhbm_solve(model, NHBM_COLD, &error) == NHBM_INPUT && strstr(error.text, "frequenc"));
   CHECK(nhbm_set_text(model, "tones%frequency(1", "1.0", &error) == NHBM_INPUT);
   CHECK(nhbm_set_text(model, "tones%frequency", "1.0", &error) == NHBM_OK);
   CHECK(nhbm_solve(model, NHBM_COLD, &error) == NHBM_OK);
   CHECK(nhbm_column_of(model, "coefficient", &found, &error) == NHBM_USE && found.kind == 2 && found.data == NULL);
   CHECK(strstr(error.text, "'coefficient'; known: ") && strstr(error.text, " coefficients "));
   CHECK(nhbm_verify(model, 5, &error) == NHBM_OK);
   CHECK(nhbm_time_column_of(model, "displacement", &found, &error) == NHBM_USE);
   CHECK(nhbm_integrate(model, &error) == NHBM_INPUT && strstr(error.text, "missing key 'duration'"));
   CHECK(nhbm_begin_curve(model, &error) == NHBM_INPUT && strstr(error.text, "curve"));
   nhbm_delete(&model);
   CHECK(model == NULL);
   nhbm_delete(&model);
   return 0;
}

int motion_step(void)
{
   nhbm_error error;
   nhbm_column found;
   nhbm_model *model = nhbm_new();
   int frequency, stiffness;

   CHECK(nhbm_read(model, oscillator, "oscillator", &error) == NHBM_OK);
   CHECK(nhbm_solve(model, NHBM_WARM, &error) == NHBM_OK);
   CHECK(status_of(model) == 1 && strcmp(nhbm_message(model), "") == 0);
   CHECK(cabs(first_harmonic(model) - answer(3.0, 0.9)) < 1e-12);
   CHECK(nhbm_column_of(model, "coefficients", &found, &error) == NHBM_OK);
   CHECK(found.kind == 0 && found.n_axes == 3 && found.shape[0] == 1 && found.shape[1] == 3 && found.shape[2] == 2);
   CHECK(strcmp(found.axes, "dof harmonic component") == 0 && strcmp(found.unit, "m") == 0);
   CHECK(nhbm_column_of(model, "frequency", &found, &error) == NHBM_OK && strcmp(found.unit, "rad/s") == 0);
   CHECK(NEAR(*(const double *)found.data, 0.9, 0.0));
   CHECK(strstr(nhbm_column_names(model), "status") && strstr(nhbm_column_names(model), " coefficients "));
   CHECK(strcmp(nhbm_labels(model, "dof"), "x1") == 0 && strcmp(nhbm_labels(model, "law"), "spring") == 0);
   CHECK(strcmp(nhbm_labels(model, "law_dof"), "x1") == 0 && strcmp(nhbm_labels(model, "state_dof"), "x1") == 0);
   CHECK(strcmp(nhbm_labels(model, "tone"), "") == 0);
   CHECK(nhbm_parameter(model, "tones%frequency", &frequency, &error) == NHBM_OK);
   CHECK(nhbm_parameter(model, "law(spring)%stiffness(1)", &stiffness, &error) == NHBM_OK);
   CHECK(nhbm_set(model, frequency, 1.7, &error) == NHBM_OK && nhbm_set(model, stiffness, 5.0, &error) == NHBM_OK);
   CHECK(nhbm_solve(model, NHBM_WARM, &error) == NHBM_OK && status_of(model) == 1);
   CHECK(cabs(first_harmonic(model) - answer(5.0, 1.7)) < 1e-12);
   CHECK(strstr(nhbm_input(model), "frequency = 1.7") && strstr(nhbm_input(model), "&solver"));
   CHECK(nhbm_set_text(model, "load(1)%cos", "0.6", &error) == NHBM_OK && nhbm_solve(model, NHBM_COLD, &error) == NHBM_OK);
   CHECK(cabs(first_harmonic(model) - 2.0*answer(5.0, 1.7)) < 1e-12);
   nhbm_delete(&model);
   return 0;
}

int curve_step(void)
{
   nhbm_error error;
   nhbm_column found;
   nhbm_model *model = nhbm_new();
   char text[1000];
   int is_point, n = 0;
   double last = 0.0;

   snprintf(text, sizeof text, "%s%s", oscillator,
            "&curve parameter = 'law(spring)%stiffness(1)', from = 1.0, to = 4.0, values = 2.5 /\n");
   CHECK(nhbm_read(model, text, "oscillator", &error) == NHBM_OK);
   CHECK(nhbm_next(model, &is_point, &error) == NHBM_OK && is_point == 0);
   CHECK(nhbm_begin_curve(model, &error) == NHBM_OK);
   for (;;) {
      CHECK(nhbm_next(model, &is_point, &error) == NHBM_OK);
      if (!is_point) break;
      CHECK(status_of(model) == 1);
      CHECK(nhbm_column_of(model, "law_spring_stiffness_1", &found, &error) == NHBM_OK);
      CHECK(*(const double *)found.data >= last);
      last = *(const double *)found.data;
      CHECK(cabs(first_harmonic(model) - answer(last, 0.9)) < 1e-9);
      ++n;
   }
   CHECK(n > 5 && NEAR(last, 4.0, 0.0));
   CHECK(nhbm_verify(model, 5, &error) == NHBM_USE); /* the motion is one of a curve */
   nhbm_delete(&model);
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
   nhbm_error error;
   nhbm_column times, found;
   nhbm_model *model = nhbm_new();
   char text[1000];
   double at[3], value[3];
   int64_t n;

   snprintf(text, sizeof text, "%s%s", oscillator, "&integration duration = 12.0, step = 0.25, tolerance = 1e-11, n_peaks = 1 /\n");
   CHECK(nhbm_read(model, text, "oscillator", &error) == NHBM_OK);
   CHECK(nhbm_integrate(model, &error) == NHBM_OK);
   CHECK(nhbm_time_column_of(model, "time", &times, &error) == NHBM_OK && times.n_axes == 1);
   n = times.shape[0];
   CHECK(n >= 48);
   for (int i = 0; i < 3; ++i) at[i] = ((const double *)times.data)[i*(n - 1)/2];
   CHECK(nhbm_time_column_of(model, "displacement", &found, &error) == NHBM_OK && strcmp(found.axes, "dof time") == 0);
   CHECK(found.n_axes == 2 && found.shape[0] == 1 && found.shape[1] == n && strcmp(found.unit, "m") == 0);
   for (int i = 0; i < 3; ++i) value[i] = ((const double *)found.data)[i*(n - 1)/2];
   for (int i = 0; i < 3; ++i) CHECK(NEAR(value[i], from_rest(at[i]), 1e-8));
   CHECK(nhbm_time_column_of(model, "force", &found, &error) == NHBM_OK && strcmp(found.axes, "law_coordinate time") == 0);
   for (int i = 0; i < 3; ++i) CHECK(NEAR(((const double *)found.data)[i*(n - 1)/2], 3.0*value[i], 1e-12));
   CHECK(nhbm_time_column_of(model, "state_displacement", &found, &error) == NHBM_OK);
   CHECK(NEAR(*(const double *)found.data, from_rest(12.0), 1e-8));
   CHECK(nhbm_time_column_of(model, "state_time", &found, &error) == NHBM_OK && NEAR(*(const double *)found.data, 12.0, 1e-9));
   CHECK(nhbm_time_column_of(model, "tuple", &found, &error) == NHBM_OK && found.kind == 1 && found.shape[0] == 3);
   CHECK(((const int32_t *)found.data)[0] == 0 && ((const int32_t *)found.data)[2] == 2);
   CHECK(nhbm_time_column_of(model, "coefficients", &found, &error) == NHBM_OK && found.n_axes == 3 && found.shape[2] == 2);
   CHECK(nhbm_time_column_of(model, "peak_frequency", &found, &error) == NHBM_OK && found.shape[1] == 1);
   CHECK(nhbm_time_column_of(model, "period", &found, &error) == NHBM_USE && strstr(error.text, "known: time displacement"));
   CHECK(strncmp(nhbm_time_column_names(model), "time displacement velocity force", 32) == 0);
   CHECK(strcmp(nhbm_labels(model, "law_coordinate"), "") != 0);
   nhbm_delete(&model);
   return 0;
}

/* Averages over whole periods of what has come to rest are the answer to the load. */
int verdict_step(void)
{
   nhbm_error error;
   nhbm_column found;
   nhbm_model *model = nhbm_new();
   char text[1000];

   snprintf(text, sizeof text, "%s%s", oscillator, "&integration transient = 250.0, duration = 70.0, tolerance = 1e-11 /\n");
   CHECK(nhbm_read(model, text, "oscillator", &error) == NHBM_OK);
   CHECK(nhbm_verify(model, 0, &error) == NHBM_USE && strstr(error.text, "no motion"));
   CHECK(nhbm_integrate(model, &error) == NHBM_OK);
   CHECK(nhbm_time_column_of(model, "coefficients", &found, &error) == NHBM_OK);
   CHECK(NEAR(((const double *)found.data)[2], creal(answer(3.0, 0.9)), 1e-7));
   CHECK(NEAR(((const double *)found.data)[3], -cimag(answer(3.0, 0.9)), 1e-7));
   CHECK(nhbm_solve(model, NHBM_COLD, &error) == NHBM_OK && nhbm_verify(model, 0, &error) == NHBM_OK);
   CHECK(nhbm_time_column_of(model, "integration_verdict", &found, &error) == NHBM_OK && found.kind == 1 && found.n_axes == 0);
   CHECK(*(const int32_t *)found.data == 1);
   CHECK(nhbm_time_column_of(model, "integration_difference", &found, &error) == NHBM_OK);
   CHECK(*(const double *)found.data < 1e-6);
   CHECK(nhbm_time_column_of(model, "integration_growth", &found, &error) == NHBM_OK && strcmp(found.unit, "1/s") == 0);
   nhbm_delete(&model);
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
      nhbm_structure_refuse(s, "only two_masses is known");
      return 1;
   }
   return nhbm_structure_dofs(s, "tip root", "mm rad", 50.0) || nhbm_structure_matrix(s, "mass", diagonal, at, mass) ||
          nhbm_structure_matrix(s, "stiffness", full, both, stiffness) ||
          nhbm_structure_matrix(s, "damping", full, both, damping) ||
          nhbm_structure_matrix(s, "structural", diagonal, at, loss) || nhbm_structure_vector(s, "push", 2, at, push) ||
          nhbm_structure_nodes(s, 2, node, "x y") || nhbm_structure_set(s, "ground", 1, last);
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
   nhbm_error error;
   nhbm_column found;
   nhbm_model *model = nhbm_new();
   const double *values;
   int n_calls = 0;

   nhbm_structures(model, two_masses, &n_calls);
   CHECK(nhbm_read(model, of_structure, "masses", &error) == NHBM_OK && n_calls == 1);
   CHECK(nhbm_solve(model, NHBM_COLD, &error) == NHBM_OK && status_of(model) == 1);
   CHECK(cabs(first_harmonic(model) - tip) < 1e-12);
   CHECK(nhbm_column_of(model, "coefficients", &found, &error) == NHBM_OK && found.shape[0] == 2);
   values = (const double *)found.data + 6;
   CHECK(cabs(values[0] - I*values[1] - root) < 1e-12);
   CHECK(strcmp(nhbm_labels(model, "dof"), "tip root") == 0 && strcmp(nhbm_labels(model, "law_dof"), "tip") == 0);
   nhbm_delete(&model);
   return 0;
}

/* Makes one mistake, the one of the number in the context. */
static int mistaken(void *context, const char *file, nhbm_structure *s)
{
   static const int32_t starts[] = {0, 1, 2}, at[] = {0, 1}, beyond[] = {0, 2}, node[] = {0, 1}, far_off[] = {0, 2};
   static const double mass[] = {1.0, 2.0};
   const int mistake = *(const int *)context;
   int code = nhbm_structure_dofs(s, "tip root", mistake == 0 ? "mm" : "", 0.0);

   (void)file;
   if (mistake == 1) code = nhbm_structure_matrix(s, "weight", starts, at, mass);
   if (mistake == 2) code = nhbm_structure_matrix(s, "mass", starts, beyond, mass);
   if (mistake == 3) code = nhbm_structure_nodes(s, 2, node, "x");
   if (mistake == 4) code = nhbm_structure_nodes(s, 2, far_off, "x y");
   if (mistake == 5) code = nhbm_structure_set(s, "ground", 1, at);
   if (mistake < 6) return code == NHBM_INPUT ? 1 : 99;
   if (mistake == 6) return nhbm_structure_matrix(s, "mass", starts, at, mass);
   return 7;
}

int wrong_structure_step(void)
{
   static const char *const words[] = {"1 units for 2 labels", "no matrix 'weight'", "matrix 'mass'", "1 directions for 2 degrees",
                                       "must be 0 to 1, or -1", "nhbm_structure_nodes comes before",
                                       "mass and stiffness must be given", "refused with 7"};
   nhbm_error error;

   for (int mistake = 0; mistake < 8; ++mistake) {
      nhbm_model *model = nhbm_new();
      nhbm_structures(model, mistaken, &mistake);
      CHECK(nhbm_read(model, of_structure, "masses", &error) == NHBM_INPUT);
      if (!strstr(error.text, words[mistake])) return 1000 + mistake;
      nhbm_delete(&model);
   }
   {
      nhbm_model *model = nhbm_new();
      int n_calls = 0;
      nhbm_structures(model, two_masses, &n_calls);
      CHECK(nhbm_read(model, "&structure type = 'model', file = 'three' /\n&tones frequency = 1.0 /\n", "m", &error) == NHBM_INPUT);
      CHECK(strstr(error.text, "only two_masses is known"));
      nhbm_delete(&model);
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
   nhbm_error error;
   nhbm_column found;
   nhbm_model *model = nhbm_new();
   char text[1000];
   int n_asked = 0;

   snprintf(text, sizeof text, "%s%s", oscillator, "&integration duration = 1e6 /\n");
   CHECK(nhbm_read(model, text, "oscillator", &error) == NHBM_OK);
   CHECK(nhbm_ask(model, at_once, &n_asked, &error) == NHBM_OK);
   CHECK(nhbm_integrate(model, &error) == NHBM_OK && n_asked == 1);
   CHECK(nhbm_time_column_of(model, "time", &found, &error) == NHBM_USE); /* it left no record */
   CHECK(nhbm_ask(model, NULL, NULL, &error) == NHBM_OK);
   CHECK(nhbm_solve(model, NHBM_COLD, &error) == NHBM_OK && status_of(model) == 1 && n_asked == 1);
   nhbm_delete(&model);
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
   nhbm_error error;
   nhbm_column found;
   nhbm_model *model = nhbm_new();
   nhbm_progress last = {-1.0, -1, 0}, solved = {-1.0, -1, 0};
   char text[1000];

   snprintf(text, sizeof text, "%s%s", oscillator, "&integration duration = 2e4, step = 0.5, tolerance = 1e-11 /\n");
   CHECK(nhbm_read(model, text, "oscillator", &error) == NHBM_OK);
   CHECK(nhbm_follow(model, note, &last, &error) == NHBM_OK && last.n_done == -1);
   CHECK(nhbm_integrate(model, &error) == NHBM_OK);
   CHECK(last.seconds > 0.0 && last.n_done > 0 && last.n_done <= last.n_steps);
   CHECK(nhbm_time_column_of(model, "time", &found, &error) == NHBM_OK && found.shape[0] > last.n_done);
   CHECK(nhbm_follow(model, note, &solved, &error) == NHBM_OK && nhbm_solve(model, NHBM_COLD, &error) == NHBM_OK);
   CHECK(solved.n_done == -1 && status_of(model) == 1);
   CHECK(nhbm_follow(model, NULL, NULL, &error) == NHBM_OK && nhbm_integrate(model, &error) == NHBM_OK && solved.n_done == -1);
   nhbm_delete(&model);
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

/* A law of the program takes the place of one of its name, and lives on in models that have it. */
int law_step(void)
{
   nhbm_error error;
   nhbm_model *model = nhbm_new(), *other = nhbm_new();
   nhbm_law_info_t info = {0};
   double stiffness[2] = {3.0, 5.0};
   char text[1000];

   snprintf(text, sizeof text, "%.*s&law type = 'user', library = '', name = 'mine', dof = 'x1' /\n",
            (int)(strstr(oscillator, "&law") - oscillator), oscillator);
   CHECK(nhbm_read(model, text, "oscillator", &error) == NHBM_INPUT && strstr(error.text, "no law 'mine'"));
   info.api_version = NHBM_USER_LAW_API;
   info.n_coordinates = 1;
   info.context = &stiffness[0];
   CHECK(nhbm_give_law("mine", &info, spring_evaluate) != 0);
   info.api_version = NHBM_USER_LAW_API_2;
   CHECK(nhbm_give_law("mine", &info, spring_evaluate) == 0);
   CHECK(nhbm_read(model, text, "oscillator", &error) == NHBM_OK && nhbm_solve(model, NHBM_COLD, &error) == NHBM_OK);
   CHECK(cabs(first_harmonic(model) - answer(3.0, 0.9)) < 1e-12);
   info.context = &stiffness[1];
   CHECK(nhbm_give_law("mine", &info, spring_evaluate) == 0);
   CHECK(nhbm_read(other, text, "oscillator", &error) == NHBM_OK && nhbm_solve(other, NHBM_COLD, &error) == NHBM_OK);
   CHECK(cabs(first_harmonic(other) - answer(5.0, 0.9)) < 1e-12);
   nhbm_forget_law("mine");
   nhbm_forget_law("mine");
   CHECK(nhbm_read(other, text, "oscillator", &error) == NHBM_INPUT);
   CHECK(nhbm_solve(model, NHBM_COLD, &error) == NHBM_OK && cabs(first_harmonic(model) - answer(3.0, 0.9)) < 1e-12);
   nhbm_delete(&model);
   nhbm_delete(&other);
   return 0;
}
