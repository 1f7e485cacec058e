/* CHOLMOD of SuiteSparse as calls on arrays: the supernodal factor of a sparse, symmetric, positive definite matrix, and
   solutions of many right sides at once. Built with HB_WITHOUT_CHOLMOD there is none, and hb_cholmod_new makes nothing. */
#ifndef HB_CHOLMOD_H
#define HB_CHOLMOD_H

typedef struct hb_cholmod_t hb_cholmod_t;

int hb_has_cholmod(void);

/* Factorises a matrix of order n, all of its entries by rows from 0. `at`, n_at unknowns from 0, are those of short solutions. Null if
   it is not positive definite, or out of memory. */
hb_cholmod_t *hb_cholmod_new(int n, const int *first, const int *column, const double *value, int n_at, const int *at);

/* Overwrites b, the n_columns right sides of the first unknown, of the second, ..., with the solutions. */
void hb_cholmod_solve(hb_cholmod_t *self, int n_columns, double *b);

/* Short solutions: likewise, where the other unknowns have no right sides, and their solutions are not wanted. b has those of the
   n_at unknowns alone. */
void hb_cholmod_solve_at(hb_cholmod_t *self, int n_columns, double *b);

/* Memory of the factor in bytes. */
double hb_cholmod_bytes(const hb_cholmod_t *self);

void hb_cholmod_delete(hb_cholmod_t *self);

#endif
