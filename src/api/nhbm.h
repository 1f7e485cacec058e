/* nhbm in other programs: vibrations of structures with contact, friction and other nonlinear laws under several tones at once.
 *
 * The order of use:
 *
 *    nhbm_error error;
 *    nhbm_model *model;
 *    int frequency;
 *    model = nhbm_new();
 *    if (nhbm_read(model, text, "my model", &error)) complain(error.text);
 *    nhbm_parameter(model, "tones%frequency", &frequency, &error);
 *    for (i = 0; i < n; ++i) {
 *       nhbm_set(model, frequency, values[i], &error);
 *       if (nhbm_solve(model, NHBM_WARM, &error)) complain(error.text);
 *       nhbm_column_of(model, "coefficients", &column, &error);
 *    }
 *    nhbm_delete(&model);
 *
 * Functions return 0, or the code of the error that they describe. Nothing here prints, ends the process, catches signals, or changes
 * the locale or the modes of floating-point arithmetic. A model belongs to one thread at a time; docs/user/library.md says
 * what is known of threads with a model each. Pointers to models and errors must not be null. Texts are UTF-8 and end with a zero.
 * MPI and HDF5 are not needed. */
#ifndef NHBM_H
#define NHBM_H

#include <stdint.h>

#include "nhbm_user_law.h"

