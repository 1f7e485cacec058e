#include "hb_cholmod.h"

#include <cholmod.h>
#include <stdlib.h>
#include <string.h>

struct hb_cholesky {
   cholmod_common common;
   cholmod_factor *factor;
   cholmod_dense *y, *e; /* kept from solution to solution */
};

int hb_cholesky_factorise(int64_t n, int64_t *first, int64_t *row, double *value, double most_bytes, hb_cholesky_t **factors,
                          double *bytes)
{
   hb_cholesky_t *const self = calloc(1, sizeof *self);
   cholmod_sparse matrix;
   int status;

   *factors = NULL;
   *bytes = 0.0;
   if (self == NULL) return hb_cholesky_no_memory;
   memset(&matrix, 0, sizeof matrix);
   matrix.nrow = matrix.ncol = (size_t)n;
   matrix.nzmax = (size_t)first[n];
   matrix.p = first;
   matrix.i = row;
   matrix.x = value;
   matrix.stype = -1; /* the lower triangle is stored */
   matrix.itype = CHOLMOD_LONG;
   matrix.xtype = CHOLMOD_REAL;
   matrix.dtype = CHOLMOD_DOUBLE;
   matrix.sorted = 1;
   matrix.packed = 1;

   cholmod_l_start(&self->common);
   self->common.print = 0;
   self->common.final_ll = 1;
   self->factor = cholmod_l_analyze(&matrix, &self->common);
   if (self->factor != NULL) {
      *bytes = self->common.lnz * (double)(sizeof *value);
      if (*bytes <= most_bytes) cholmod_l_factorize(&matrix, self->factor, &self->common);
   }
   status = hb_cholesky_good;
   if (self->factor == NULL || *bytes > most_bytes || self->common.status < CHOLMOD_OK) {
      status = hb_cholesky_no_memory;
   } else if (self->common.status == CHOLMOD_NOT_POSDEF || self->factor->minor < self->factor->n) {
      status = hb_cholesky_not_definite;
   }
   if (status != hb_cholesky_good) {
      hb_cholesky_destroy(self);
      return status;
   }
   *bytes = (double)self->common.memory_inuse;
   *factors = self;
   return hb_cholesky_good;
}

int hb_cholesky_solve(hb_cholesky_t *self, int64_t n_rhs, double *b, double *x)
{
   const size_t n = self->factor->n;
   cholmod_dense right, *left = NULL;

   memset(&right, 0, sizeof right);
   right.nrow = n;
   right.ncol = (size_t)n_rhs;
   right.nzmax = n * (size_t)n_rhs;
   right.d = n;
   right.x = b;
   right.xtype = CHOLMOD_REAL;
   right.dtype = CHOLMOD_DOUBLE;
   if (!cholmod_l_solve2(CHOLMOD_A, self->factor, &right, NULL, &left, NULL, &self->y, &self->e, &self->common))
      return hb_cholesky_no_memory;
   memcpy(x, left->x, n * (size_t)n_rhs * sizeof *x);
   cholmod_l_free_dense(&left, &self->common);
   return hb_cholesky_good;
}

void hb_cholesky_destroy(hb_cholesky_t *self)
{
   if (self == NULL) return;
   cholmod_l_free_dense(&self->y, &self->common);
   cholmod_l_free_dense(&self->e, &self->common);
   cholmod_l_free_factor(&self->factor, &self->common);
   cholmod_l_finish(&self->common);
   free(self);
}
