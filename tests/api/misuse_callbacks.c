/* Misuse of nhbm.h where a program gives functions: every function from inside each callback, wrong structures and laws, one model in
 * several threads. As misuse_steps.c. */
#include "misuse_steps.h"

#include <limits.h>
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>

int callbacks_step(void);
int structure_misuse_step(void);
int law_misuse_step(void);
int threads_step(void);
int late_thread_step(void);

static nhbm_column column;
static const char *text;

/* ---- Callbacks ---- */

typedef struct {
   nhbm_model *model;
   int n_calls;  /* of the callback */
   int wrong;    /* 1 + index of a function that was not refused, 100: another model did not work */
} inside_t;

/* Calls every function with the model that is computing, and uses another one. */
static void call_all(inside_t *self)
{
   nhbm_model *other;
   int i;

   if (self->n_calls++ > 0) return;
   i = first_other(self->model, NHBM_BUSY);
   if (i >= 0) self->wrong = 1 + i;
   if (!SAYS("callback")) self->wrong = 99;
   if (nhbm_create(&other) || !is_usable(other) || nhbm_destroy(&other)) self->wrong = 100;
}

static int call_all_in_interrupt(void *context)
{
   call_all(context);
   return 0;
}

static void call_all_in_progress(void *context, const nhbm_progress *done)
{
   (void)done;
   call_all(context);
}

static int call_all_in_law(const nhbm_law_samples_t *s)
{
   nhbm_law_info_t info = valid_info();

   call_all(s->context);
   if (nhbm_register_law("other", &info, cubic) || nhbm_unregister_law("other")) return -1; /* other laws may change */
   return cubic(s);
}

static const int32_t one_row[] = {0, 1}, only[] = {0};
static const double one[] = {1.0};

static int describe(nhbm_structure *s)
{
   return nhbm_structure_set_dofs(s, " x1  ", " ", 0.0) || /* blanks make no labels */
          nhbm_structure_set_matrix(s, "mass", 1, 1, one_row, only, one) ||
          nhbm_structure_set_matrix(s, "stiffness", 1, 1, one_row, only, one);
}

static int call_all_in_structure(void *context, const char *file, nhbm_structure *s)
{
   (void)file;
   call_all(context);
   return describe(s);
}

static const char *const of_structure =
   "&structure type = 'model', file = 'own', damping_mass = 0.1 /\n&tones frequency = 0.9 /\n&harmonics order = 3 /\n"
   "&load dof = 'x1', tuple = 1, cos = 0.3 /\n&law type = 'cubic_spring', dof = 'x1', stiffness = 0.5 /\n";

static const char *const of_law =
   "&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, damping_mass = 0.1,\n"
   " coupling_stiffness = 0.0, ground_stiffness = 1.0 /\n&tones frequency = 0.9 /\n&harmonics order = 3 /\n"
   "&load dof = 'x1', tuple = 1, cos = 0.3 /\n&law type = 'user', library = '', name = 'reentrant', dof = 'x1' /\n";

int callbacks_step(void)
{
   inside_t inside = {0};
   nhbm_law_info_t info = valid_info();

   for (int kind = 0; kind < 4; ++kind) {
      memset(&inside, 0, sizeof inside);
      CHECK(nhbm_create(&inside.model) == NHBM_SUCCESS);
      if (kind < 2) {
         CHECK(read_input(inside.model) == NHBM_SUCCESS &&
               set_number(inside.model, "integration%duration", 1e3) == NHBM_SUCCESS);
         if (kind == 0) CHECK(nhbm_set_interrupt_callback(inside.model, call_all_in_interrupt, &inside) == NHBM_SUCCESS);
         if (kind == 1) CHECK(nhbm_set_progress_callback(inside.model, call_all_in_progress, &inside) == NHBM_SUCCESS);
         CHECK(nhbm_integrate(inside.model) == NHBM_SUCCESS);
         CHECK(nhbm_set_interrupt_callback(inside.model, NULL, NULL) == NHBM_SUCCESS);
         CHECK(nhbm_set_progress_callback(inside.model, NULL, NULL) == NHBM_SUCCESS);
      } else if (kind == 2) {
         info.context = &inside;
         CHECK(nhbm_register_law("reentrant", &info, call_all_in_law) == NHBM_SUCCESS);
         CHECK(nhbm_read_input(inside.model, of_law, "law") == NHBM_SUCCESS);
         CHECK(nhbm_unregister_law("reentrant") == NHBM_SUCCESS); /* the model keeps the function */
         CHECK(nhbm_unregister_law("reentrant") == NHBM_INVALID_ARGUMENT && SAYS("reentrant"));
         CHECK(nhbm_solve(inside.model, NHBM_COLD_START) == NHBM_SUCCESS);
         CHECK(nhbm_get_column(inside.model, "status", &column) == NHBM_SUCCESS && *(const int32_t *)column.data == 1);
      } else {
         CHECK(nhbm_set_structure_callback(inside.model, call_all_in_structure, &inside) == NHBM_SUCCESS);
         CHECK(nhbm_read_input(inside.model, of_structure, "structure") == NHBM_SUCCESS);
         CHECK(nhbm_solve(inside.model, NHBM_COLD_START) == NHBM_SUCCESS);
      }
      if (inside.n_calls == 0 || inside.wrong != 0) return 10000 + 1000*kind + inside.wrong;
      CHECK(is_usable(inside.model) && nhbm_destroy(&inside.model) == NHBM_SUCCESS);
   }
   return 0;
}

