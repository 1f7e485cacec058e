/* Source: Y. Chen, T. A. Davis, W. W. Hager and S. Rajamanickam, ACM Trans. Math. Softw. 35 (2008) 22; user guide of CHOLMOD. */
#include "hb_cholmod.h"

#include <stddef.h>

#ifdef HB_WITHOUT_CHOLMOD

int hb_has_cholmod(void) { return 0; }

hb_cholmod_t *hb_cholmod_new(int n, const int *first, const int *column, const double *value)
{
   (void)n;
   (void)first;
   (void)column;
   (void)value;
   return NULL;
}

int hb_cholmod_solve(hb_cholmod_t *self, int n_columns, double *b)
{
   (void)self;
   (void)n_columns;
   (void)b;
   return -1;
}

double hb_cholmod_bytes(const hb_cholmod_t *self)
{
   (void)self;
   return 0.0;
}

void hb_cholmod_delete(hb_cholmod_t *self) { (void)self; }

#else

#include <cholmod.h>
#include <stdlib.h>
#include <string.h>

struct hb_cholmod_t {
   cholmod_common common;
   cholmod_factor *factor;
   cholmod_dense *x, *y, *e; /* memory of solutions, kept between them */
};

int hb_has_cholmod(void) { return 1; }

/* Supernodal factors: simplicial ones take three times as long for fifteen right sides. Of solids nested dissection has half the
   operations of AMD, which takes its place where the library was built without METIS. */
static void choose_method(cholmod_common *common, int ordering)
{
   common->print = 0;
   common->supernodal = CHOLMOD_SUPERNODAL;
   common->quick_return_if_not_posdef = 1;
   common->nmethods = 1;
   common->method[0].ordering = ordering;
   common->postorder = 1;
}

hb_cholmod_t *hb_cholmod_new(int n, const int *first, const int *column, const double *value)
{
   hb_cholmod_t *self = calloc(1, sizeof *self);
   cholmod_sparse matrix;

   if (self == NULL) return NULL;
   cholmod_start(&self->common);
   memset(&matrix, 0, sizeof matrix);
   matrix.nrow = matrix.ncol = (size_t)n;
   matrix.nzmax = (size_t)first[n];
   matrix.p = (void *)first; /* read only: the rows of a symmetric matrix are its columns */
   matrix.i = (void *)column;
   matrix.x = (void *)value;
   matrix.stype = 1; /* its upper triangle is read */
   matrix.itype = CHOLMOD_INT;
   matrix.xtype = CHOLMOD_REAL;
   matrix.dtype = CHOLMOD_DOUBLE;
   matrix.packed = 1;
   choose_method(&self->common, CHOLMOD_METIS);
   self->factor = cholmod_analyze(&matrix, &self->common);
   if (self->factor == NULL && self->common.status == CHOLMOD_NOT_INSTALLED) {
      self->common.status = CHOLMOD_OK;
      choose_method(&self->common, CHOLMOD_AMD);
      self->factor = cholmod_analyze(&matrix, &self->common);
   }
   if (self->factor != NULL) cholmod_factorize(&matrix, self->factor, &self->common);
   if (self->factor != NULL && self->common.status == CHOLMOD_OK && self->factor->minor == self->factor->n) return self;
   hb_cholmod_delete(self);
   return NULL;
}

int hb_cholmod_solve(hb_cholmod_t *self, int n_columns, double *b)
{
   cholmod_dense given;
   size_t n = self->factor->n, m = (size_t)n_columns;

   memset(&given, 0, sizeof given);
   given.nrow = given.d = n;
   given.ncol = m;
   given.nzmax = n * m;
   given.x = b;
   given.xtype = CHOLMOD_REAL;
   given.dtype = CHOLMOD_DOUBLE;
   if (!cholmod_solve2(CHOLMOD_A, self->factor, &given, NULL, &self->x, NULL, &self->y, &self->e, &self->common)) return -1;
   memcpy(b, self->x->x, n * m * sizeof *b);
   return 0;
}

double hb_cholmod_bytes(const hb_cholmod_t *self)
{
   return (double)self->factor->xsize * sizeof(double) + (double)self->factor->ssize * sizeof(int);
}

void hb_cholmod_delete(hb_cholmod_t *self)
{
   if (self == NULL) return;
   cholmod_free_dense(&self->x, &self->common);
   cholmod_free_dense(&self->y, &self->common);
   cholmod_free_dense(&self->e, &self->common);
   if (self->factor != NULL) cholmod_free_factor(&self->factor, &self->common);
   cholmod_finish(&self->common);
   free(self);
}

#endif
