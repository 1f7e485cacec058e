/* Misuse of nhbm.h: every function with NULL, with a model that does not exist or has no input, out of range and out of order. Each
 * returns the documented status with a message, and the model remains usable. Each step gives the line of the first check that does
 * not hold, 0 if all do. Callbacks and threads: misuse_callbacks.c. tests/cases/test_programs.py checks that no function of the
 * header is missing here. */
#include "misuse_steps.h"

#include <limits.h>
#include <math.h>

int null_arguments_step(void);
int unknown_models_step(void);
int empty_model_step(void);
int order_step(void);
int range_step(void);
int invalid_values_step(void);
int reading_again_step(void);
int numbers_misuse_step(void);

static const char *const duffing =
   "&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0, ground_stiffness = 1.0,\n"
   " damping_mass = 0.1 /\n"
   "&tones frequency = 0.9 /\n"
   "&harmonics order = 3 /\n"
   "&load dof = 'x1', tuple = 1, cos = 0.3 /\n"
   "&law type = 'cubic_spring', label = 'spring', dof = 'x1', stiffness = 0.5 /\n"
   "&curve parameter = 'tones%frequency', from = 0.5, to = 0.6, points = 5 /\n"
   "&integration duration = 5.0 /\n";

static int interrupt(void *context)
{
   (void)context;
   return 0;
}

static void progress(void *context, const nhbm_progress *done)
{
   (void)context;
   (void)done;
}

static int no_structure(void *context, const char *file, nhbm_structure *structure)
{
   (void)context;
   (void)file;
   (void)structure;
   return 1;
}

int cubic(const nhbm_law_samples_t *s)
{
   for (int i = 0; i < s->n_samples; ++i) {
      s->f[i] = 0.5*s->z[i]*s->z[i]*s->z[i];
      if (s->df_dz) s->df_dz[i] = 1.5*s->z[i]*s->z[i];
   }
   return 0;
}

nhbm_law_info_t valid_info(void)
{
   nhbm_law_info_t info = {0};

   info.api_version = NHBM_USER_LAW_API_2;
   info.n_coordinates = 1;
   return info;
}

/* ---- All functions with a model, each with valid arguments ---- */

static int handle = 1;
static nhbm_column column;
static const char *text;
static int has_point;
static nhbm_column_description description;
static nhbm_table table;
static nhbm_table_column table_column;
static double reals_of_table[1000];
static int outcome[2];
static size_t n_frequencies;
static const double *frequencies;
static const int32_t first_tuple[] = {1};
static const double frequency[] = {0.9}, pair[] = {0.1, 0.0};
static const nhbm_motion motion = {1, 1, 1, frequency, first_tuple, pair, 1e-3, 1e-3, NULL, 1, 0};
static nhbm_sweep sweep;
static nhbm_census census;
static nhbm_census_motion census_motion;

int set_number(nhbm_model *m, const char *path, double value) {
   int group;
   const int status = nhbm_find_group(m, path, &group);
   return status ? status : nhbm_set_real(m, group, strchr(path, '%') + 1, value);
}
int read_input(nhbm_model *m) { return nhbm_read_input(m, duffing, "duffing"); }
static int get_input(nhbm_model *m) { return nhbm_get_input(m, &text); }
static int get_given_input(nhbm_model *m) { return nhbm_get_given_input(m, &text); }
static int get_libraries(nhbm_model *m) { return nhbm_get_libraries(m, &text); }
static const double two_reals[] = {1.0, 2.0};
static const int two_integers[] = {1, 2};
static const char *const type = "chain";