/* ---- Structures and laws of the program ---- */

static nhbm_structure *stale;

/* Makes one mistake; returns 0, so that the error of the function alone can refuse the structure. */
static int mistaken(void *context, const char *file, nhbm_structure *s)
{
   static const int32_t starts[] = {0, 1, 2}, at[] = {0, 1}, low[] = {0, -5, 2}, high[] = {0, 9, 2}, late[] = {1, 1, 2},
         beyond[] = {0, 7};
   static const double unit[] = {1.0, 1.0};
   const double wrong[] = {1.0, NAN};
   int *status = context;
   const int mistake = *status;

   (void)file;
   stale = s;
   *status = NHBM_SUCCESS;
   if (mistake == 0) *status = nhbm_structure_set_matrix(s, "mass", 2, 2, starts, at, unit); /* before the degrees of freedom */
   if (mistake == 1) *status = nhbm_structure_add_load(s, "push", 2, at, unit);
   if (mistake == 2) *status = nhbm_structure_set_nodes(s, 2, 2, at, "x y");
   if (mistake == 3) *status = nhbm_structure_set_dofs(s, "", "", 0.0);
   if (mistake == 4) *status = nhbm_structure_set_dofs(s, NULL, "", 0.0);
   if (mistake == 5) *status = nhbm_structure_set_dofs(s, "a b", NULL, 0.0);
   if (mistake == 6) *status = nhbm_structure_set_dofs(s, "a b", "", NAN);
   if (mistake == 7) *status = nhbm_structure_set_dofs(s, "a b", "", -1.0);
   if (mistake == 8) *status = nhbm_structure_set_dofs(s, "a a_label_of_more_than_sixteen_characters", "", 0.0);
   if (mistake < 9) return 0;
   if (nhbm_structure_set_dofs(s, "a b", "", 0.0)) return 1;
   if (mistake == 9) *status = nhbm_structure_set_dofs(s, "a b c d", "", 0.0);
   if (mistake == 10) *status = nhbm_structure_set_matrix(s, NULL, 2, 2, starts, at, unit);
   if (mistake == 11) *status = nhbm_structure_set_matrix(s, "mass", 2, 2, NULL, at, unit);
   if (mistake == 12) *status = nhbm_structure_set_matrix(s, "mass", 2, 2, starts, NULL, unit);
   if (mistake == 13) *status = nhbm_structure_set_matrix(s, "mass", 2, 2, starts, at, NULL);
   if (mistake == 14) *status = nhbm_structure_set_matrix(s, "mass", 3, 2, starts, at, unit);
   if (mistake == 15) *status = nhbm_structure_set_matrix(s, "mass", 2, 1, starts, at, unit);
   if (mistake == 16) *status = nhbm_structure_set_matrix(s, "mass", SIZE_MAX, 2, starts, at, unit);
   if (mistake == 17) *status = nhbm_structure_set_matrix(s, "mass", 2, SIZE_MAX, starts, at, unit);
   if (mistake == 18) *status = nhbm_structure_set_matrix(s, "mass", 2, 2, low, at, unit);
   if (mistake == 19) *status = nhbm_structure_set_matrix(s, "mass", 2, 2, high, at, unit);
   if (mistake == 20) *status = nhbm_structure_set_matrix(s, "mass", 2, 2, late, at, unit);
   if (mistake == 21) *status = nhbm_structure_set_matrix(s, "mass", 2, 2, starts, beyond, unit);
   if (mistake == 22) *status = nhbm_structure_set_matrix(s, "mass", 2, 2, starts, at, wrong);
   if (mistake == 23) *status = nhbm_structure_set_matrix(s, "weight", 2, 2, starts, at, unit);
   if (mistake == 24) *status = nhbm_structure_add_load(s, NULL, 2, at, unit);
   if (mistake == 25) *status = nhbm_structure_add_load(s, "", 2, at, unit);
   if (mistake == 26) *status = nhbm_structure_add_load(s, "push", 2, NULL, unit);
   if (mistake == 27) *status = nhbm_structure_add_load(s, "push", 2, at, NULL);
   if (mistake == 28) *status = nhbm_structure_add_load(s, "push", SIZE_MAX, at, unit);
   if (mistake == 29) *status = nhbm_structure_add_load(s, "push", 2, beyond, unit);
   if (mistake == 30) *status = nhbm_structure_add_load(s, "push", 2, at, wrong);
   if (mistake == 31) *status = nhbm_structure_set_nodes(s, 2, 2, NULL, "x y");
   if (mistake == 32) *status = nhbm_structure_set_nodes(s, 2, 2, at, NULL);
   if (mistake == 33) *status = nhbm_structure_set_nodes(s, 2, 1, at, "x y");
   if (mistake == 34) *status = nhbm_structure_set_nodes(s, SIZE_MAX, 2, at, "x y");
   if (mistake == 35) *status = nhbm_structure_set_nodes(s, 2, 2, beyond, "x y");
   if (mistake == 36) *status = nhbm_structure_set_nodes(s, 2, 2, at, "x");
   if (mistake == 37) *status = nhbm_structure_add_node_set(s, "set", 2, at); /* before the nodes */
   if (mistake == 38) *status = nhbm_structure_set_error(s, NULL);
   if (mistake == 46) *status = nhbm_structure_set_coordinates(s, 2, unit); /* before the nodes */
   if (mistake < 39 || mistake == 46) return 0;
   if (nhbm_structure_set_nodes(s, 2, 2, at, "x y")) return 1;
   if (mistake == 39) *status = nhbm_structure_set_nodes(s, 2, 2, at, "x y");
   if (mistake == 40) *status = nhbm_structure_add_node_set(s, NULL, 2, at);
   if (mistake == 41) *status = nhbm_structure_add_node_set(s, "set", 2, NULL);
   if (mistake == 42) *status = nhbm_structure_add_node_set(s, "set", SIZE_MAX, at);
   if (mistake == 43) *status = nhbm_structure_add_node_set(s, "set", 2, beyond);
   if (mistake == 44) *status = nhbm_structure_set_coordinates(s, 2, NULL);
   if (mistake == 45) *status = nhbm_structure_set_coordinates(s, 3, unit);
   return 0;
}
enum { n_mistakes = 47 };

