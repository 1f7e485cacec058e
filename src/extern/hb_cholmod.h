/* Cholesky factors of large sparse matrices by CHOLMOD of SuiteSparse (Chen, Davis, Hager, Rajamanickam, ACM Trans. Math. Softw. 35
 * (2008)): supernodal, ordered by AMD or METIS, whichever fills in less. In the order of use: factorise, solve as often as wanted,
 * destroy. */
#ifndef HB_CHOLMOD_H
#define HB_CHOLMOD_H

#include <stdint.h>

typedef struct hb_cholesky hb_cholesky_t;

enum { hb_cholesky_good = 0, hb_cholesky_not_definite = 1, hb_cholesky_no_memory = 2 };

/* Factorises a symmetric matrix of order n given by the columns of its lower triangle: column j has the entries first[j] to
 * first[j + 1] - 1, with rows ascending, all from 0. Returns one of the numbers above; *factors is null unless it is good, and
 * *bytes what the factors take, or would take where that is more than most_bytes. */
int hb_cholesky_factorise(int64_t n, int64_t *first, int64_t *row, double *value, double most_bytes, hb_cholesky_t **factors,
                          double *bytes);

/* Solves A X = B for n_rhs columns, each of n numbers one after the other. Returns hb_cholesky_good, or hb_cholesky_no_memory. */
int hb_cholesky_solve(hb_cholesky_t *factors, int64_t n_rhs, double *b, double *x);

/* Gives all memory back; a null pointer is fine. */
void hb_cholesky_destroy(hb_cholesky_t *factors);

#endif
