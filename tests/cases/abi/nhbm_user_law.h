/*
 * A nonlinear law of your own for nhbm: a shared library that is loaded at run time, or a function of the program that nhbm is part
 * of; nhbm itself is not touched.
 *
 * The input names it,
 *
 *    &law
 *       type = 'user'
 *       library = 'libcubic.so'     ! looked for beside the input file, then as dlopen(3) does
 *       name = 'cubic'              ! prefix of the two functions below
 *       dof = 'x1'                  ! or dofs and weights: one coordinate; dofs alone: each a coordinate of its own
 *       parameters = 1.5
 *    /
 *
 * and the library exports two functions, here of the prefix `cubic`:
 *
 *    int cubic_info(nhbm_law_info_t *info);
 *    int cubic_evaluate(const nhbm_law_samples_t *samples);
 *
 * The force may also depend on the phases of the tones, omega t, on the base frequencies, and on states that follow the motion along
 * time, as the position of a friction slider: then `info` names a third function, `advance`.
 *
 * A program that solves models in process (nhbm.h) hands over such a function by nhbm_give_law, and names it with library = ''.
 *
 * `nhbm check input.nml` loads the library and compares the derivatives with differences of the forces.
 * Worked examples in C and in Fortran: inputs/user_law/.
 */
#ifndef NHBM_USER_LAW_H
#define NHBM_USER_LAW_H

#ifdef __cplusplus
extern "C" {
#endif

/* Versions of this interface, by what `evaluate` takes: its arguments one by one, or a struct of them with a context. */
#define NHBM_USER_LAW_API 1
#define NHBM_USER_LAW_API_2 2

#define NHBM_ANY_NUMBER (-1)

struct nhbm_law_step;

/*
 * What nhbm needs to know before the first evaluation. nhbm hands over a struct of zeros; the function fills it and
 * returns 0, or anything else to be refused. `api_version` stays the first member in every version.
 */
typedef struct nhbm_law_info {
   int api_version;     /* NHBM_USER_LAW_API_2, or NHBM_USER_LAW_API */
   int n_coordinates;   /* coordinates that the law needs, or NHBM_ANY_NUMBER */
   int n_parameters;    /* numbers in `parameters` of the input that it needs, or NHBM_ANY_NUMBER */
   int needs_velocity;  /* 0: the force depends on displacements alone, v and df_dv are NULL */
   int degree;          /* of a force that is a polynomial in z and v: sets the default number of samples; else 0 */
   double length_scale; /* a length typical of the law, such as a gap [m]; 0 when there is none */
   /* what follows is of NHBM_USER_LAW_API_2 */
   void *context;         /* handed to each call as it is */
   int needs_phases;      /* 1: the force depends on the phases of the tones; else phases is NULL */
   int needs_frequencies; /* 1: the force depends on the base frequencies; else frequencies is NULL. nhbm takes differences for df/domega */
   int n_states;          /* states of one sample; with states needs_velocity, needs_phases and needs_frequencies must be 0 */
   int (*advance)(const struct nhbm_law_step *step); /* of a law with states, else NULL */
   void *reserved[4];     /* NULL */
} nhbm_law_info_t;

typedef int (*nhbm_law_info_function)(nhbm_law_info_t *info);

/*
 * A block of samples. Forces stand beside K q on the left-hand side of the equation of motion: a spring that pulls back has a
 * positive force at a positive displacement. Arrays are column-major, sample by sample with stride 1; with 0 <= i < n_samples <= stride
 * and 0 <= a, b, c < n_coordinates
 *
 *    z[i + stride*c]                            displacement of coordinate c at sample i [m]
 *    f[i + stride*a]                            force on coordinate a [N]
 *    df_dz[i + stride*(a + n_coordinates*b)]    d f_a/d z_b
 *
 * v is as z, df_dv as df_dz. Every entry of f and of the derivatives that are asked for must be written, zeros too: it is NaN before.
 */
typedef struct nhbm_law_samples {
   int n_samples, n_coordinates, stride, n_parameters;
   const double *z;          /* displacements [m] */
   const double *v;          /* their rates [m/s]; NULL unless needs_velocity */
   const double *parameters; /* of the input */
   double *f;                /* forces [N] */
   double *df_dz;            /* derivatives by z; NULL when not asked for */
   double *df_dv;            /* and by v; NULL when not asked for or not needs_velocity */
   void *context;            /* of nhbm_law_info_t */
   int n_tones;               /* of phases or frequencies, else 0 */
   int n_states;
   const double *phases;      /* [i + stride*m]: phase of tone m at sample i [rad], omega_m t along time; NULL unless needs_phases */
   const double *frequencies; /* [m]: base frequency of tone m [rad/s]; NULL unless needs_frequencies */
   const double *states;      /* [i + stride*k]: state k at sample i; NULL without states */
   double *df_ds;             /* [i + stride*(a + n_coordinates*k)], d f_a/d s_k; NULL when not asked for */
} nhbm_law_samples_t;

/*
 * A step along time of each of n_samples samples: `advance` finds the states at its end from those at its start and the path in between,
 * of which the displacements and their rates times the duration of the step are known at both ends, and so the cubic through them.
 * At rest all states are zero. States follow the path alone, not the duration of the step. The derivatives are NULL together when they
 * are not asked for. Every entry of what is asked for must be written. Return codes are those of `evaluate`.
 *
 *    z[i + stride*c], states[i + stride*k], ds_dbefore[i + stride*(k + n_states*l)], ds_dz[i + stride*(k + n_states*c)]
 */
typedef struct nhbm_law_step {
   int n_samples, n_coordinates, n_states, stride, n_parameters;
   const double *z;             /* displacements at the end [m] */
   const double *z_before;      /* and at the start [m] */
   const double *rise;          /* rates at the end times the duration [m] */
   const double *rise_before;   /* and at the start [m] */
   const double *states_before; /* at the start */
   const double *parameters;    /* of the input */
   double *states;              /* at the end */
   double *ds_dbefore;          /* derivatives of `states` by states_before, */
   double *ds_dz, *ds_dz_before, *ds_drise, *ds_drise_before; /* and by the path */
   void *context;               /* of nhbm_law_info_t */
} nhbm_law_step_t;

/*
 * Writes forces, and derivatives when asked for. Returns
 *    0           all is well; entries may be NaN where the law is not defined,
 *    positive    a sample lies outside of what the law can do: the solver tries a smaller step,
 *    negative    the law cannot go on: this point of the study ends as `failed`, the others go on.
 * In both last cases what stands in f and the derivatives is not used. nhbm tells the number in the message of the point.
 *
 * The same samples must always give the same forces: nhbm calls the function in any order and with blocks of any size,
 * and every MPI rank calls its own copy.
 */
typedef int (*nhbm_law_evaluate_2_function)(const nhbm_law_samples_t *samples);

/* `evaluate` of libraries whose info says NHBM_USER_LAW_API: what the struct has, one by one. */
typedef int (*nhbm_law_evaluate_function)(int n_samples, int n_coordinates, int stride, const double *z, const double *v,
                                          int n_parameters, const double *parameters, double *f, double *df_dz,
                                          double *df_dv);

#ifdef __cplusplus
}
#endif

#endif
