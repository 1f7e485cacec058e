#!/usr/bin/env bash
# CHOLMOD 3.0.14 (SuiteSparse 5.12.0) takes an indefinite symmetric matrix, such as a dynamic stiffness above the first
# resonance, where it is small, and solves with it to 1e-11: by default small ones are factorized as LDL'. Large ones are
# factorized as LL', where the same kind of matrix fails, but cholmod_factorize returns TRUE as before, and the solution
# is NaN: only Common->status, 1, tells it. What was tried on a coarse mesh fails on a fine one. Seen for the Laplacian
# of a square less .37 of the unit: 4,096 rows solved, 16,384 rows NaN.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
header=/usr/include/suitesparse/cholmod.h
[[ -f $header ]] || apt-get install --yes --quiet libsuitesparse-dev=1:5.12.0+dfsg-2 gcc libc6-dev >/dev/null
cat >indefinite.c <<'END_OF_C'
#include <math.h>
#include <stdio.h>
#include <suitesparse/cholmod.h>

/* Laplacian of a grid of n x n points less a shift; prints what happens, returns whether the solution is right. */
static int solves(int n, double shift) {
   cholmod_common c;
   cholmod_start(&c);
   c.print = 0;
   cholmod_triplet *entries = cholmod_allocate_triplet(n * n, n * n, 3 * n * n, 1, CHOLMOD_REAL, &c);
   int *row = entries->i, *column = entries->j, k = 0;
   double *value = entries->x, one[2] = {1, 0}, minus[2] = {-1, 0};
   for (int p = 0; p < n * n; p++) {
      row[k] = p, column[k] = p, value[k++] = 4 - shift;
      if (p % n < n - 1) row[k] = p, column[k] = p + 1, value[k++] = -1;
      if (p / n < n - 1) row[k] = p, column[k] = p + n, value[k++] = -1;
   }
   entries->nnz = k;
   cholmod_sparse *a = cholmod_triplet_to_sparse(entries, k, &c);
   cholmod_factor *factor = cholmod_analyze(a, &c);
   int returned = cholmod_factorize(a, factor, &c), status = c.status;
   cholmod_dense *b = cholmod_ones(n * n, 1, CHOLMOD_REAL, &c), *x = cholmod_solve(CHOLMOD_A, factor, b, &c);
   cholmod_sdmult(a, 0, minus, one, x, b, &c);
   double residual = cholmod_norm_dense(b, 0, &c);
   printf("%6d rows less %.2f: %s, returned %d, status %d, residual %.1e\n", n * n, shift, factor->is_ll ? "LL'" : "LDL'", returned,
          status, residual);
   return returned ? residual < 1e-8 : -1;
}

int main(void) {
   printf("CHOLMOD %d.%d.%d\n", CHOLMOD_MAIN_VERSION, CHOLMOD_SUB_VERSION, CHOLMOD_SUBSUB_VERSION);
   return !(solves(64, 0.0) == 1 && solves(64, 0.37) == 1 && solves(128, 0.0) == 1 && solves(128, 0.37) == 0);
}
END_OF_C
gcc indefinite.c -o indefinite -lcholmod -lm
./indefinite
