#ifndef HB_BLAS_H
#define HB_BLAS_H

/* Makes OpenBLAS, MKL or BLIS use one thread, or the number in the environment variable NHBM_BLAS_THREADS; no effect with another
 * library. Variables of BLAS itself, such as OMP_NUM_THREADS, which batch systems export, have no influence. */
void hb_limit_blas_threads(void);

/* The same for a library within a program that may use the same BLAS: returns the number of threads before. */
int hb_borrow_blas(void);

/* Restores the number of threads that hb_borrow_blas has returned. */
void hb_return_blas(int n_before);

/* Makes OpenBLAS allocate its working memory: at its first call it would otherwise retry endlessly if a limit such as ulimit -v
 * does not permit it. Returns 0, or -1 if there is too little memory. */
int hb_allocate_blas_memory(void);

/* Returns the number of threads of OpenBLAS, MKL or BLIS; 0 with another library. */
int hb_n_blas_threads(void);

#endif