static int find_group(nhbm_model *m) { return nhbm_find_group(m, "tones%frequency", &handle); }
static int set_frequency(nhbm_model *m) { return set_number(m, "tones%frequency", 0.9); }
static int set_structure_callback(nhbm_model *m) { return nhbm_set_structure_callback(m, no_structure, NULL); }
static int set_interrupt_callback(nhbm_model *m) { return nhbm_set_interrupt_callback(m, interrupt, NULL); }
static int set_progress_callback(nhbm_model *m) { return nhbm_set_progress_callback(m, progress, NULL); }
static int solve(nhbm_model *m) { return nhbm_solve(m, NHBM_COLD_START); }
static int set_point_count(nhbm_model *m) { return nhbm_set_point_count(m, 1); }
static int set_verification_time(nhbm_model *m) { return nhbm_set_verification_time(m, 1.0); }
static int curve_begin(nhbm_model *m) { return nhbm_curve_begin(m); }
static int curve_lengthen(nhbm_model *m) { return nhbm_curve_lengthen(m, 1000); }
static int curve_next(nhbm_model *m) { return nhbm_curve_next(m, &has_point); }
static int sweep_begin(nhbm_model *m) { return nhbm_sweep_begin(m, &sweep); }
static int sweep_select(nhbm_model *m) { return nhbm_sweep_select(m, 0, 1); }
static int sweep_next(nhbm_model *m) { return nhbm_sweep_next(m, &has_point); }
static int sweep_number_branches(nhbm_model *m) {
   static int32_t statuses[3], tuples[3], branches[3];
   static double coefficients[6];
   return nhbm_sweep_number_branches(m, 2, 1, statuses, tuples, coefficients, branches);
}
static int integrate(nhbm_model *m) { return nhbm_integrate(m); }
static int verify(nhbm_model *m) { return nhbm_verify(m, 1); }
static int verify_motion(nhbm_model *m) { return nhbm_verify_motion(m, &motion, 1); }
static int take_census(nhbm_model *m) { return nhbm_take_census(m, 3, 1, 0.0, &census); }
static int select_census_motion(nhbm_model *m) { return nhbm_select_census_motion(m, 0, &census_motion); }
static int get_advice(nhbm_model *m) { return nhbm_get_advice(m, NHBM_ADVICE_ON_MODEL, &text); }
static int get_natural_frequencies(nhbm_model *m) { return nhbm_get_natural_frequencies(m, &n_frequencies, &frequencies); }
static int describe_column(nhbm_model *m) { return nhbm_describe_column(m, "coefficients", &description); }
static int describe_time_column(nhbm_model *m) { return nhbm_describe_time_column(m, "time", &description); }
static int get_advice_on_motion(nhbm_model *m) { return nhbm_get_advice(m, NHBM_ADVICE_ON_MOTION, &text); }
static int get_column(nhbm_model *m) { return nhbm_get_column(m, "coefficients", &column); }
static int get_column_names(nhbm_model *m) { return nhbm_get_column_names(m, &text); }
static int get_time_column(nhbm_model *m) { return nhbm_get_time_column(m, "time", &column); }
static int get_time_column_names(nhbm_model *m) { return nhbm_get_time_column_names(m, &text); }
static int clear_table(nhbm_model *m) { return nhbm_clear_table(m); }
static int add_row(nhbm_model *m) { return nhbm_add_row(m); }
static int get_table(nhbm_model *m) { return nhbm_get_table(m, &table); }
static int copy_columns(nhbm_model *m) { return nhbm_copy_columns(m, 0, 0, reals_of_table, sizeof reals_of_table); }
static int get_table_labels(nhbm_model *m) { return nhbm_get_table_labels(m, "dof", &text); }
static int get_outcome(nhbm_model *m) { return nhbm_get_outcome(m, &outcome[0], &outcome[1]); }
static int get_labels(nhbm_model *m) { return nhbm_get_labels(m, "dof", &text); }
static int get_message(nhbm_model *m) { return nhbm_get_message(m, &text); }
static int check(nhbm_model *m) { return nhbm_check(m); }
static int check_group(nhbm_model *m) { return nhbm_check_group(m, handle); }
static int clear(nhbm_model *m) { return nhbm_clear(m, ""); }
static int add_group(nhbm_model *m) {
   int group;
   const int status = nhbm_add_group(m, "law", &group);
   return status ? status : nhbm_remove_group(m, group);
}

/* Functions that need a group. */
static int set_text(nhbm_model *m) { return nhbm_set_text(m, 1, "type", "chain"); }
static int set_texts(nhbm_model *m) { return nhbm_set_texts(m, 1, "type", 1, &type); }
static int set_logicals(nhbm_model *m) { return nhbm_set_logicals(m, 1, "is_on", 1, two_integers); }
static int set_real(nhbm_model *m) { return nhbm_set_real(m, 1, "gap", 1.0); }
static int set_reals(nhbm_model *m) { return nhbm_set_reals(m, 1, "mass", 1, two_reals); }
static int set_integers(nhbm_model *m) { return nhbm_set_integers(m, 1, "order", 1, two_integers); }
static int remove_group(nhbm_model *m) { return nhbm_remove_group(m, 1); }
static int (*const functions_of_groups[])(nhbm_model *m) = {set_text, set_texts, set_logicals, set_real, set_reals, set_integers,
                                                            remove_group};
static int destroy(nhbm_model *m) { return nhbm_destroy(&m); }

static const struct {
   int (*call)(nhbm_model *model);
   bool needs_input;
} functions[] = {
   {get_input, true}, {find_group, true}, {check, true}, {check_group, true}, {set_structure_callback, false},
   {set_interrupt_callback, false}, {set_progress_callback, false}, {solve, true}, {set_point_count, false},
   {set_verification_time, false}, {curve_begin, true}, {curve_lengthen, true}, {curve_next, true}, {sweep_begin, true},
   {sweep_select, true}, {sweep_next, true}, {sweep_number_branches, true}, {integrate, true},
   {verify, true}, {get_column, true}, {get_column_names, true}, {get_time_column, true}, {get_time_column_names, true}, {get_labels, true}, {get_message, true},
   {add_row, true}, {get_outcome, true}, {clear_table, false}, {get_table, false},
   {copy_columns, false}, {get_table_labels, false}, {get_given_input, true}, {get_libraries, true},
   {verify_motion, true}, {take_census, true}, {select_census_motion, true}, {get_advice, true}, {get_natural_frequencies, true}, {describe_column, true},
   {describe_time_column, true}, {get_advice_on_motion, true}, {add_group, false}, {clear, false}, {read_input, false},
   {destroy, false},
};
enum { n_functions = sizeof functions/sizeof functions[0] };

