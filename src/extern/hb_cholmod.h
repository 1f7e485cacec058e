/* CHOLMOD of SuiteSparse as three calls on arrays: the supernodal factor of a sparse, symmetric, positive definite matrix, and
   solutions of many right sides at once. Built with HB_WITHOUT_CHOLMOD there is none, and hb_cholmod_new makes nothing. */
#ifndef HB_CHOLMOD_H
#define HB_CHOLMOD_H

typedef struct hb_cholmod_t hb_cholmod_t;

int hb_has_cholmod(void);

/* Factorises a matrix of order n, all of its entries by rows from 0. Null if it is not positive definite, or out of memory. */
hb_cholmod_t *hb_cholmod_new(int n, const int *first, const int *column, const double *value);

/* Overwrites b, n_columns columns of n numbers, with the solutions. Returns 0, or another value out of memory. */
int hb_cholmod_solve(hb_cholmod_t *self, int n_columns, double *b);

/* Memory of the factor in bytes. */
double hb_cholmod_bytes(const hb_cholmod_t *self);

void hb_cholmod_delete(hb_cholmod_t *self);

#endif
