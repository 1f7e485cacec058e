/* nhbm in other programs: steady vibrations of structures with contact, friction and other nonlinear laws under several tones.
 *
 * Order of use:
 *
 *    nhbm_model *model;
 *    nhbm_column column;
 *    int frequency, i;
 *    if (nhbm_create(&model) || nhbm_read_input(model, text, "my model") ||
 *        nhbm_find_group(model, "tones%frequency", &tones)) goto failed;
 *    for (i = 0; i < n; ++i) {
 *       if (nhbm_set_real(model, tones, "frequency", values[i]) || nhbm_solve(model, NHBM_WARM_START) ||
 *           nhbm_get_column(model, "coefficients", &column)) goto failed;
 *    }
 *    nhbm_destroy(&model);
 *    ...
 * failed:
 *    fprintf(stderr, "%s\n", nhbm_get_last_error());
 *
 * Return values. A function that returns `int` returns NHBM_SUCCESS or another value of enum nhbm_status, unless its
 * description states something else; nhbm_get_last_error then returns the cause. Results are returned through pointers. If a
 * function fails, these results are 0, NULL or an empty text.
 *
 * Errors. Each function checks its arguments: NULL, an index out of range, or a model that was destroyed is an error, never
 * undefined behaviour. No function prints, ends the process, catches signals, or changes the locale or the floating-point
 * modes. Exceptions: if memory runs out during a computation, the Fortran run-time library ends the process; a
 * nhbm_law_evaluate_2_function, a callback or an array that does not have the documented length can do any harm; callbacks must
 * return (no longjmp, no C++ exception).
 *
 * Threads. A model can be used by one call at a time: a call of any function with a model that is in use, by another thread or
 * because the call comes from a callback of the same model, returns NHBM_BUSY and has no effect. Other models can be used in
 * both cases; threads with one model each run in parallel. A thread needs a stack of 1 MiB; a computation in a callback of
 * another one needs 128 KiB more.
 *
 * Texts are null-terminated UTF-8 of at most 2 GiB. Texts and arrays that a function returns belong to the library; unless
 * stated otherwise, they are valid until the next call with the same model. `const nhbm_model *`: the function changes neither
 * values nor results. MPI and HDF5 are not required. */
#ifndef NHBM_H
#define NHBM_H

#include <stddef.h>
#include <stdint.h>

#include "nhbm_user_law.h"

#ifndef NHBM_EXPORT
#if defined(__GNUC__)
#define NHBM_EXPORT __attribute__((visibility("default")))
#else
#define NHBM_EXPORT
#endif
#endif