int first_other(nhbm_model *model, int status)
{
   for (int i = 0; i < n_functions; ++i) {
      if (functions[i].call == destroy && model == NULL) continue;
      if (functions[i].call(model) != status || nhbm_get_last_error()[0] == '\0') return i;
   }
   for (size_t i = 0; i < sizeof functions_of_groups/sizeof functions_of_groups[0]; ++i)
      if (functions_of_groups[i](model) != status) return n_functions + (int)i;
   return -1;
}

nhbm_model *solved(void)
{
   nhbm_model *model;

   if (nhbm_create(&model)) return NULL;
   if (read_input(model) || find_group(model) || solve(model)) (void)nhbm_destroy(&model);
   return model;
}

bool is_usable(nhbm_model *model)
{
   nhbm_column found;
   double first[2];

   if (read_input(model) || solve(model) || nhbm_get_column(model, "coefficients", &found) || !found.data) return false;
   memcpy(first, (const double *)found.data + 2, sizeof first);
   model = solved();
   if (!model || nhbm_get_column(model, "coefficients", &found) || !found.data) return false;
   if (memcmp(first, (const double *)found.data + 2, sizeof first) != 0) return false;
   return nhbm_destroy(&model) == NHBM_SUCCESS;
}

/* ---- Groups ---- */

