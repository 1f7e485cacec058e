#ifndef HB_BLAS_H
#define HB_BLAS_H

/* Has OpenBLAS work with one thread, unless OPENBLAS_NUM_THREADS, GOTO_NUM_THREADS or OMP_NUM_THREADS is set; nothing happens
 * with another library. */
void hb_use_one_blas_thread(void);

/* Threads that OpenBLAS works with; 0 with another library. */
int hb_n_blas_threads(void);

#endif
