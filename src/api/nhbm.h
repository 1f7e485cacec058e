/* nhbm in other programs: vibrations of structures with contact, friction and other nonlinear laws under several tones at once.
 *
 * Order of use:
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
 * Functions return 0, or an error code with a description in `error`. No function prints, ends the process, catches signals, or
 * changes the locale or the floating-point modes. A model may be used by one thread at a time; docs/user/library.md describes
 * the use of several threads with one model each. Pointers to models and errors must not be null. Texts are UTF-8 and
 * null-terminated. MPI and HDF5 are not required. */
#ifndef NHBM_H
#define NHBM_H

#include <stdint.h>

#include "nhbm_user_law.h"

#ifdef __cplusplus
extern "C" {
#endif

#define NHBM_API 2 /* increases by one when programs must be recompiled */

/* Return the version of the interface of the library, to be compared with NHBM_API, and that of the program, such as "0.1.0". */
int nhbm_api(void);
const char *nhbm_version(void);

/* Returns the version of the program as a number, 10000 major + 100 minor + patch. */
int nhbm_version_number(void);

/* Returns 1 if this library has a feature, 0 otherwise: "cvode", the default method of nhbm_integrate, which is optional in a build;
 * a group of the input, such as "gradient"; or a type of a group, such as "law jenkins". */
int nhbm_has(const char *feature);

/* Writes row i, counted from 0, of the table of input keys: group | key | type | unit | default | range | meaning. Returns nonzero
 * if the row exists; 1200 bytes are enough for any row. */
int nhbm_key(int i, char *row, int size);

enum nhbm_code {
   NHBM_OK = 0,
   NHBM_INPUT = 1,   /* the model, a path or a value is wrong; the text names group, key and the right value */
   NHBM_USE = 2      /* the function cannot be called at this point or with these arguments */
};

typedef struct nhbm_error {
   int code;         /* enum nhbm_code */
   char text[2048];  /* cause and remedy, without a newline at the end; truncated if longer */
} nhbm_error;

typedef struct nhbm_model nhbm_model;

/* Creates a model without an input, to be freed by nhbm_delete. */
nhbm_model *nhbm_new(void);

/* Reads the text of an input (docs/user/input.md). It replaces the previous input, whose parameter handles become invalid; messages
 * contain `name`. The group &sweep is ignored. */
int nhbm_read(nhbm_model *model, const char *text, const char *name, nhbm_error *error);

/* Registers the callback that supplies the structures to which inputs refer by &structure type = 'model', file = '...':
 * fill(context, file, structure) describes one by the functions below and returns 0. Call it before nhbm_read; null: no callback. */
typedef struct nhbm_structure nhbm_structure;
void nhbm_structures(nhbm_model *model, int (*fill)(void *context, const char *file, nhbm_structure *structure), void *context);

/* Sets the names of the degrees of freedom and their units, separated by blanks (no units: all m), and the highest frequency at
 * which the structure is valid [rad/s], 0: any. Call it first. These functions return 0, or nonzero if an argument is invalid;
 * nhbm_read then reports the cause. */
int nhbm_structure_dofs(nhbm_structure *structure, const char *labels, const char *units, double up_to);

/* Sets a matrix in compressed-row storage with indices from 0: row i has the entries starts[i] to starts[i + 1] - 1. Names: mass,
 * stiffness, damping, gyroscopic, structural (the imaginary part of the stiffness); gyroscopic_by_speed, stiffness_by_speed and
 * stiffness_by_speed_squared, the terms that depend on a speed, and the same with the suffix _2 for a second speed. */
int nhbm_structure_matrix(nhbm_structure *structure, const char *name, const int32_t *starts, const int32_t *columns,
                          const double *values);

/* Adds a named load vector with n entries; degrees of freedom are counted from 0. */
int nhbm_structure_vector(nhbm_structure *structure, const char *name, int n, const int32_t *dofs, const double *values);

/* Sets the node of each degree of freedom, counted from 0, -1: none, and its direction, separated by blanks. nhbm_structure_set adds
 * a named set of nodes. */
int nhbm_structure_nodes(nhbm_structure *structure, int n_nodes, const int32_t *nodes, const char *directions);
int nhbm_structure_set(nhbm_structure *structure, const char *name, int n, const int32_t *nodes);

/* Reports why there is no structure of that name. */
void nhbm_structure_refuse(nhbm_structure *structure, const char *text);

/* Registers a law for all models of this process, replacing one of the same name: &law type = 'user', library = '', name = NAME
 * evaluates it as described in nhbm_user_law.h. Returns 0, or nonzero if info->api_version is not NHBM_USER_LAW_API_2 or if memory is
 * insufficient. The law must exist as long as models use it. nhbm_forget_law removes it. */
int nhbm_give_law(const char *name, const nhbm_law_info_t *info, nhbm_law_evaluate_2_function evaluate);
void nhbm_forget_law(const char *name);

/* Frees a model and sets the pointer to null; no effect for a null pointer. */
void nhbm_delete(nhbm_model **model);

/* Returns the input with all permitted keys and their values. The text is valid until the next call with this model. */
const char *nhbm_input(nhbm_model *model);

/* Sets the values of a key, as the option --set of the command does: path "law(stop)%gap", values "1e-3". */
int nhbm_set_text(nhbm_model *model, const char *path, const char *values, nhbm_error *error);

/* Returns in `handle` a handle for nhbm_set of a number such as "tones%frequency(1)" or "law(stop)%gap". */
int nhbm_parameter(nhbm_model *model, const char *path, int *handle, nhbm_error *error);

/* Sets this number, in the unit of the input. An invalid value is reported by the next solution. */
int nhbm_set(nhbm_model *model, int handle, double value, nhbm_error *error);

enum nhbm_start {
   NHBM_COLD = 0,    /* from the start that the input specifies */
   NHBM_WARM = 1     /* from the last motion found, if there is one */
};

/* Computes the motion of the model with its present values. Returns an error if the model cannot be solved. A solution that does not
 * converge is not an error: column "status" is 1 if it has converged (docs/user/schema.md); otherwise nhbm_message gives the cause. */
int nhbm_solve(nhbm_model *model, int start, nhbm_error *error);

/* Sets the number of solutions that belong together, 1 if it is not called: if &stability method = 'auto' finds stability too
 * expensive for a point, the points share a budget of two seconds, as in a run of the command. 0: no budget. A curve counts its own
 * points. */
void nhbm_points(nhbm_model *model, int n);

/* nhbm_begin_curve begins the curve of the group &curve; each call of nhbm_next computes its next point as the result. *is_point is 0
 * after the last point. */
int nhbm_begin_curve(nhbm_model *model, nhbm_error *error);
int nhbm_next(nhbm_model *model, int *is_point, nhbm_error *error);

/* Returns a column of the last motion found, by its name in the result file (docs/user/schema.md). */
enum { NHBM_MOST_AXES = 4 };
typedef struct nhbm_column {
   const void *data;                /* double or int32_t by `kind`, the last axis fastest; valid until the next call with this model */
   int kind;                        /* 0: double, 1: int32_t, 2: not available, data is null */
   int n_axes;
   int64_t shape[NHBM_MOST_AXES];
   const char *unit;
   const char *axes;                /* names of the axes, separated by blanks: "dof harmonic component" */
} nhbm_column;
int nhbm_column_of(nhbm_model *model, const char *name, nhbm_column *column, nhbm_error *error);

/* Returns the names of all columns, separated by blanks. */
const char *nhbm_column_names(nhbm_model *model);

/* Integrates the model in time according to the group &integration, which must specify the duration. nhbm_time_column_of then returns
 * the record by the names of the file that `nhbm integrate` writes (docs/user/schema.md). */
int nhbm_integrate(nhbm_model *model, nhbm_error *error);

/* Integrates in time from the last motion that nhbm_solve found, and from a perturbation of it, until it is clear whether the motion
 * is stable, over at most n_periods of the slowest tone (0: as many as the decay requires). nhbm_time_column_of then returns the
 * results that `nhbm verify` writes: integration_verdict, integration_difference, ... */
int nhbm_verify(nhbm_model *model, int n_periods, nhbm_error *error);

/* As nhbm_column_of and nhbm_column_names, for the last call of nhbm_integrate or nhbm_verify. */
int nhbm_time_column_of(nhbm_model *model, const char *name, nhbm_column *column, nhbm_error *error);
const char *nhbm_time_column_names(nhbm_model *model);

/* Returns the labels along the axes "dof", "law_dof", "law", "law_coordinate" and "state_dof", separated by blanks; empty for
 * other axes. */
const char *nhbm_labels(nhbm_model *model, const char *axis);

/* Returns why the last motion was not found, or a remark about it; empty if there is none. */
const char *nhbm_message(nhbm_model *model);

/* Registers a callback that is called twenty times a second during a computation and returns nonzero to end it. The result then has
 * the status `interrupted`. Null: no callback. */
int nhbm_ask(nhbm_model *model, int (*wants_end)(void *context), void *context, nhbm_error *error);

/* Registers a callback that receives the progress twenty times a second during a computation. Null: no callback. */
typedef struct nhbm_progress {
   double seconds;          /* since the beginning of the call */
   int64_t n_done, n_steps; /* steps of the time integration; 0 if there is none */
} nhbm_progress;
int nhbm_follow(nhbm_model *model, void (*report)(void *context, const nhbm_progress *progress), void *context, nhbm_error *error);

#ifdef __cplusplus
}
#endif
#endif