/* Whether a message of one function is stored although a later one succeeds, and what happens without a mistake. */
static int refused(void *context, const char *file, nhbm_structure *s)
{
   (void)file;
   stale = s;
   if (*(int *)context == 0) return 77;
   if (*(int *)context == 1) return nhbm_structure_set_error(s, "no %s%n");
   return 0; /* describes nothing */
}

static int described(void *context, const char *file, nhbm_structure *s)
{
   (void)context;
   (void)file;
   stale = s;
   return describe(s);
}

int structure_misuse_step(void)
{
   int group;
   nhbm_model *model;
   int state;

   CHECK(nhbm_create(&model) == NHBM_SUCCESS);
   for (int mistake = 0; mistake < n_mistakes; ++mistake) {
      state = mistake;
      CHECK(nhbm_set_structure_callback(model, mistaken, &state) == NHBM_SUCCESS);
      CHECK(nhbm_read_input(model, of_structure, "structure") == NHBM_INVALID_INPUT);
      if (state != NHBM_INVALID_ARGUMENT || !SAYS("structure 'own': ")) return 1000 + mistake;
      CHECK(nhbm_solve(model, NHBM_COLD_START) == NHBM_INVALID_STATE);
   }
   for (state = 0; state < 3; ++state) {
      static const char *const words[] = {"returned 77", "no %s%n", "must be given"};
      CHECK(nhbm_set_structure_callback(model, refused, &state) == NHBM_SUCCESS);
      CHECK(nhbm_read_input(model, of_structure, "structure") == NHBM_INVALID_INPUT && SAYS(words[state]));
   }
   CHECK(nhbm_set_structure_callback(model, NULL, NULL) == NHBM_SUCCESS);
   CHECK(nhbm_read_input(model, of_structure, "structure") == NHBM_INVALID_INPUT && SAYS("nhbm_set_structure_callback"));
   CHECK(nhbm_set_structure_callback(model, described, NULL) == NHBM_SUCCESS);
   CHECK(nhbm_read_input(model, of_structure, "structure") == NHBM_SUCCESS && nhbm_solve(model, NHBM_COLD_START) == NHBM_SUCCESS);
   CHECK(nhbm_structure_set_dofs(stale, "a", "", 0.0) == NHBM_INVALID_ARGUMENT && SAYS("no structure"));
   CHECK(nhbm_structure_set_matrix(stale, "mass", 1, 1, one_row, only, one) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_structure_add_load(stale, "push", 1, only, one) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_structure_set_nodes(stale, 1, 1, only, "x") == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_structure_add_node_set(stale, "set", 1, only) == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_structure_set_error(stale, "late") == NHBM_INVALID_ARGUMENT);
   CHECK(nhbm_set_structure_callback(model, NULL, NULL) == NHBM_SUCCESS); /* and the structure is read again */
   CHECK(nhbm_find_group(model, "structure%file", &group) == NHBM_SUCCESS && !nhbm_set_text(model, group, "file", "other"));
   CHECK(nhbm_solve(model, NHBM_COLD_START) == NHBM_INVALID_INPUT && SAYS("nhbm_set_structure_callback"));
   CHECK(is_usable(model) && nhbm_destroy(&model) == NHBM_SUCCESS);
   return 0;
}

