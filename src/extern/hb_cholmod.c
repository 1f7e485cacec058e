/* Source: Y. Chen, T. A. Davis, W. W. Hager and S. Rajamanickam, ACM Trans. Math. Softw. 35 (2008) 22; user guide of CHOLMOD. */
#include "hb_cholmod.h"

#include <stddef.h>

#if defined(HB_WITHOUT_CHOLMOD) || !defined(__GNUC__) /* the panels below are vectors of GNU C, which Clang has, too */

int hb_has_cholmod(void) { return 0; }

hb_cholmod_t *hb_cholmod_new(int n, const int *first, const int *column, const double *value, int n_at, const int *at)
{
   (void)n;
   (void)first;
   (void)column;
   (void)value;
   (void)n_at;
   (void)at;
   return NULL;
}

void hb_cholmod_solve(hb_cholmod_t *self, int n_columns, double *b)
{
   (void)self;
   (void)n_columns;
   (void)b;
}

void hb_cholmod_solve_at(hb_cholmod_t *self, int n_columns, double *b)
{
   (void)self;
   (void)n_columns;
   (void)b;
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

enum {
   width = 16, /* right sides in a panel: the factor is read once for all of them */
   strip = 32  /* columns of a supernode whose triangle is solved at a time */
};

struct hb_cholmod_t {
   cholmod_common common;
   cholmod_factor *factor;
   int n, n_at;
   int *position;   /* of each unknown in the factor, (n) */
   int *at;         /* the unknowns of short solutions, (n_at) */
   char *is_needed; /* supernodes that these need, (nsuper) */
   double *panel;   /* memory of solutions, (n, width) */
   cholmod_dense *x, *y, *e; /* memory of solutions of one right side */
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

/* Positions of the unknowns, and the supernodes on the paths from some of them to the root of the elimination tree: forces on these
   unknowns alone, and their solutions, pass through no other. */
static int find_paths(hb_cholmod_t *self)
{
   const cholmod_factor *factor = self->factor;
   const int *super = factor->super, *first = factor->pi, *rows = factor->s, *order = factor->Perm;
   int *supernode = malloc((size_t)self->n * sizeof *supernode);

   self->position = malloc((size_t)self->n * sizeof *self->position);
   self->is_needed = calloc(factor->nsuper, sizeof *self->is_needed);
   self->panel = aligned_alloc(64, (size_t)self->n * width * sizeof *self->panel);
   if (supernode == NULL || self->position == NULL || self->is_needed == NULL || self->panel == NULL) {
      free(supernode);
      return -1;
   }
   for (int i = 0; i < self->n; i++) self->position[order[i]] = i;
   for (size_t s = 0; s < factor->nsuper; s++)
      for (int i = super[s]; i < super[s + 1]; i++) supernode[i] = (int)s;
   for (int i = 0; i < self->n_at; i++) self->is_needed[supernode[self->position[self->at[i]]]] = 1;
   for (size_t s = 0; s < factor->nsuper; s++) {
      int n = super[s + 1] - super[s];

      if (self->is_needed[s] && first[s + 1] - first[s] > n) self->is_needed[supernode[rows[first[s] + n]]] = 1;
   }
   free(supernode);
   return 0;
}

hb_cholmod_t *hb_cholmod_new(int n, const int *first, const int *column, const double *value, int n_at, const int *at)
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
   if (self->factor != NULL && self->common.status == CHOLMOD_OK && self->factor->minor == self->factor->n) {
      self->n = n;
      self->n_at = n_at;
      self->at = malloc(((size_t)n_at + 1) * sizeof *self->at);
      if (self->at != NULL) {
         memcpy(self->at, at, (size_t)n_at * sizeof *at);
         if (find_paths(self) == 0) return self;
      }
   }
   hb_cholmod_delete(self);
   return NULL;
}

/* Panels have the right sides of an unknown beside each other, and the kernels keep four rows of them in registers: by
   cholmod_solve, whose BLAS packs its operands for right sides that are few, a solution takes twice as long, with the generic kernels of
   OpenBLAS five times. Each function is compiled for several processors; the first call chooses. */
#if defined(__x86_64__) && defined(__GLIBC__) && !defined(__clang__) && !defined(__SANITIZE_ADDRESS__)
#define FOR_EACH_PROCESSOR __attribute__((target_clones("default", "avx2,fma", "arch=x86-64-v4")))
#else
#define FOR_EACH_PROCESSOR
#endif

typedef double half_t __attribute__((vector_size(64), may_alias)); /* half a row */

static half_t *row_of(double *panel, ptrdiff_t i) { return (half_t *)(panel + i * width); }

static const half_t *constant_row_of(const double *panel, ptrdiff_t i) { return (const half_t *)(panel + i * width); }

/* y(row) -= L x for n_rows rows of n columns of a supernode. */
FOR_EACH_PROCESSOR
static void subtract(ptrdiff_t n_rows, ptrdiff_t n, const double *l, ptrdiff_t ld, const double *x, const int *row, double *y)
{
   const half_t zero = {0};
   ptrdiff_t i = 0;

   for (; i + 4 <= n_rows; i += 4) {
      half_t a0 = zero, a1 = zero, a2 = zero, a3 = zero, b0 = zero, b1 = zero, b2 = zero, b3 = zero, *t;
      const half_t *u = constant_row_of(x, 0);
      const double *c = l + i;

      for (ptrdiff_t j = 0; j < n; j++, c += ld, u += 2) {
         const half_t a = u[0], b = u[1];

         a0 += c[0] * a;
         b0 += c[0] * b;
         a1 += c[1] * a;
         b1 += c[1] * b;
         a2 += c[2] * a;
         b2 += c[2] * b;
         a3 += c[3] * a;
         b3 += c[3] * b;
      }
      t = row_of(y, row[i]);
      t[0] -= a0;
      t[1] -= b0;
      t = row_of(y, row[i + 1]);
      t[0] -= a1;
      t[1] -= b1;
      t = row_of(y, row[i + 2]);
      t[0] -= a2;
      t[1] -= b2;
      t = row_of(y, row[i + 3]);
      t[0] -= a3;
      t[1] -= b3;
   }
   for (; i < n_rows; i++) {
      half_t a = zero, b = zero, *t = row_of(y, row[i]);

      for (ptrdiff_t j = 0; j < n; j++) {
         const half_t *u = constant_row_of(x, j);

         a += l[i + j * ld] * u[0];
         b += l[i + j * ld] * u[1];
      }
      t[0] -= a;
      t[1] -= b;
   }
}

/* x -= L' y(row), likewise. */
FOR_EACH_PROCESSOR
static void subtract_transposed(ptrdiff_t n_rows, ptrdiff_t n, const double *l, ptrdiff_t ld, double *x, const int *row, const double *y)
{
   const half_t zero = {0};
   ptrdiff_t j = 0;

   for (; j + 4 <= n; j += 4) {
      half_t a0 = zero, a1 = zero, a2 = zero, a3 = zero, b0 = zero, b1 = zero, b2 = zero, b3 = zero, *t = row_of(x, j);
      const double *c0 = l + j * ld, *c1 = c0 + ld, *c2 = c1 + ld, *c3 = c2 + ld;

      for (ptrdiff_t i = 0; i < n_rows; i++) {
         const half_t *u = constant_row_of(y, row[i]);
         const half_t a = u[0], b = u[1];

         a0 += c0[i] * a;
         b0 += c0[i] * b;
         a1 += c1[i] * a;
         b1 += c1[i] * b;
         a2 += c2[i] * a;
         b2 += c2[i] * b;
         a3 += c3[i] * a;
         b3 += c3[i] * b;
      }
      t[0] -= a0;
      t[1] -= b0;
      t[2] -= a1;
      t[3] -= b1;
      t[4] -= a2;
      t[5] -= b2;
      t[6] -= a3;
      t[7] -= b3;
   }
   for (; j < n; j++) {
      half_t a = zero, b = zero, *t = row_of(x, j);

      for (ptrdiff_t i = 0; i < n_rows; i++) {
         const half_t *u = constant_row_of(y, row[i]);

         a += l[i + j * ld] * u[0];
         b += l[i + j * ld] * u[1];
      }
      t[0] -= a;
      t[1] -= b;
   }
}

/* x = L^-1 x for a triangle on the diagonal. */
FOR_EACH_PROCESSOR
static void solve_triangle(ptrdiff_t n, const double *l, ptrdiff_t ld, double *x)
{
   for (ptrdiff_t j = 0; j < n; j++, l += ld) {
      half_t *t = row_of(x, j);
      const half_t a = t[0] / l[j], b = t[1] / l[j];

      t[0] = a;
      t[1] = b;
      for (ptrdiff_t i = j + 1; i < n; i++) {
         half_t *u = row_of(x, i);

         u[0] -= l[i] * a;
         u[1] -= l[i] * b;
      }
   }
}

/* x = L'^-1 x, likewise. */
FOR_EACH_PROCESSOR
static void solve_triangle_transposed(ptrdiff_t n, const double *l, ptrdiff_t ld, double *x)
{
   for (ptrdiff_t j = n - 1; j >= 0; j--) {
      const double *c = l + j * ld;
      half_t *t = row_of(x, j), a = t[0], b = t[1];

      for (ptrdiff_t i = j + 1; i < n; i++) {
         const half_t *u = constant_row_of(x, i);

         a -= c[i] * u[0];
         b -= c[i] * u[1];
      }
      t[0] = a / c[j];
      t[1] = b / c[j];
   }
}

/* Solves for the panel, through all supernodes or through those that are needed. */
static void solve_panel(hb_cholmod_t *self, int is_short)
{
   const cholmod_factor *factor = self->factor;
   const int *super = factor->super, *first = factor->pi, *start = factor->px, *rows = factor->s;

   for (size_t s = 0; s < factor->nsuper; s++) {
      ptrdiff_t n = super[s + 1] - super[s], ld = first[s + 1] - first[s];
      double *x = self->panel + (ptrdiff_t)super[s] * width;

      if (is_short && !self->is_needed[s]) continue;
      for (ptrdiff_t j = 0; j < n; j += strip) {
         ptrdiff_t m = n - j < strip ? n - j : strip;
         const double *l = (const double *)factor->x + start[s] + j * ld + j;

         solve_triangle(m, l, ld, x + j * width);
         subtract(ld - j - m, m, l + m, ld, x + j * width, rows + first[s] + j + m, self->panel);
      }
   }
   for (size_t s = factor->nsuper; s-- > 0;) {
      ptrdiff_t n = super[s + 1] - super[s], ld = first[s + 1] - first[s];
      double *x = self->panel + (ptrdiff_t)super[s] * width;

      if (is_short && !self->is_needed[s]) continue;
      for (ptrdiff_t j = (n - 1) / strip * strip; j >= 0; j -= strip) {
         ptrdiff_t m = n - j < strip ? n - j : strip;
         const double *l = (const double *)factor->x + start[s] + j * ld + j;

         subtract_transposed(ld - j - m, m, l + m, ld, x + j * width, rows + first[s] + j + m, self->panel);
         solve_triangle_transposed(m, l, ld, x + j * width);
      }
   }
}

/* Columns `from` to `from` + width of b, of which unknown i is b(i), to or from the panel. */
static void copy(hb_cholmod_t *self, int is_short, int n_columns, int from, double *b, int is_back)
{
   int n = is_short ? self->n_at : self->n;
   size_t m = (size_t)(n_columns - from < width ? n_columns - from : width);

   for (int i = 0; i < n; i++) {
      double *x = self->panel + (size_t)self->position[is_short ? self->at[i] : i] * width;
      double *y = b + (size_t)i * (size_t)n_columns + from;

      if (is_back)
         memcpy(y, x, m * sizeof *x);
      else
         memcpy(x, y, m * sizeof *x);
   }
}

static void solve(hb_cholmod_t *self, int is_short, int n_columns, double *b)
{
   for (int from = 0; from < n_columns; from += width) {
      memset(self->panel, 0, (size_t)self->n * width * sizeof *self->panel);
      copy(self, is_short, n_columns, from, b, 0);
      solve_panel(self, is_short);
      copy(self, is_short, n_columns, from, b, 1);
   }
}

/* A panel is as slow for one right side as for sixteen: one alone is solved by cholmod_solve2. */
static int solve_one(hb_cholmod_t *self, double *b)
{
   cholmod_dense right;

   memset(&right, 0, sizeof right);
   right.nrow = right.nzmax = right.d = (size_t)self->n;
   right.ncol = 1;
   right.x = b;
   right.xtype = CHOLMOD_REAL;
   right.dtype = CHOLMOD_DOUBLE;
   if (!cholmod_solve2(CHOLMOD_A, self->factor, &right, NULL, &self->x, NULL, &self->y, &self->e, &self->common)) return 0;
   memcpy(b, self->x->x, (size_t)self->n * sizeof *b);
   return 1;
}

void hb_cholmod_solve(hb_cholmod_t *self, int n_columns, double *b)
{
   if (n_columns == 1 && solve_one(self, b)) return;
   solve(self, 0, n_columns, b);
}

void hb_cholmod_solve_at(hb_cholmod_t *self, int n_columns, double *b) { solve(self, 1, n_columns, b); }

double hb_cholmod_bytes(const hb_cholmod_t *self)
{
   return (double)self->factor->xsize * sizeof(double) + (double)self->factor->ssize * sizeof(int);
}

void hb_cholmod_delete(hb_cholmod_t *self)
{
   if (self == NULL) return;
   free(self->position);
   free(self->at);
   free(self->is_needed);
   free(self->panel);
   cholmod_free_dense(&self->x, &self->common);
   cholmod_free_dense(&self->y, &self->common);
   cholmod_free_dense(&self->e, &self->common);
   if (self->factor != NULL) cholmod_free_factor(&self->factor, &self->common);
   cholmod_finish(&self->common);
   free(self);
}

#endif