int numbers_misuse_step(void)
{
   nhbm_model *model = solved();
   const char *const no_text = NULL;
   int group;

   CHECK(nhbm_clear(model, NULL) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_clear"));
   CHECK(nhbm_clear(model, "") == NHBM_SUCCESS && nhbm_solve(model, NHBM_COLD_START) == NHBM_INVALID_STATE && SAYS("no groups"));
   CHECK(nhbm_set_real(model, 1, "mass", 1.0) == NHBM_INVALID_ARGUMENT && SAYS("no group"));
   CHECK(nhbm_add_group(model, NULL, &group) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_add_group"));
   CHECK(nhbm_add_group(model, "law", NULL) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_add_group"));
   CHECK(nhbm_add_group(model, "a group", &group) == NHBM_INVALID_ARGUMENT && group == 0 && SAYS("unknown group"));
   CHECK(nhbm_add_group(model, "lwa", &group) == NHBM_INVALID_ARGUMENT && SAYS("&lwa") && SAYS("&law"));
   CHECK(nhbm_add_group(model, "structure", &group) == NHBM_SUCCESS);
   CHECK(nhbm_set_text(model, group, "type", NULL) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_set_text"));
   CHECK(nhbm_set_text(model, group, NULL, "chain") == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_set_texts(model, group, "type", 1, NULL) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_set_texts"));
   CHECK(nhbm_set_texts(model, group, "type", 1, &no_text) == NHBM_INVALID_ARGUMENT && SAYS("NULL"));
   CHECK(nhbm_set_logicals(model, group, NULL, 1, two_integers) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_set_logicals"));
   CHECK(nhbm_set_real(model, group, "", 1.0) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_set_real"));
   CHECK(nhbm_set_reals(model, group, "mass", 1, NULL) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_set_reals"));
   CHECK(nhbm_set_reals(model, group, "mass(1)", 2, two_reals) == NHBM_INVALID_ARGUMENT && SAYS("one value"));
   CHECK(nhbm_set_reals(model, group, "mass", (size_t)-1, two_reals) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_set_integers(model, group, "n_masses", 1, NULL) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_set_integers"));
   CHECK(nhbm_set_text(model, group, "type", "chian") == NHBM_SUCCESS && nhbm_check(model) == NHBM_INVALID_INPUT);
   CHECK(SAYS("&structure") && SAYS("'chain'") && nhbm_check_group(model, group) == NHBM_INVALID_INPUT && SAYS("'chain'"));
   CHECK(nhbm_add_group(model, "structure", &group) == NHBM_SUCCESS && nhbm_check(model) == NHBM_INVALID_INPUT);
   CHECK(SAYS("&structure is given 2 times"));
   CHECK(is_usable(model) && nhbm_destroy(&model) == NHBM_SUCCESS);
   return 0;
}

/* ---- Arguments ---- */

int null_arguments_step(void)
{
   nhbm_model *model = solved();
   nhbm_law_info_t info = valid_info();
   char row[NHBM_KEY_ROW_SIZE];

   CHECK(model != NULL);
   CHECK(first_other(NULL, NHBM_INVALID_ARGUMENT) == -1);
   CHECK(SAYS("NULL"));
   CHECK(nhbm_create(NULL) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_create"));
   CHECK(nhbm_destroy(NULL) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_destroy"));
   {
      nhbm_model *none = NULL;
      CHECK(nhbm_destroy(&none) == NHBM_SUCCESS);
   }
   CHECK(nhbm_read_input(model, NULL, "name") == NHBM_INVALID_ARGUMENT && SAYS("nhbm_read_input"));
   CHECK(nhbm_read_input(model, duffing, NULL) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_get_input(model, NULL) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_get_input"));
   CHECK(nhbm_find_group(model, NULL, &handle) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_find_group"));
   CHECK(nhbm_find_group(model, "tones%frequency", NULL) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_find_group"));
   CHECK(nhbm_set_structure_callback(model, NULL, NULL) == NHBM_SUCCESS);
   CHECK(nhbm_set_interrupt_callback(model, NULL, NULL) == NHBM_SUCCESS);
   CHECK(nhbm_set_progress_callback(model, NULL, NULL) == NHBM_SUCCESS);
   CHECK(nhbm_curve_begin(model) == NHBM_SUCCESS && nhbm_curve_next(model, NULL) == NHBM_INVALID_ARGUMENT &&
         SAYS("nhbm_curve_next"));
   CHECK(nhbm_curve_next(model, &has_point) == NHBM_SUCCESS && has_point == 1);
   CHECK(nhbm_get_column(model, NULL, &column) == NHBM_INVALID_ARGUMENT && column.data == NULL && column.unit != NULL);
   CHECK(nhbm_get_column(model, "coefficients", NULL) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_get_column"));
   CHECK(nhbm_get_column_names(model, NULL) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_describe_column(model, NULL, &description) == NHBM_INVALID_ARGUMENT && strcmp(description.long_name, "") == 0);
   CHECK(nhbm_describe_column(model, "coefficients", NULL) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_describe_column"));
   CHECK(nhbm_get_advice(model, NHBM_ADVICE_ON_MODEL, NULL) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_get_advice"));
   CHECK(nhbm_get_advice(model, 9, &text) == NHBM_INVALID_ARGUMENT && SAYS("no such subject"));
   CHECK(nhbm_describe_advice(model, "no_advice", 0, NULL, "", &text) == NHBM_INVALID_ARGUMENT && SAYS("no_advice"));
   CHECK(nhbm_describe_advice(model, "no_load", 0, NULL, "", NULL) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_describe_advice"));
   CHECK(nhbm_get_natural_frequencies(model, &n_frequencies, &frequencies) == NHBM_SUCCESS && n_frequencies > 0 && frequencies);
   CHECK(nhbm_get_natural_frequencies(model, NULL, &frequencies) == NHBM_INVALID_ARGUMENT && !frequencies);
   CHECK(nhbm_get_natural_frequencies(model, &n_frequencies, NULL) == NHBM_INVALID_ARGUMENT && n_frequencies == 0);
   CHECK(nhbm_verify_motion(model, NULL, 1) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_verify_motion"));
   {
      nhbm_motion wrong = motion;
      wrong.coefficients = NULL;
      CHECK(nhbm_verify_motion(model, &wrong, 1) == NHBM_INVALID_ARGUMENT && SAYS("must not be NULL"));
      wrong = motion;
      wrong.n_harmonics = 0;
      CHECK(nhbm_verify_motion(model, &wrong, 1) == NHBM_INVALID_ARGUMENT && SAYS("at least 1"));
      wrong = motion;
      wrong.status = 2;
      CHECK(nhbm_verify_motion(model, &wrong, 1) == NHBM_INVALID_ARGUMENT && SAYS("status"));
      wrong = motion;
      wrong.n_dofs = (size_t)-1;
      CHECK(nhbm_verify_motion(model, &wrong, 1) == NHBM_INVALID_ARGUMENT);
      CHECK(nhbm_verify_motion(model, &motion, -1) == NHBM_INVALID_ARGUMENT);
   }
   CHECK(nhbm_get_labels(model, NULL, &text) == NHBM_INVALID_ARGUMENT && strcmp(text, "") == 0);
   CHECK(nhbm_get_labels(model, "dof", NULL) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_get_labels"));
   CHECK(nhbm_get_message(model, NULL) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_get_message"));
   CHECK(nhbm_integrate(model) == NHBM_SUCCESS);
   CHECK(nhbm_get_table(model, NULL) == NHBM_INVALID_ARGUMENT && nhbm_get_outcome(model, NULL, &outcome[1]) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_describe_table_column(model, 0, NULL) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_copy_columns(model, 0, 0, NULL, 0) == NHBM_INVALID_ARGUMENT && nhbm_get_row_message(model, 0, NULL) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_get_table_labels(model, "dof", NULL) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_get_time_column(model, NULL, &column) == NHBM_INVALID_ARGUMENT && column.kind == NHBM_NO_VALUES);
   CHECK(nhbm_get_time_column(model, "time", NULL) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_get_time_column"));
   CHECK(nhbm_get_time_column_names(model, NULL) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_register_law(NULL, &info, cubic) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_register_law"));
   CHECK(nhbm_register_law("law", NULL, cubic) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_register_law("law", &info, NULL) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_unregister_law(NULL) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_unregister_law"));
   CHECK(nhbm_get_key_row(0, NULL, sizeof row) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_get_key_row"));
   CHECK(nhbm_has_feature(NULL) == 0);
   CHECK(nhbm_structure_set_dofs(NULL, "a", "", 0.0) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_structure_set_dofs"));
   CHECK(nhbm_structure_set_matrix(NULL, "mass", 0, 0, NULL, NULL, NULL) == NHBM_INVALID_ARGUMENT &&
         SAYS("nhbm_structure_set_matrix"));
   CHECK(nhbm_structure_add_load(NULL, "load", 0, NULL, NULL) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_structure_add_load"));
   CHECK(nhbm_structure_set_nodes(NULL, 0, 0, NULL, "") == NHBM_INVALID_ARGUMENT && SAYS("nhbm_structure_set_nodes"));
   CHECK(nhbm_structure_set_coordinates(NULL, 0, NULL) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_structure_set_coordinates"));
   CHECK(nhbm_structure_add_node_set(NULL, "set", 0, NULL) == NHBM_INVALID_ARGUMENT && SAYS("nhbm_structure_add_node_set"));
   CHECK(nhbm_structure_set_error(NULL, "message") == NHBM_INVALID_ARGUMENT && SAYS("nhbm_structure_set_error"));
   for (int status = -7; status < 3; ++status) CHECK(strlen(nhbm_status_text(status)) > 5);
   CHECK(strcmp(nhbm_status_text(NHBM_BUSY), nhbm_status_text(INT_MIN)) != 0);
   CHECK(strcmp(nhbm_status_text(INT_MAX), nhbm_status_text(INT_MIN)) == 0);
   CHECK(is_usable(model) && nhbm_destroy(&model) == NHBM_SUCCESS);
   return 0;
}

/* A copy of the pointer to a destroyed model, the address of something else, and a model instead of a structure. */
int unknown_models_step(void)
{
   nhbm_model *model = solved(), *copy = model;
   long other[4] = {0};

   CHECK(model != NULL && nhbm_destroy(&model) == NHBM_SUCCESS && model == NULL);
   CHECK(nhbm_destroy(&model) == NHBM_SUCCESS);
   CHECK(first_other(copy, NHBM_INVALID_ARGUMENT) == -1 && SAYS("no model at this address"));
   CHECK(first_other((nhbm_model *)other, NHBM_INVALID_ARGUMENT) == -1);
   CHECK(nhbm_destroy(&copy) == NHBM_INVALID_ARGUMENT && copy != NULL);
   CHECK(nhbm_create(&model) == NHBM_SUCCESS);
   CHECK(nhbm_structure_set_dofs((nhbm_structure *)model, "a", "", 0.0) == NHBM_INVALID_ARGUMENT && SAYS("no structure"));
   CHECK(is_usable(model) && nhbm_destroy(&model) == NHBM_SUCCESS);
   return 0;
}

int empty_model_step(void)
{
   nhbm_model *model;

   for (int round = 0; round < 2; ++round) { /* new, and after an input that is wrong */
      CHECK(nhbm_create(&model) == NHBM_SUCCESS);
      if (round > 0) CHECK(nhbm_read_input(model, "&structure type = 'chian' /\n", "wrong") == NHBM_INVALID_INPUT);
      for (int i = 0; i < n_functions; ++i) {
         if (!functions[i].needs_input) continue;
         if (functions[i].call(model) != NHBM_INVALID_STATE || !SAYS("no groups")) return 1000*round + i + 1;
      }
      for (int i = 0; i < n_functions; ++i) {
         if (functions[i].needs_input || functions[i].call == destroy) continue;
         if (functions[i].call(model) != NHBM_SUCCESS) return 1000*round + 100 + i;
      }
      CHECK(is_usable(model));
      CHECK(nhbm_read_input(model, "", "empty") == NHBM_INVALID_INPUT && nhbm_solve(model, NHBM_WARM_START) == NHBM_INVALID_STATE);
      CHECK(nhbm_destroy(&model) == NHBM_SUCCESS);
   }
   return 0;
}

int order_step(void)
{
   nhbm_model *model;
   int group, n = 0;

   CHECK(nhbm_create(&model) == NHBM_SUCCESS && read_input(model) == NHBM_SUCCESS);
   CHECK(nhbm_verify(model, 0) == NHBM_INVALID_STATE && SAYS("no motion"));
   CHECK(nhbm_verify(model, -1) == NHBM_INVALID_ARGUMENT && SAYS("max_periods"));
   CHECK(nhbm_curve_next(model, &has_point) == NHBM_INVALID_STATE && has_point == 0 && SAYS("nhbm_curve_begin"));
   CHECK(nhbm_get_time_column(model, "time", &column) == NHBM_INVALID_STATE && column.data == NULL && SAYS("nhbm_integrate"));
   CHECK(nhbm_get_time_column_names(model, &text) == NHBM_INVALID_STATE && strcmp(text, "") == 0);
   CHECK(nhbm_get_column(model, "coefficients", &column) == NHBM_SUCCESS && column.kind == NHBM_NO_VALUES && column.n_values == 0);
   CHECK(nhbm_get_message(model, &text) == NHBM_SUCCESS && strcmp(text, "") == 0);
   CHECK(nhbm_get_labels(model, "dof", &text) == NHBM_SUCCESS && strcmp(text, "x1") == 0);
   CHECK(nhbm_solve(model, NHBM_WARM_START) == NHBM_SUCCESS && nhbm_verify(model, 0) == NHBM_SUCCESS);
   CHECK(nhbm_get_column(model, "coefficients", &column) == NHBM_SUCCESS && column.n_values == 8 && column.shape[3] == 0);
   CHECK(nhbm_get_table(model, &table) == NHBM_SUCCESS && table.n_rows == 0 && table.n_columns == 0);
   CHECK(nhbm_describe_table_column(model, 0, &table_column) == NHBM_INVALID_ARGUMENT && strcmp(table_column.name, "") == 0);
   CHECK(nhbm_get_row_message(model, 0, &text) == NHBM_INVALID_ARGUMENT && SAYS("no row"));
   CHECK(nhbm_add_row(model) == NHBM_SUCCESS && nhbm_get_table(model, &table) == NHBM_SUCCESS && table.n_rows == 1);
   CHECK(nhbm_describe_table_column(model, 0, &table_column) == NHBM_SUCCESS && strcmp(table_column.name, "status") == 0);
   CHECK(nhbm_describe_table_column(model, table.n_columns, &table_column) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_copy_columns(model, 0, 1, reals_of_table, 8) == NHBM_SUCCESS && *(const int32_t *)(const void *)reals_of_table == 1);
   CHECK(nhbm_copy_columns(model, 0, 2, reals_of_table, 8) == NHBM_INVALID_ARGUMENT && SAYS("size"));
   CHECK(nhbm_copy_columns(model, 1, table.n_columns, reals_of_table, sizeof reals_of_table) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_copy_columns(model, (size_t)-1, 1, reals_of_table, sizeof reals_of_table) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_get_row_message(model, 0, &text) == NHBM_SUCCESS && nhbm_get_row_message(model, 1, &text) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_get_table_labels(model, "dof", &text) == NHBM_SUCCESS && strcmp(text, "x1") == 0);
   CHECK(nhbm_get_outcome(model, &outcome[0], &outcome[1]) == NHBM_SUCCESS && outcome[0] == 1);
   CHECK(!nhbm_find_group(model, "harmonics%order", &group) && !nhbm_set_integers(model, group, "order", 1, (const int[]){9}));
   CHECK(nhbm_verify(model, 0) == NHBM_INVALID_STATE && SAYS("changed"));
   CHECK(nhbm_get_input(model, &text) == NHBM_SUCCESS && strstr(text, "order = 9"));
   CHECK(nhbm_get_column(model, "tuples", &column) == NHBM_SUCCESS && column.shape[0] == 4); /* of the motion, still */
   CHECK(nhbm_curve_begin(model) == NHBM_SUCCESS);
   do {
      CHECK(nhbm_curve_next(model, &has_point) == NHBM_SUCCESS);
      n += has_point;
   } while (has_point);
   CHECK(n > 1 && nhbm_curve_next(model, &has_point) == NHBM_SUCCESS && has_point == 0);
   CHECK(sweep_begin(model) == NHBM_INVALID_INPUT && SAYS("&curve") && sweep_next(model) == NHBM_INVALID_STATE);
   CHECK(!nhbm_find_group(model, "curve%points", &group) && !nhbm_set_integers(model, group, "points", 1, (const int[]){3}));
   CHECK(curve_lengthen(model) == NHBM_INVALID_STATE && SAYS("number of points"));
   CHECK(nhbm_curve_begin(model) == NHBM_SUCCESS);
   do CHECK(nhbm_curve_next(model, &has_point) == NHBM_SUCCESS);
   while (has_point);
   CHECK(nhbm_curve_lengthen(model, 3) == NHBM_INVALID_ARGUMENT && SAYS("has 3 points"));
   CHECK(nhbm_curve_lengthen(model, 10000000) == NHBM_INVALID_ARGUMENT && SAYS("points"));
   CHECK(nhbm_curve_lengthen(model, 5) == NHBM_SUCCESS && curve_lengthen(model) == NHBM_INVALID_STATE);
   CHECK(nhbm_get_input(model, &text) == NHBM_SUCCESS && strstr(text, "points = 5"));
   CHECK(nhbm_curve_next(model, &has_point) == NHBM_SUCCESS && has_point == 1);
   CHECK(nhbm_curve_next(model, &has_point) == NHBM_SUCCESS && has_point == 1);
   CHECK(nhbm_curve_next(model, &has_point) == NHBM_SUCCESS && has_point == 0);
   CHECK(nhbm_verify(model, 0) == NHBM_INVALID_STATE);
   for (int i = 0; i < 4; ++i) { /* what ends a curve */
      CHECK(nhbm_curve_begin(model) == NHBM_SUCCESS && nhbm_curve_next(model, &has_point) == NHBM_SUCCESS && has_point == 1);
      CHECK((i == 0 ? set_frequency : i == 1 ? solve : i == 2 ? integrate : read_input)(model) == NHBM_SUCCESS);
      CHECK(nhbm_curve_next(model, &has_point) == NHBM_INVALID_STATE && has_point == 0);
   }
   CHECK(is_usable(model) && nhbm_destroy(&model) == NHBM_SUCCESS);
   return 0;
}

int range_step(void)
{
   static const int wrong[] = {INT_MIN, -1, 0, 2, 100, INT_MAX};
   nhbm_model *model = solved();
   const size_t length = 100000;
   char row[NHBM_KEY_ROW_SIZE], *long_text = malloc(length + 1);
   nhbm_law_info_t info = valid_info();

   CHECK(model != NULL && long_text != NULL);
   for (size_t i = 0; i < sizeof wrong/sizeof wrong[0]; ++i) {
      if (wrong[i] != 2) CHECK(nhbm_set_real(model, wrong[i], "frequency", 1.0) == NHBM_INVALID_ARGUMENT && SAYS("handle"));
      if (wrong[i] != 0) CHECK(nhbm_solve(model, wrong[i]) == NHBM_INVALID_ARGUMENT && SAYS("NHBM_WARM_START"));
   }
   CHECK(nhbm_verify(model, -5) == NHBM_INVALID_ARGUMENT && SAYS("-5"));
   CHECK(nhbm_verify(model, INT_MIN) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_verify(model, INT_MAX) == NHBM_SUCCESS);
   CHECK(nhbm_select_census_motion(model, 0, &census_motion) == NHBM_INVALID_STATE && SAYS("nhbm_take_census"));
   CHECK(nhbm_take_census(model, -1, 1, 0.0, &census) == NHBM_INVALID_ARGUMENT && SAYS("negative"));
   CHECK(nhbm_take_census(model, 3, 1, NAN, &census) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_take_census(model, 3, 1, 0.0, NULL) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_take_census(model, 3, 1, 0.0, &census) == NHBM_SUCCESS && census.n_motions >= 1);
   CHECK(nhbm_select_census_motion(model, census.n_motions, &census_motion) == NHBM_INVALID_ARGUMENT && SAYS("index"));
   CHECK(nhbm_select_census_motion(model, 0, NULL) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_select_census_motion(model, 0, &census_motion) == NHBM_SUCCESS && census_motion.start != 0);
   CHECK(nhbm_set_point_count(model, SIZE_MAX) == NHBM_INVALID_ARGUMENT && nhbm_set_point_count(model, INT_MAX) == NHBM_SUCCESS);
   CHECK(nhbm_solve(model, NHBM_COLD_START) == NHBM_SUCCESS && nhbm_set_point_count(model, 0) == NHBM_SUCCESS);
   CHECK(nhbm_set_verification_time(model, -1.0) == NHBM_INVALID_ARGUMENT && SAYS("positive"));
   CHECK(nhbm_set_verification_time(model, NAN) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_set_verification_time(model, 0.0) == NHBM_SUCCESS);
   CHECK(nhbm_get_key_row(nhbm_get_key_count(), row, sizeof row) == NHBM_INVALID_ARGUMENT && row[0] == '\0');
   CHECK(nhbm_get_key_row(SIZE_MAX, row, sizeof row) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_get_key_row(0, row, 0) == NHBM_INVALID_ARGUMENT && nhbm_get_key_row(0, row, 1) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_get_key_row(0, row, SIZE_MAX) == NHBM_SUCCESS);
   memset(long_text, 'a', length);
   long_text[length] = '\0';
   CHECK(nhbm_find_group(model, long_text, &handle) == NHBM_INVALID_INPUT && strlen(nhbm_get_last_error()) < 8192);
   CHECK(find_group(model) == NHBM_SUCCESS && nhbm_set_real(model, handle, long_text, 1.0) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_add_group(model, long_text, &handle) == NHBM_INVALID_ARGUMENT && strlen(nhbm_get_last_error()) < 8192);
   CHECK(find_group(model) == NHBM_SUCCESS && nhbm_set_text(model, handle, "frequency", long_text) == NHBM_SUCCESS);
   CHECK(nhbm_solve(model, NHBM_COLD_START) == NHBM_INVALID_INPUT && strlen(nhbm_get_last_error()) < 8192);
   CHECK(set_frequency(model) == NHBM_SUCCESS && solve(model) == NHBM_SUCCESS);
   CHECK(nhbm_get_column(model, long_text, &column) == NHBM_INVALID_ARGUMENT &&
         nhbm_get_column(model, "", &column) != NHBM_SUCCESS);
   CHECK(nhbm_get_column(model, "\xff\xfe", &column) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_get_labels(model, long_text, &text) == NHBM_SUCCESS && strcmp(text, "") == 0);
   CHECK(nhbm_has_feature(long_text) == 0);
   for (int i = 0; i < 3; ++i) {
      memset(long_text, i == 0 ? '&' : i == 1 ? '\'' : '\n', length);
      CHECK(nhbm_read_input(model, long_text, long_text) == NHBM_INVALID_INPUT);
   }
   CHECK(nhbm_register_law("", &info, cubic) == NHBM_INVALID_ARGUMENT);
   free(long_text);
   CHECK(is_usable(model) && nhbm_destroy(&model) == NHBM_SUCCESS);
   return 0;
}

/* Values that the input does not permit: computations report them, results wait for valid ones. */
int invalid_values_step(void)
{
   const double values[] = {-1.0, -1.0, INFINITY, -INFINITY, NAN};
   nhbm_model *model = solved();
   int tones, chain;

   CHECK(model != NULL);
   for (int i = 0; i < 5; ++i) {
      CHECK(nhbm_find_group(model, "tones%frequency", &tones) == NHBM_SUCCESS);
      CHECK(nhbm_find_group(model, "structure%mass", &chain) == NHBM_SUCCESS);
      CHECK(nhbm_set_real(model, i % 2 ? chain : tones, i % 2 ? "mass" : "frequency", values[i]) == NHBM_SUCCESS);
      CHECK(nhbm_solve(model, NHBM_WARM_START) == NHBM_INVALID_INPUT && nhbm_integrate(model) == NHBM_INVALID_INPUT);
      (void)nhbm_curve_begin(model); /* sets its own frequency */
      (void)nhbm_curve_next(model, &has_point);
      CHECK(nhbm_verify(model, 0) == NHBM_INVALID_STATE);
      CHECK(nhbm_solve(model, NHBM_COLD_START) == NHBM_INVALID_INPUT || i % 2 == 0);
      (void)nhbm_get_column(model, "coefficients", &column);
      (void)nhbm_get_column_names(model, &text);
      (void)nhbm_get_labels(model, "dof", &text);
      (void)nhbm_get_message(model, &text);
      CHECK(nhbm_get_input(model, &text) == NHBM_SUCCESS && strstr(text, "&tones"));
      CHECK(!nhbm_set_real(model, tones, "frequency", 0.9) && !nhbm_set_real(model, chain, "mass", 1.0));
      CHECK(nhbm_solve(model, NHBM_WARM_START) == NHBM_SUCCESS && nhbm_get_labels(model, "dof", &text) == NHBM_SUCCESS);
   }
   CHECK(!nhbm_set_real(model, tones, "frequency", -1.0) && nhbm_solve(model, NHBM_COLD_START) == NHBM_INVALID_INPUT);
   CHECK(nhbm_get_column(model, "status", &column) == NHBM_INVALID_STATE && SAYS("invalid"));
   CHECK(nhbm_get_column_names(model, &text) == NHBM_INVALID_STATE && nhbm_get_labels(model, "dof", &text) == NHBM_INVALID_STATE);
   CHECK(is_usable(model) && nhbm_destroy(&model) == NHBM_SUCCESS);
   return 0;
}

/* Another input: no result and no handle of the previous one remains. */
int reading_again_step(void)
{
   static const char *const two_tones =
      "&structure type = 'chain', n_masses = 3, ends = 'fixed', mass = 1.0, coupling_stiffness = 1.0, damping_mass = 0.1 /\n"
      "&tones frequency = 1.0, 1.7 /\n&harmonics order = 3 /\n&load dof = 'x1', tuple = 1, 0, cos = 0.3 /\n"
      "&law type = 'cubic_spring', label = 's', dof = 'x3', stiffness = 1.0 /\n";
   nhbm_model *model = solved();
   int first = handle;

   CHECK(model != NULL && integrate(model) == NHBM_SUCCESS && nhbm_curve_begin(model) == NHBM_SUCCESS);
   CHECK(nhbm_read_input(model, two_tones, "two tones") == NHBM_SUCCESS);
   CHECK(nhbm_set_real(model, first, "frequency", 1.0) == NHBM_INVALID_ARGUMENT && SAYS("handle"));
   CHECK(nhbm_get_column(model, "coefficients", &column) == NHBM_SUCCESS && column.kind == NHBM_NO_VALUES);
   CHECK(nhbm_get_time_column(model, "time", &column) == NHBM_INVALID_STATE && nhbm_verify(model, 1) == NHBM_INVALID_STATE);
   CHECK(nhbm_curve_next(model, &has_point) == NHBM_INVALID_STATE);
   CHECK(nhbm_curve_begin(model) == NHBM_INVALID_INPUT && nhbm_integrate(model) == NHBM_INVALID_INPUT);
   CHECK(nhbm_solve(model, NHBM_WARM_START) == NHBM_SUCCESS);
   CHECK(nhbm_get_labels(model, "dof", &text) == NHBM_SUCCESS && strcmp(text, "x1\nx2\nx3") == 0);
   CHECK(is_usable(model) && nhbm_destroy(&model) == NHBM_SUCCESS);
   return 0;
}
