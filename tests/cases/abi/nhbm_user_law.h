/*
 * A user-defined nonlinear law for nhbm: a shared library that is loaded at run time, or a function of the program that contains
 * nhbm. nhbm itself is not changed.
 *
 * The input names it,
 *
 *    &law
 *       type = 'user'
 *       library = 'libcubic.so'     ! searched beside the input file, then by dlopen(3)
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
 * The force may also depend on the phases of the tones, omega t, on the base frequencies, and on states that evolve with the motion
 * along time, such as the position of a friction slider; `info` then provides a third function, `advance`.
 *
 * A program that solves models in process (nhbm.h) registers such a function with nhbm_register_law; the input uses library = ''.
 *
 * `nhbm check input.nml` loads the library and compares the derivatives with differences of the forces.
 * Worked examples in C and in Fortran: inputs/user_law/.
 */
#ifndef NHBM_USER_LAW_H
#define NHBM_USER_LAW_H

#ifdef __cplusplus
extern "C" {
#endif

/* Versions of this interface, by the arguments of `evaluate`: one by one, or a struct of them with a context. */
#define NHBM_USER_LAW_API 1
#define NHBM_USER_LAW_API_2 2

#define NHBM_ANY_NUMBER (-1)

struct nhbm_law_step;

/*
 * Properties of the law. nhbm passes a struct of zeros; the function fills it and returns 0, or another value to refuse.
 * `api_version` is the first member in every version.
 */
typedef struct nhbm_law_info {
   int api_version;     /* NHBM_USER_LAW_API_2, or NHBM_USER_LAW_API */
   int n_coordinates;   /* coordinates that the law needs, or NHBM_ANY_NUMBER */
   int n_parameters;    /* required length of `parameters` in the input, or NHBM_ANY_NUMBER */
   int needs_velocity;  /* 0: the force depends on displacements only, v and df_dv are NULL */
   int degree;          /* of a force that is a polynomial in z and v, at most 1000: determines the default number of samples; otherwise 0 */
   double length_scale; /* a length typical of the law, such as a gap [m]; 0 if there is none */
   /* the following members belong to NHBM_USER_LAW_API_2 */
   void *context;         /* passed to each call unchanged */
   int needs_phases;      /* 1: the force depends on the phases of the tones; otherwise phases is NULL */
   int needs_frequencies; /* 1: the force depends on the base frequencies; otherwise frequencies is NULL. df/domega is computed by differences */
   int n_states;          /* states of one sample, at most 1000; with states needs_velocity, needs_phases and needs_frequencies must be 0 */
   int (*advance)(const struct nhbm_law_step *step); /* of a law with states, otherwise NULL */
   void *reserved[4];     /* NULL */
} nhbm_law_info_t;

typedef int (*nhbm_law_info_function)(nhbm_law_info_t *info);

/*
 * A block of samples. Forces are added to K q on the left-hand side of the equation of motion: a restoring spring has a
 * positive force at a positive displacement. Arrays are column-major, sample by sample with stride 1; with 0 <= i < n_samples <= stride
 * and 0 <= a, b, c < n_coordinates
 *
 *    z[i + stride*c]                            displacement of coordinate c at sample i [m]
 *    f[i + stride*a]                            force on coordinate a [N]
 *    df_dz[i + stride*(a + n_coordinates*b)]    d f_a/d z_b
 *
 * v has the layout of z, df_dv that of df_dz. Every entry of f and of the requested derivatives must be written, including zeros; it is
 * NaN before.
 */
typedef struct nhbm_law_samples {
   int n_samples, n_coordinates, stride, n_parameters;
   const double *z;          /* displacements [m] */
   const double *v;          /* their rates [m/s]; NULL unless needs_velocity */
   const double *parameters; /* of the input */
   double *f;                /* forces [N] */
   double *df_dz;            /* derivatives by z; NULL if not requested */
   double *df_dv;            /* and by v; NULL if not requested or not needs_velocity */
   void *context;            /* of nhbm_law_info_t */
   int n_tones;               /* of phases or frequencies, otherwise 0 */
   int n_states;
   const double *phases;      /* [i + stride*m]: phase of tone m at sample i [rad], omega_m t along time; NULL unless needs_phases */
   const double *frequencies; /* [m]: base frequency of tone m [rad/s]; NULL unless needs_frequencies */
   const double *states;      /* [i + stride*k]: state k at sample i; NULL without states */
   double *df_ds;             /* [i + stride*(a + n_coordinates*k)], d f_a/d s_k; NULL if not requested */
} nhbm_law_samples_t;

/*
 * A step along time of each of n_samples samples: `advance` computes the states at its end from those at its start and the path in
 * between, which is given by the displacements and their rates times the duration of the step at both ends, and thus by a cubic.
 * At rest all states are zero. States depend on the path only, not on the duration of the step. If the derivatives are not requested,
 * all of them are NULL. Every entry of the requested arrays must be written. Return codes are those of `evaluate`.
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
 * Computes forces, and derivatives if requested. Returns
 *    0           success; entries may be NaN where the law is not defined,
 *    positive    recoverable: a sample is outside the domain of the law, and the solver tries a smaller step,
 *    negative    fatal: this point of the study ends as `failed`, the others continue.
 * After a nonzero return f and the derivatives are not used. nhbm includes the number in the message of the point.
 *
 * The same samples must always give the same forces: nhbm calls the function in any order and with blocks of any size,
 * and every MPI rank calls its own copy.
 */
typedef int (*nhbm_law_evaluate_2_function)(const nhbm_law_samples_t *samples);

/* `evaluate` of libraries with NHBM_USER_LAW_API: the members of the struct as arguments. */
typedef int (*nhbm_law_evaluate_function)(int n_samples, int n_coordinates, int stride, const double *z, const double *v,
                                          int n_parameters, const double *parameters, double *f, double *df_dz,
                                          double *df_dv);

#ifdef __cplusplus
}
#endif

#endif