#ifdef __cplusplus
extern "C" {
#endif

/* ---- Status and errors ---- */

enum nhbm_status {
   NHBM_SUCCESS = 0,
   NHBM_INVALID_INPUT = -1,    /* the input, a path, or a value is wrong; the message names group, key and a valid value */
   NHBM_INVALID_ARGUMENT = -2, /* an argument is NULL, out of range, an unknown name, or not a model */
   NHBM_INVALID_STATE = -3,    /* the function cannot be called now: the model has no groups, no motion, no curve */
   NHBM_BUSY = -4,             /* another call is using the model */
   NHBM_OUT_OF_MEMORY = -5
};

/* Returns the meaning of a status in a few words. The text is valid until the process ends. */
NHBM_EXPORT const char *nhbm_status_text(int status);

/* Returns the message of the last function that failed in the calling thread: cause and remedy, without a newline at the end, at
 * most 8191 bytes; empty if none has failed. Functions that succeed do not change it. It is valid until the next call of this
 * thread that fails. */
NHBM_EXPORT const char *nhbm_get_last_error(void);

/* ---- Versions, features, input keys ---- */

#define NHBM_API_VERSION 1 /* increases by one when programs must be recompiled */

/* Returns the interface version of the library, to be compared with NHBM_API_VERSION. */
NHBM_EXPORT int nhbm_get_api_version(void);

/* Returns the version of the library as text, such as "0.1.0", valid until the process ends, and as a number, 10000 major + 100
 * minor + patch. */
NHBM_EXPORT const char *nhbm_get_version(void);
NHBM_EXPORT int nhbm_get_version_number(void);

/* Returns the commit that the library was built from, "unknown" outside a checkout, valid until the process ends. */
NHBM_EXPORT const char *nhbm_get_commit(void);

/* Returns 1 if the library has a feature, otherwise 0, also for NULL. Features: "cvode", the default method of nhbm_integrate,
 * which is optional in a build; a group of the input, such as "gradient"; a type of a group, such as "law jenkins". */
NHBM_EXPORT int nhbm_has_feature(const char *feature);

/* Returns the number of rows in the table of input keys. */
NHBM_EXPORT size_t nhbm_get_key_count(void);

/* Writes row `index` of this table, counted from 0, into `row`, which has `size` bytes: group | key | type | unit | default |
 * range | meaning. NHBM_KEY_ROW_SIZE bytes are enough for any row. NHBM_INVALID_ARGUMENT: no such row, or it does not fit. */
#define NHBM_KEY_ROW_SIZE 1201
NHBM_EXPORT int nhbm_get_key_row(size_t index, char *row, size_t size);

/* ---- Models ---- */

typedef struct nhbm_model nhbm_model;

/* Creates a model without groups. NHBM_OUT_OF_MEMORY: *model is NULL. */
NHBM_EXPORT int nhbm_create(nhbm_model **model);

/* Frees a model and sets *model to NULL; no effect if *model is NULL. Copies of the pointer become invalid: functions called
 * with one return NHBM_INVALID_ARGUMENT until a new model has the same address. NHBM_BUSY: the model remains. */
NHBM_EXPORT int nhbm_destroy(nhbm_model **model);

/* ---- Groups and their values ----
 *
 *     nhbm_add_group(model, "law", &wall);
 *     nhbm_set_text(model, wall, "type", "rigid_wall");
 *     nhbm_set_text(model, wall, "dof", "v3");
 *     nhbm_set_real(model, wall, "gap", 1.5e-3);
 *     ...
 *     if (nhbm_solve(model, NHBM_COLD_START) != NHBM_SUCCESS) fputs(nhbm_get_last_error(), stderr);
 *     nhbm_set_real(model, wall, "gap", 2.0e-3);
 *
 * The groups and keys are those of docs/user/input.md, settings of a computation included. The handle of a group is valid until the
 * group is removed. Each change ends a curve. The next computation, or nhbm_check, reports everything that is wrong: names of keys,
 * values, what is missing. */

/* Adds a group. NHBM_INVALID_ARGUMENT: there is no group of this name; the message lists the known ones. */
NHBM_EXPORT int nhbm_add_group(nhbm_model *model, const char *name, int *group);

/* Sets a key of a group, "gap", or one of several values of it, "frequency(2)". A matrix is given by rows; n = 0 restores the
 * default. Setting a number again is fast: the model is not read anew. NHBM_INVALID_ARGUMENT: there is no such group, or no such
 * key, or the value follows another one (&tie). */
NHBM_EXPORT int nhbm_set_real(nhbm_model *model, int group, const char *key, double value);
NHBM_EXPORT int nhbm_set_reals(nhbm_model *model, int group, const char *key, size_t n, const double *values);
NHBM_EXPORT int nhbm_set_integers(nhbm_model *model, int group, const char *key, size_t n, const int *values);
NHBM_EXPORT int nhbm_set_logicals(nhbm_model *model, int group, const char *key, size_t n, const int *values); /* 0: false */
NHBM_EXPORT int nhbm_set_text(nhbm_model *model, int group, const char *key, const char *text);
NHBM_EXPORT int nhbm_set_texts(nhbm_model *model, int group, const char *key, size_t n, const char *const *texts);

/* Removes a group. */
NHBM_EXPORT int nhbm_remove_group(nhbm_model *model, int group);

/* Removes all groups, with the motions of the model. Files that groups name are relative to `folder`, "models/", or, if it is empty,
 * to the current one. */
NHBM_EXPORT int nhbm_clear(nhbm_model *model, const char *folder);

/* Checks a group by itself, on the structure and the tones alone. NHBM_INVALID_INPUT: the message lists its errors. */
NHBM_EXPORT int nhbm_check_group(nhbm_model *model, int group);

/* Checks all groups. NHBM_INVALID_INPUT: the message lists all errors. */
NHBM_EXPORT int nhbm_check(nhbm_model *model);

/* Reads the text of an input (docs/user/input.md): its groups replace those of the model. Messages contain `name` and the line,
 * unless it is empty or the path of a folder, "models/"; files that the text names are relative to the folder of `name`.
 * NHBM_INVALID_INPUT: the message lists all errors; the model has no groups. */
NHBM_EXPORT int nhbm_read_input(nhbm_model *model, const char *text, const char *name);

/* Finds the group of a value by its path: "law(stop)%gap", "tones%frequency(1)". A group that occurs once is added if there is none.
 * NHBM_INVALID_INPUT: there is no such key, or its value follows another one. */
NHBM_EXPORT int nhbm_find_group(nhbm_model *model, const char *path, int *group);

/* Returns the input with all permitted keys and their values; an invalid value is replaced by the last valid one. */
NHBM_EXPORT int nhbm_get_input(const nhbm_model *model, const char **text);

/* Returns the input with the keys that were given or set, without defaults. */
NHBM_EXPORT int nhbm_get_given_input(const nhbm_model *model, const char **text);

/* Returns the files on which the model depends besides its input, one per line with a checksum: libraries of laws, the structure.
 * NHBM_INVALID_STATE: the model has no groups, or its present values are invalid. */
NHBM_EXPORT int nhbm_get_libraries(const nhbm_model *model, const char **text);

/* ---- Structures of the program ---- */

typedef struct nhbm_structure nhbm_structure;

/* Supplies the structure of an input with &structure type = 'model', file = FILE: describes it by the functions below and
 * returns 0. Any other value, or an error in one of these functions, makes nhbm_check, nhbm_read_input, or a computation after a
 * value of &structure has changed, fail with NHBM_INVALID_INPUT. `structure` is valid until the callback returns. */
typedef int (*nhbm_structure_callback)(void *context, const char *file, nhbm_structure *structure);

/* Sets this callback from the next reading of the structure on; NULL: none. Call it before the groups are read. `context` and what the
 * callback uses must exist until another callback is set or the model is destroyed. The same holds for the other callbacks. */
NHBM_EXPORT int nhbm_set_structure_callback(nhbm_model *model, nhbm_structure_callback callback, void *context);

/* Sets the labels of the degrees of freedom and their units, separated by blanks; no units: all m. `max_frequency` is the highest
 * frequency at which the structure is valid [rad/s], 0: any. Must be the first call, once. */
NHBM_EXPORT int nhbm_structure_set_dofs(nhbm_structure *structure, const char *labels, const char *units, double max_frequency);

/* Sets a matrix in compressed-row storage with indices from 0: the entries of row i are row_starts[i] to row_starts[i + 1] - 1.
 * n_rows: number of degrees of freedom; row_starts: n_rows + 1 values; columns, values: n_entries = row_starts[n_rows] values.
 * Names: mass, stiffness (both required), damping, gyroscopic, structural (the imaginary part of the stiffness);
 * gyroscopic_by_speed, stiffness_by_speed and stiffness_by_speed_squared, the terms that depend on a speed, and the same with
 * the suffix _2 for a second speed. A second call with the same name replaces the matrix. Units: kg, N/m, N s/m. */
NHBM_EXPORT int nhbm_structure_set_matrix(nhbm_structure *structure, const char *name, size_t n_rows, size_t n_entries,
                                          const int32_t *row_starts, const int32_t *columns, const double *values);

/* Adds a load vector [N]: `values` at the degrees of freedom `dofs`, counted from 0; n values each. */
NHBM_EXPORT int nhbm_structure_add_load(nhbm_structure *structure, const char *name, size_t n, const int32_t *dofs,
                                        const double *values);

/* Sets the node of each degree of freedom, 0 to n_nodes - 1, or -1 for none, and its direction; directions are separated by blanks.
 * n_dofs: number of degrees of freedom, and of values in `nodes`. Call it at most once. */
NHBM_EXPORT int nhbm_structure_set_nodes(nhbm_structure *structure, size_t n_nodes, size_t n_dofs, const int32_t *nodes,
                                         const char *directions);

/* Sets the positions of the nodes, after nhbm_structure_set_nodes: x, y and z [m] of each; NaN: unknown. They are not necessary: with
 * them, models are warned of that pair nodes of two sets although another node is nearer. */
NHBM_EXPORT int nhbm_structure_set_coordinates(nhbm_structure *structure, size_t n_nodes, const double *coordinates);

/* Adds a set of n nodes, after nhbm_structure_set_nodes. */
NHBM_EXPORT int nhbm_structure_add_node_set(nhbm_structure *structure, const char *name, size_t n, const int32_t *nodes);

/* Sets the error that the reading of the input reports, such as the reason why there is no structure of that name. */
NHBM_EXPORT int nhbm_structure_set_error(nhbm_structure *structure, const char *message);

/* ---- Laws of the program ---- */

/* Registers a law for all models of this process: &law type = 'user', library = '', name = NAME evaluates it as described in
 * nhbm_user_law.h. A law of the same name is replaced for inputs that are read later; models that have read it continue to use the
 * function, which must remain callable. NHBM_INVALID_ARGUMENT: a member of `info` is invalid. */
NHBM_EXPORT int nhbm_register_law(const char *name, const nhbm_law_info_t *info, nhbm_law_evaluate_2_function evaluate);

/* Removes a law. NHBM_INVALID_ARGUMENT: no law has this name. */
NHBM_EXPORT int nhbm_unregister_law(const char *name);

/* ---- Callbacks during computations ---- */

/* Returns nonzero to end the computation; is called twenty times a second. The computation then succeeds: the motion has the status
 * `interrupted`, the curve has ended, a time integration has no record. */
typedef int (*nhbm_interrupt_callback)(void *context);
NHBM_EXPORT int nhbm_set_interrupt_callback(nhbm_model *model, nhbm_interrupt_callback callback, void *context); /* NULL: none */

typedef struct nhbm_progress {
   double seconds;  /* since the beginning of the call */
   int64_t n_done;  /* steps of the time integration, and their total number; 0 during other computations */
   int64_t n_steps;
} nhbm_progress;

/* Receives the progress; is called twenty times a second. */
typedef void (*nhbm_progress_callback)(void *context, const nhbm_progress *progress);
NHBM_EXPORT int nhbm_set_progress_callback(nhbm_model *model, nhbm_progress_callback callback, void *context); /* NULL: none */

/* ---- Computations ---- */

enum nhbm_start {
   NHBM_COLD_START = 0, /* from the start that the input specifies */
   NHBM_WARM_START = 1  /* from the last motion found, if there is one */
};

/* Computes the motion of the model with its present values; `start` is one of enum nhbm_start. Ends a curve. A solution that
 * does not converge is not an error: the column "status" is 1 if it has converged (docs/user/schema.md), otherwise
 * nhbm_get_message returns the cause. NHBM_INVALID_INPUT: a value is invalid. */
NHBM_EXPORT int nhbm_solve(nhbm_model *model, int start);

/* Sets the number of solutions that belong together, by default 1: if &stability method = 'auto' finds stability too expensive
 * for a point, the points share half a second, as in a run of the command. 0: no budget. A curve counts its own
 * points. */
NHBM_EXPORT int nhbm_set_point_count(nhbm_model *model, size_t n_points);

/* Begins the curve of the group &curve. The value that it moves is restored when the curve ends. */
NHBM_EXPORT int nhbm_curve_begin(nhbm_model *model);

/* Computes the next point of the curve as the last motion. *has_point: 1, or 0 after the last point and in each further call.
 * A point without a solution is not an error, as in nhbm_solve; it ends the curve. NHBM_INVALID_STATE: no curve has begun, or
 * another function has ended it. */
NHBM_EXPORT int nhbm_curve_next(nhbm_model *model, int *has_point);

/* Gives a curve that has ended at `points` of &curve more of them: nhbm_curve_next goes on, as if it had had them from the start.
 * NHBM_INVALID_STATE: no curve has ended so. NHBM_INVALID_ARGUMENT: it has as many already, or they are too many. */
NHBM_EXPORT int nhbm_curve_lengthen(nhbm_model *model, size_t n_points);

/* Sweeps: the points of the groups &sweep of the input, in the order, from the first guesses and with the bits of a run of the
 * command. Points that start from each other form a chain (docs/user/input.md); another point is a chain by itself. Chains do not
 * depend on each other: several models with one input can solve some of them each. */
typedef struct nhbm_sweep {
   size_t n_points, n_chains;
} nhbm_sweep;

/* Begins the sweep. NHBM_INVALID_INPUT: a value of its first point is invalid, or there is a group &curve. */
NHBM_EXPORT int nhbm_sweep_begin(nhbm_model *model, nhbm_sweep *sweep);

/* Chooses n chains from the one with the number `first` on, counted from 0, whose points follow; at first all.
 * NHBM_INVALID_STATE: no sweep has begun, or another function has ended it. NHBM_INVALID_ARGUMENT: no such chains. */
NHBM_EXPORT int nhbm_sweep_select(nhbm_model *model, size_t first, size_t n);

/* Computes the next point of these chains as the last motion. *has_point: 1, or 0 after the last one. A point without a solution,
 * or with an invalid value, is not an error: its column "status" and its message report it. NHBM_INVALID_STATE: as before. */
NHBM_EXPORT int nhbm_sweep_next(nhbm_model *model, int *has_point);

/* Numbers the branches of all points of the sweep along the fastest parameter, as the column "branch" of a result file. For each
 * point its columns "status", "tuples" (n_harmonics rows, one entry for each tone), "corrected_coefficients" (n_values, that is
 * pairs of n_harmonics for each coordinate; NaN: not known) and "branch", which is replaced. NHBM_INVALID_STATE: as before. */
NHBM_EXPORT int nhbm_sweep_number_branches(nhbm_model *model, size_t n_values, size_t n_harmonics, const int32_t *status,
                                           const int32_t *tuples, const double *coefficients, int32_t *branch);

/* Integrates the model in time according to the group &integration, which must specify the duration; nhbm_get_time_column then
 * returns the record by the names of the file that `nhbm integrate` writes (docs/user/schema.md). Ends a curve. */
NHBM_EXPORT int nhbm_integrate(nhbm_model *model);

/* Integrates in time from the last motion that nhbm_solve has found, and from a perturbation of it, until it is clear whether the
 * motion is stable, over at most max_periods periods of the slowest tone; 0: as many as the decay requires.
 * nhbm_get_time_column then returns the results of `nhbm verify`: integration_verdict, integration_difference, ...
 * NHBM_INVALID_STATE: there is no such motion, or a value has changed since. NHBM_INVALID_ARGUMENT: max_periods is negative. */
NHBM_EXPORT int nhbm_verify(nhbm_model *model, int max_periods);

/* Processor time [s] after which nhbm_verify and nhbm_verify_motion end, with the verdict "undecided" and the
 * duration 0; 0, as at first: no limit. */
NHBM_EXPORT int nhbm_set_verification_time(nhbm_model *model, double seconds);

/* A motion of the caller, such as one read from a file, at all degrees of freedom of the model. */
typedef struct nhbm_motion {
   size_t n_tones, n_harmonics, n_dofs;
   const double *frequency;          /* n_tones values [rad/s] */
   const int32_t *tuples;            /* n_harmonics rows of n_tones entries */
   const double *coefficients;       /* for each degree of freedom n_harmonics pairs (cos, sin) */
   double truncation_estimate;       /* as the columns of these names; NaN: not known */
   double aliasing_estimate;
   const double *frequency_estimate; /* n_tones values, or NULL: not known */
   int status, n_unstable;           /* as the columns of these names */
} nhbm_motion;

/* As nhbm_verify, for such a motion of the model with its present values. Ends a curve. */
NHBM_EXPORT int nhbm_verify_motion(nhbm_model *model, const nhbm_motion *motion, int max_periods);

/* What a census has found, and how complete it is (docs/howto/other_solution.md). */
typedef struct nhbm_census {
   size_t n_motions;
   int n_random, n_random_lost;     /* random starts; those that led to no motion */
   int n_directed, n_directed_lost; /* directed ones, likewise */
   int n_left;                      /* random starts that the time limit did not permit */
   int n_once, n_never;             /* motions that one random start has found, and none */
   int is_reliable;                 /* 1: there were enough finds for the estimates */
   double unseen, unseen_bound;     /* probability that a further random start finds an unknown motion; its bound with 95 % */
   double missed;                   /* estimated number of motions that were missed, at least */
   double least_share;              /* motions to which a smaller share of the converged random starts leads may be missed, with 95 % */
} nhbm_census;

enum nhbm_census_start {
   NHBM_FROM_FIRST_GUESS = 1, /* of the model */
   NHBM_FROM_EQUILIBRIUM = 2,
   NHBM_FROM_MODE = 3,
   NHBM_FROM_RANDOM_START = 4,
   NHBM_FROM_MIRROR_IMAGE = 5, /* of another motion */
   NHBM_FROM_DEFLATION = 6,    /* of the known motions */
   NHBM_FROM_CONTINUATION = 7  /* of the loads, from a known motion */
};

typedef struct nhbm_census_motion {
   int n_random, n_directed; /* starts that led to it */
   int start;                /* that found it, one of enum nhbm_census_start */
   int mirror_of;            /* index of the motion whose mirror image it is; -1: of none */
} nhbm_census_motion;

/* Searches for all coexisting motions of the model with its present values, from directed starts and `n_starts` random ones, in at
 * most `time_limit` seconds; 0: no limit. The same `seed` gives the same starts. Ends a curve. NHBM_INVALID_INPUT: a value is
 * invalid, or a tone is unknown. NHBM_INVALID_ARGUMENT: a number is negative. */
NHBM_EXPORT int nhbm_take_census(nhbm_model *model, int n_starts, int seed, double time_limit, nhbm_census *census);

/* Makes a motion of this census, by its index from 0 in the order of size, the last motion. NHBM_INVALID_STATE: there is no census,
 * or a value has changed since. NHBM_INVALID_ARGUMENT: no such motion. */
NHBM_EXPORT int nhbm_select_census_motion(nhbm_model *model, size_t index, nhbm_census_motion *found);

/* ---- Checks ---- */

/* What advice is about. */
enum nhbm_subject {
   NHBM_ADVICE_ON_MODEL = 0,  /* its present values: no load, tones with a common period, values that suggest a mistake */
   NHBM_ADVICE_ON_MOTION = 1, /* the last one: why it has not converged, or is less accurate than requested, with numbers and limits; tones
                               * of which a low-order combination vanishes; joints that stick throughout; for the first motion of an input
                               * derivatives of user laws that differ from differences of their forces */
   NHBM_ADVICE_ON_LAWS = 2    /* laws that exert no force on the last motion, or on all points of a sweep so far */
};

/* Returns what was found and what to do, one per line: name in the table of advice, the law or degree of freedom that it is about
 * (empty: none) and text, with tabulators between. Empty: nothing. NHBM_INVALID_INPUT: a value is invalid. */
NHBM_EXPORT int nhbm_get_advice(nhbm_model *model, int about, const char **advice);

/* Returns the text of a row of this table with `n` values and with words, separated by newlines, in their places.
 * NHBM_INVALID_ARGUMENT: the table has no such name. */
NHBM_EXPORT int nhbm_describe_advice(nhbm_model *model, const char *name, size_t n, const double *values, const char *words,
                                     const char **text);

/* Returns the natural frequencies of the structure [rad/s], ascending, without damping and laws; *n is 0 for a structure of more
 * than 1500 degrees of freedom or with sparse matrices. NHBM_INVALID_INPUT: a value is invalid. */
NHBM_EXPORT int nhbm_get_natural_frequencies(nhbm_model *model, size_t *n, const double **frequencies);

/* ---- Results ---- */

enum nhbm_kind {
   NHBM_REAL = 0,     /* double */
   NHBM_INTEGER = 1,  /* int32_t */
   NHBM_NO_VALUES = 2 /* the column exists, but its values are not known; data is NULL */
};

#define NHBM_MAX_AXES 4

typedef struct nhbm_column {
   const void *data;            /* n_values values, the last axis fastest */
   int kind;                    /* enum nhbm_kind */
   int n_axes;                  /* 0: a single value */
   size_t shape[NHBM_MAX_AXES]; /* length of each axis; 0 beyond n_axes */
   size_t n_values;
   const char *unit;
   const char *axes;            /* names of the axes, separated by blanks: "dof harmonic component" */
} nhbm_column;

/* Returns a column of the last motion, by its name in the result file (docs/user/schema.md). Before the first computation no column
 * of a motion has values. NHBM_INVALID_ARGUMENT: no column has this name; the message lists the known ones.
 * NHBM_INVALID_STATE: the model has no groups, or its present values are invalid. */
NHBM_EXPORT int nhbm_get_column(const nhbm_model *model, const char *name, nhbm_column *column);

typedef struct nhbm_column_description {
   const char *long_name;     /* meaning */
   const char *dof_units;     /* for columns along degrees of freedom: the unit at each, separated by blanks; else empty. If they
                               * differ, `unit` of the column is "see dof_units" */
   const char *flag_meanings; /* names of the values lowest_flag, lowest_flag + 1, ..., separated by blanks; empty: numbers */
   const char *attributes;    /* further attributes, one per line: "name = text" */
   int lowest_flag;
   int kind;                  /* of its values, also if they are not known: NHBM_REAL or NHBM_INTEGER */
} nhbm_column_description;

/* Describes a column; results and errors as of nhbm_get_column. */
NHBM_EXPORT int nhbm_describe_column(const nhbm_model *model, const char *name, nhbm_column_description *description);

/* Returns the names of all columns, separated by blanks. */
NHBM_EXPORT int nhbm_get_column_names(const nhbm_model *model, const char **names);

/* As nhbm_get_column, nhbm_get_column_names and nhbm_describe_column, for the last call of nhbm_integrate, nhbm_verify or
 * nhbm_verify_motion. NHBM_INVALID_STATE: there was none, or it was interrupted. */
NHBM_EXPORT int nhbm_get_time_column(const nhbm_model *model, const char *name, nhbm_column *column);
NHBM_EXPORT int nhbm_get_time_column_names(const nhbm_model *model, const char **names);
NHBM_EXPORT int nhbm_describe_time_column(const nhbm_model *model, const char *name, nhbm_column_description *description);

/* ---- Tables of motions ----
 *
 *     nhbm_clear_table(model);
 *     for (i = 0; i < n; ++i) {
 *        if (nhbm_set_real(model, wall, "gap", gaps[i]) || nhbm_solve(model, NHBM_WARM_START) || nhbm_add_row(model)) goto failed;
 *     }
 *     if (nhbm_get_table(model, &table)) goto failed;
 *     for (i = 0; i < table.n_columns; ++i) ... nhbm_describe_table_column, nhbm_copy_columns
 *
 * The table of a model has a row for each motion that was added, with all columns of these motions. Computations, values that are
 * set and other inputs do not change it. */

/* Removes all rows. */
NHBM_EXPORT int nhbm_clear_table(nhbm_model *model);

/* Adds the last motion. NHBM_INVALID_STATE: the model has no groups, or its present values are invalid. */
NHBM_EXPORT int nhbm_add_row(nhbm_model *model);

typedef struct nhbm_table {
   size_t n_rows, n_columns;
   int declaration;       /* another number: names, units, axes or labels have changed since the last table */
   int has_messages;      /* 1: nhbm_get_row_message returns a text for some of the rows */
   const int32_t *sizes;  /* 1 + NHBM_MAX_AXES numbers for each column: 1 if a row has values, otherwise 0; the lengths of its axes */
} nhbm_table;
NHBM_EXPORT int nhbm_get_table(nhbm_model *model, nhbm_table *table);

typedef struct nhbm_table_column {
   const char *name, *unit, *axes;
   nhbm_column_description description;
} nhbm_table_column;

/* Describes a column of the table, by its number from 0. NHBM_INVALID_ARGUMENT: no such column. */
NHBM_EXPORT int nhbm_describe_table_column(nhbm_model *model, size_t column, nhbm_table_column *found);

/* Copies n columns from the one with the number `first` on into `values`, of `size` bytes: one after another, each with the next
 * multiple of eight bytes, rows slowest, the last axis fastest; double or int32_t. Columns without values take no place. What a row
 * does not have is NaN, or 0 for integers and beyond the harmonics of the motion. NHBM_INVALID_ARGUMENT: no such columns, or `values`
 * is too small. */
NHBM_EXPORT int nhbm_copy_columns(nhbm_model *model, size_t first, size_t n, void *values, size_t size);

/* Returns the message of a row, as nhbm_get_message. */
NHBM_EXPORT int nhbm_get_row_message(nhbm_model *model, size_t row, const char **message);

/* Returns the labels along an axis of the table, as nhbm_get_labels. */
NHBM_EXPORT int nhbm_get_table_labels(nhbm_model *model, const char *axis, const char **labels);

/* Returns the labels along the axes "dof", "law_dof", "law", "law_coordinate", "gradient_value" and "state_dof", and the
 * numbers along "multiplier", one per line; empty for other axes. */
NHBM_EXPORT int nhbm_get_labels(const nhbm_model *model, const char *axis, const char **labels);

/* Returns the columns "status" and "reason" of the last motion. */
NHBM_EXPORT int nhbm_get_outcome(const nhbm_model *model, int *status, int *reason);

/* Returns why the last motion was not found, or a remark about it; empty if there is none. */
NHBM_EXPORT int nhbm_get_message(const nhbm_model *model, const char **message);

#ifdef __cplusplus
}
#endif
#endif