int law_misuse_step(void)
{
   nhbm_law_info_t info;

   for (int i = 0; i < 13; ++i) {
      info = valid_info();
      if (i == 0) info.api_version = 99;
      if (i == 1) info.api_version = NHBM_USER_LAW_API;
      if (i == 2) info.n_coordinates = 0;
      if (i == 3) info.n_coordinates = INT_MIN;
      if (i == 4) info.n_parameters = -7;
      if (i == 5) info.degree = -1;
      if (i == 6) info.degree = INT_MAX;
      if (i == 7) info.length_scale = NAN;
      if (i == 8) info.length_scale = -1.0;
      if (i == 9) info.n_states = -1;
      if (i == 10) info.n_states = INT_MAX;
      if (i == 11) info.n_states = 3; /* without advance */
      if (i == 12) info.api_version = 0;
      if (nhbm_register_law("mistaken", &info, cubic) != NHBM_INVALID_ARGUMENT || !SAYS("law 'mistaken'")) return 1000 + i;
      CHECK(nhbm_unregister_law("mistaken") == NHBM_INVALID_ARGUMENT);
   }
   info = valid_info();
   info.n_coordinates = INT_MAX; /* more than any input has */
   CHECK(nhbm_register_law("many", &info, cubic) == NHBM_SUCCESS && nhbm_unregister_law("many") == NHBM_SUCCESS);
   return 0;
}

/* ---- Threads ---- */

typedef struct {
   pthread_mutex_t mutex;
   pthread_cond_t changed;
   bool is_computing, may_end;
} meeting_t;

/* Ends the computation when the other thread has made its calls. */
static int wait_for_other(void *context)
{
   meeting_t *self = context;

   (void)pthread_mutex_lock(&self->mutex);
   self->is_computing = true;
   (void)pthread_cond_broadcast(&self->changed);
   while (!self->may_end) (void)pthread_cond_wait(&self->changed, &self->mutex);
   (void)pthread_mutex_unlock(&self->mutex);
   return 1;
}

static void *integrate_in_thread(void *model)
{
   static int status;

   status = nhbm_integrate(model);
   return &status;
}

static void *solve_repeatedly(void *model)
{
   static int failed = 1;

   for (int i = 0; i < 20; ++i) {
      const int status = nhbm_solve(model, NHBM_COLD_START);
      if (status != NHBM_SUCCESS && status != NHBM_BUSY) return &failed;
   }
   return NULL;
}

