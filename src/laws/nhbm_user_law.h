/*
 * A nonlinear law of your own for nhbm: a shared library that is loaded at run time, nhbm itself is not touched.
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
 *    int cubic_evaluate(int n_samples, int n_coordinates, int stride, const double *z, const double *v,
 *                       int n_parameters, const double *parameters, double *f, double *df_dz, double *df_dv);
 *
 * `nhbm check input.nml` loads the library and compares the derivatives with differences of the forces.
 * Worked examples in C and in Fortran: inputs/user_law/.
 */
#ifndef NHBM_USER_LAW_H
#define NHBM_USER_LAW_H

#ifdef __cplusplus
extern "C" {
#endif

/* Version of this interface. nhbm refuses a library that gives another one. */
#define NHBM_USER_LAW_API 1

#define NHBM_ANY_NUMBER (-1)

/*
 * What nhbm needs to know before the first evaluation. nhbm hands over a struct of zeros; the function fills it and
 * returns 0, or anything else to be refused. `api_version` stays the first member in every version.
 */
typedef struct nhbm_law_info {
   int api_version;     /* NHBM_USER_LAW_API as the library was compiled */
   int n_coordinates;   /* coordinates that the law needs, or NHBM_ANY_NUMBER */
   int n_parameters;    /* numbers in `parameters` of the input that it needs, or NHBM_ANY_NUMBER */
   int needs_velocity;  /* 0: the force depends on displacements alone, v and df_dv are NULL */
   int degree;          /* of a force that is a polynomial in z and v: sets the default number of samples; else 0 */
   double length_scale; /* a length typical of the law, such as a gap [m]; 0 when there is none */
} nhbm_law_info_t;

typedef int (*nhbm_law_info_function)(nhbm_law_info_t *info);

/*
 * Forces of a block of samples, and their derivatives when asked for. Forces stand beside K q on the left-hand side of
 * the equation of motion: a spring that pulls back has a positive force at a positive displacement.
 *
 * Arrays are column-major, sample by sample with stride 1:
 *
 *    z[i + stride*c]                            displacement of coordinate c at sample i [m]
 *    v[i + stride*c]                            its rate [m/s]; NULL unless needs_velocity
 *    f[i + stride*a]                            force on coordinate a [N], to be written
 *    df_dz[i + stride*(a + n_coordinates*b)]    d f_a/d z_b, to be written; NULL when not asked for
 *    df_dv[i + stride*(a + n_coordinates*b)]    d f_a/d v_b, to be written; NULL when not asked for or not needs_velocity
 *
 * with 0 <= i < n_samples <= stride and 0 <= a, b, c < n_coordinates. Every entry must be written, zeros too: it is NaN before.
 *
 * Returns
 *    0           all is well; entries may be NaN where the law is not defined,
 *    positive    a sample lies outside of what the law can do: the solver tries a smaller step,
 *    negative    the law cannot go on: this point of the study ends as `failed`, the others go on.
 * In both last cases what stands in f and the derivatives is not used. nhbm tells the number in the message of the point.
 *
 * The same samples must always give the same forces: nhbm calls the function in any order and with blocks of any size,
 * and every MPI rank calls its own copy.
 */
typedef int (*nhbm_law_evaluate_function)(int n_samples, int n_coordinates, int stride, const double *z, const double *v,
                                          int n_parameters, const double *parameters, double *f, double *df_dz,
                                          double *df_dv);

#ifdef __cplusplus
}
#endif

#endif
