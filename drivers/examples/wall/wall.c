/* The paper's beam against a rigid wall, from numbers: no input file, no result file. CMakeLists.txt builds it, or
 *
 *    cc wall.c $(pkg-config --cflags --libs nhbm) -o wall_in_c
 */
#include <nhbm.h>
#include <stdio.h>

int main(void) {
   static const double omega[] = {2.718281828459045, 3.141592653589793}; /* [rad/s] */
   static const int order[] = {12, 12}, samples[] = {64, 64};
   nhbm_model *model = NULL;
   nhbm_column coefficients, tuples;
   const double *cosines;
   const int *tuple;
   size_t harmonic;
   int failed, group, k;

   failed = nhbm_create(&model);

   failed = failed || nhbm_add_group(model, "structure", &group) || nhbm_set_text(model, group, "type", "beam");
   failed = failed || nhbm_set_real(model, group, "length", 1.0);               /* [m] */
   failed = failed || nhbm_set_real(model, group, "bending_stiffness", 1750.0); /* [N m2] */
   failed = failed || nhbm_set_real(model, group, "mass_per_length", 7.8);      /* [kg/m] */
   failed = failed || nhbm_set_real(model, group, "damping_diagonal", 1.0);     /* [N s/m] */
   failed = failed || nhbm_set_integers(model, group, "n_elements", 1, (const int[]){4}); /* midspan is v3 */

   failed = failed || nhbm_add_group(model, "law", &group) || nhbm_set_text(model, group, "type", "rigid_wall");
   failed = failed || nhbm_set_text(model, group, "dof", "v3");
   failed = failed || nhbm_set_real(model, group, "gap", 1.5e-3);         /* [m] */
   failed = failed || nhbm_set_real(model, group, "augmentation", 1.0e5); /* [N/m] */

   failed = failed || nhbm_add_group(model, "tones", &group) || nhbm_set_reals(model, group, "frequency", 2, omega);
   failed = failed || nhbm_add_group(model, "harmonics", &group) || nhbm_set_integers(model, group, "order", 2, order);
   failed = failed || nhbm_add_group(model, "sampling", &group) || nhbm_set_integers(model, group, "samples", 2, samples);
   for (k = 0; k < 2; ++k) {
      failed = failed || nhbm_add_group(model, "load", &group) || nhbm_set_text(model, group, "dof", "v3");
      failed = failed || nhbm_set_integers(model, group, "tuple", 2, (const int[]){k == 0, k == 1});
      failed = failed || nhbm_set_real(model, group, "cos", 100.0); /* [N] */
   }
   failed = failed || nhbm_add_group(model, "output", &group) || nhbm_set_text(model, group, "dofs", "v3");
   failed = failed || nhbm_solve(model, NHBM_COLD_START);
   failed = failed || nhbm_get_column(model, "coefficients", &coefficients) || nhbm_get_column(model, "tuples", &tuples);
   if (failed) {
      fprintf(stderr, "%s\n", nhbm_get_last_error());
      nhbm_destroy(&model);
      return 1;
   }
   cosines = coefficients.data; /* (dof, harmonic, component): here one degree of freedom, of each harmonic cosine and sine */
   tuple = tuples.data;         /* (harmonic, tone) */
   for (harmonic = 0; tuple[2 * harmonic] != 1 || tuple[2 * harmonic + 1] != 0;) ++harmonic;
   printf("cos tau_1 at midspan: %21.14e m\n", cosines[2 * harmonic]);
   nhbm_destroy(&model);
   return 0;
}