int threads_step(void)
{
   meeting_t meeting = {PTHREAD_MUTEX_INITIALIZER, PTHREAD_COND_INITIALIZER, false, false};
   nhbm_model *model = solved(), *other;
   pthread_t threads[4];
   int first = -1;
   void *result;
   bool is_right;

   CHECK(model != NULL && set_number(model, "integration%duration", 1e6) == NHBM_SUCCESS);
   CHECK(nhbm_set_interrupt_callback(model, wait_for_other, &meeting) == NHBM_SUCCESS);
   CHECK(pthread_create(&threads[0], NULL, integrate_in_thread, model) == 0);
   (void)pthread_mutex_lock(&meeting.mutex);
   while (!meeting.is_computing) (void)pthread_cond_wait(&meeting.changed, &meeting.mutex);
   (void)pthread_mutex_unlock(&meeting.mutex);
   first = first_other(model, NHBM_BUSY);
   is_right = SAYS("another thread") && nhbm_create(&other) == NHBM_SUCCESS && is_usable(other) &&
         nhbm_destroy(&other) == NHBM_SUCCESS;
   (void)pthread_mutex_lock(&meeting.mutex);
   meeting.may_end = true;
   (void)pthread_cond_broadcast(&meeting.changed);
   (void)pthread_mutex_unlock(&meeting.mutex);
   (void)pthread_join(threads[0], &result);
   CHECK(first == -1 && is_right && *(int *)result == NHBM_SUCCESS);
   CHECK(nhbm_set_interrupt_callback(model, NULL, NULL) == NHBM_SUCCESS && read_input(model) == NHBM_SUCCESS);
   for (int i = 0; i < 4; ++i) CHECK(pthread_create(&threads[i], NULL, solve_repeatedly, model) == 0);
   is_right = true;
   for (int i = 0; i < 4; ++i) {
      (void)pthread_join(threads[i], &result);
      is_right = is_right && result == NULL;
   }
   CHECK(is_right && is_usable(model) && nhbm_destroy(&model) == NHBM_SUCCESS);
   return 0;
}

/* ---- A thread that goes on with a structure after the callback has returned ---- */

enum { n_late = 100, n_repeats = 8 };

typedef struct {
   char labels[8*n_late];
   int32_t starts[n_late + 1], columns[n_late];
   double values[n_late];
   nhbm_structure *structure;
   pthread_t thread;
   atomic_bool has_begun;
} late_t;

static int set_late_matrix(late_t *self, const char *name)
{
   return nhbm_structure_set_matrix(self->structure, name, n_late, n_late, self->starts, self->columns, self->values);
}

static void *set_until_refused(void *context)
{
   late_t *self = context;

   while (set_late_matrix(self, "damping") == NHBM_SUCCESS) atomic_store(&self->has_begun, true);
   return NULL;
}

static int describe_in_thread(void *context, const char *file, nhbm_structure *s)
{
   late_t *self = context;

   (void)file;
   self->structure = s;
   if (nhbm_structure_set_dofs(s, self->labels, "", 0.0)) return 1;
   if (set_late_matrix(self, "mass") || set_late_matrix(self, "stiffness")) return 2;
   atomic_store(&self->has_begun, false);
   if (pthread_create(&self->thread, NULL, set_until_refused, self)) return 3;
   while (!atomic_load(&self->has_begun)) {}
   return 0;
}

int late_thread_step(void)
{
   static late_t late;
   nhbm_model *model;
   char *end = late.labels;

   for (int i = 0; i < n_late; ++i) {
      end += sprintf(end, "x%d ", i);
      late.starts[i + 1] = i + 1;
      late.columns[i] = i;
      late.values[i] = 1.0;
   }
   CHECK(nhbm_create(&model) == NHBM_SUCCESS);
   CHECK(nhbm_set_structure_callback(model, describe_in_thread, &late) == NHBM_SUCCESS);
   for (int i = 0; i < n_repeats; ++i) {
      const int status = nhbm_read_input(model, "&structure type = 'model', file = 'own' /\n&tones frequency = 0.9 /\n"
                                         "&harmonics order = 1 /\n&load dof = 'x1', tuple = 1, cos = 1.0 /\n", "structure");
      (void)pthread_join(late.thread, NULL);
      CHECK(status == NHBM_SUCCESS || (status == NHBM_INVALID_INPUT && SAYS("in use")));
   }
   CHECK(is_usable(model) && nhbm_destroy(&model) == NHBM_SUCCESS);
   return 0;
}