#ifdef __cplusplus
extern "C" {
#endif

#define NHBM_API 2 /* grows by one where a program has to be compiled anew */

/* Version of the interface that the library was built with, to be compared with NHBM_API, and of the program, such as "0.1.0". */
int nhbm_api(void);
const char *nhbm_version(void);

/* The same as a number, 10000 major + 100 minor + patch. */
int nhbm_version_number(void);

/* Whether this library has something, 1 or 0: "cvode", the default method of nhbm_integrate, which it may be built without; a group of the
 * input, such as "gradient", or one of its types, such as "law jenkins". */
int nhbm_has(const char *feature);

/* Row i, from 0, of the table of input keys: group | key | type | unit | default | range | meaning. Not 0 while there is one;
 * 1200 bytes hold the longest. */
int nhbm_key(int i, char *row, int size);

enum nhbm_code {
   NHBM_OK = 0,
   NHBM_INPUT = 1,   /* the model, a path or a value is wrong; the text names group, key and the right value */
   NHBM_USE = 2      /* the function cannot be called here, or not so */
};

typedef struct nhbm_error {
   int code;         /* enum nhbm_code */
   char text[2048];  /* what is wrong and what helps, without a new line at its end; longer ones are cut off */
} nhbm_error;

typedef struct nhbm_model nhbm_model;

/* A model without an input, to be freed by nhbm_delete. */
nhbm_model *nhbm_new(void);

/* Takes the text of an input (docs/user/input.md), in the place of the one before, whose parameters are gone; `name` stands in
 * messages. What &sweep says is left out. */
int nhbm_read(nhbm_model *model, const char *text, const char *name, nhbm_error *error);

/* Says who gives the structures that inputs name by &structure type = 'model', file = '...': fill(context, file, structure) describes
 * one by the functions below and returns 0. To be called before nhbm_read; null: there are none. */
typedef struct nhbm_structure nhbm_structure;
void nhbm_structures(nhbm_model *model, int (*fill)(void *context, const char *file, nhbm_structure *structure), void *context);

/* Names of its degrees of freedom and their units, with blanks between (no units: all m), and up to which frequency it holds
 * [rad/s], 0: any. To be called first. These functions return 0, or something else where what they get is wrong; the model says why. */
int nhbm_structure_dofs(nhbm_structure *structure, const char *labels, const char *units, double up_to);

/* A matrix by compressed rows, from 0 on: row i has the entries starts[i] to starts[i + 1] - 1. Names: mass, stiffness, damping,
 * gyroscopic, structural (the imaginary part of the stiffness); gyroscopic_by_speed, stiffness_by_speed and
 * stiffness_by_speed_squared, what a speed adds, and the same with _2 at the end for a second speed. */
int nhbm_structure_matrix(nhbm_structure *structure, const char *name, const int32_t *starts, const int32_t *columns,
                          const double *values);

/* A named load vector by its entries, degrees of freedom from 0 on. */
int nhbm_structure_vector(nhbm_structure *structure, const char *name, int n, const int32_t *dofs, const double *values);

/* The node of each degree of freedom, from 0 on, -1: none, and its direction, with blanks between; then named sets of nodes. */
int nhbm_structure_nodes(nhbm_structure *structure, int n_nodes, const int32_t *nodes, const char *directions);
int nhbm_structure_set(nhbm_structure *structure, const char *name, int n, const int32_t *nodes);

/* Says why there is no structure of that name. */
void nhbm_structure_refuse(nhbm_structure *structure, const char *text);

/* Gives a law to all models of this process, in the place of one of the same name: &law type = 'user', library = '', name = NAME
 * evaluates it as nhbm_user_law.h says. Returns 0, or something else where info->api_version is not NHBM_USER_LAW_API_2 or memory is
 * short. It must live as long as there are models with it. */
int nhbm_give_law(const char *name, const nhbm_law_info_t *info, nhbm_law_evaluate_2_function evaluate);
void nhbm_forget_law(const char *name);

/* Frees a model and sets the pointer to null; a null pointer is left alone. */
void nhbm_delete(nhbm_model **model);

/* The input with all keys that may be given and their values. The text lives until the next call with this model. */
const char *nhbm_input(nhbm_model *model);

/* Sets the values of a key as the command's --set does: path "law(stop)%gap", values "1e-3". */
int nhbm_set_text(nhbm_model *model, const char *path, const char *values, nhbm_error *error);

/* Looks a number up once, such as "tones%frequency(1)" or "law(stop)%gap"; `handle` is what nhbm_set takes. */
int nhbm_parameter(nhbm_model *model, const char *path, int *handle, nhbm_error *error);

/* Sets that number, in the unit of the input. What is wrong with it is reported by the next solution. */
int nhbm_set(nhbm_model *model, int handle, double value, nhbm_error *error);

enum nhbm_start {
   NHBM_COLD = 0,    /* from where the input says */
   NHBM_WARM = 1     /* from the motion found last, where there is one */
};

/* Finds the motion of the model with its present values. Returns an error for a model that cannot be solved; a motion that was not
 * found is none: column "status" tells, 1 where it has converged (docs/user/schema.md), and nhbm_message why. */
int nhbm_solve(nhbm_model *model, int start, nhbm_error *error);

/* Says how many solutions belong together, 1 if it is not called: where &stability method = 'auto' finds stability too costly for a point,
 * two seconds are shared by all of them, as in a run of the command. 0: there are none to share. A curve counts its own points. */
void nhbm_points(nhbm_model *model, int n);

/* Begins the curve of the group &curve, then gives its points one by one as the result: *is_point is 0 behind the last one. */
int nhbm_begin_curve(nhbm_model *model, nhbm_error *error);
int nhbm_next(nhbm_model *model, int *is_point, nhbm_error *error);

/* What is known of the motion found last, by the names of the result file (docs/user/schema.md). */
enum { NHBM_MOST_AXES = 4 };
typedef struct nhbm_column {
   const void *data;                /* double or int32_t by `kind`, the last axis fastest; until the next call with this model */
   int kind;                        /* 0: double, 1: int32_t, 2: nothing is known, data is null */
   int n_axes;
   int64_t shape[NHBM_MOST_AXES];
   const char *unit;
   const char *axes;                /* names of the axes with blanks between: "dof harmonic component" */
} nhbm_column;
int nhbm_column_of(nhbm_model *model, const char *name, nhbm_column *column, nhbm_error *error);

/* Names of all columns, with blanks between. */
const char *nhbm_column_names(nhbm_model *model);

/* Integrates the model through time as the group &integration says, which must give the duration. nhbm_time_column_of then has the record by the
 * names of the file that `nhbm integrate` writes (docs/user/schema.md). */
int nhbm_integrate(nhbm_model *model, nhbm_error *error);

/* Integrates from the motion that nhbm_solve has found last, and from beside it, until it is clear whether it stays there, over at most so
 * many periods of the slowest tone (0: as many as its decay takes). nhbm_time_column_of then has what `nhbm verify` writes:
 * integration_verdict, integration_difference, ... */
int nhbm_verify(nhbm_model *model, int n_periods, nhbm_error *error);

/* As nhbm_column_of and nhbm_column_names, of whichever of the two was called last. */
int nhbm_time_column_of(nhbm_model *model, const char *name, nhbm_column *column, nhbm_error *error);
const char *nhbm_time_column_names(nhbm_model *model);

/* Labels along the axes "dof", "law_dof", "law", "law_coordinate" and "state_dof" with blanks between; empty for other axes. */
const char *nhbm_labels(nhbm_model *model, const char *axis);

/* Why the motion found last was not found, or what to know of it; empty where there is nothing to say. */
const char *nhbm_message(nhbm_model *model);

/* Asks twenty times a second, while something is under way, whether it shall end: wants_end(context) other than 0. What is ended
 * has the status `interrupted`. Null: nobody is asked. */
int nhbm_ask(nhbm_model *model, int (*wants_end)(void *context), void *context, nhbm_error *error);

/* Reports twenty times a second, while something is under way, how far it is. Null: nobody is told. */
typedef struct nhbm_progress {
   double seconds;          /* since the call began */
   int64_t n_done, n_steps; /* steps of the record that is integrated; 0 where there is none */
} nhbm_progress;
int nhbm_follow(nhbm_model *model, void (*told)(void *context, const nhbm_progress *progress), void *context, nhbm_error *error);

#ifdef __cplusplus
}
#endif
#endif
