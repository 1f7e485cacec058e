#ifndef HB_BLAS_H
#define HB_BLAS_H

/* Makes OpenBLAS use one thread, unless OPENBLAS_NUM_THREADS, GOTO_NUM_THREADS or OMP_NUM_THREADS is set; no effect with another
 * library. */
void hb_use_one_blas_thread(void);

/* Makes OpenBLAS allocate its working memory: at its first call it would otherwise retry endlessly if a limit such as ulimit -v
 * does not permit it. Returns 0, or -1 if there is too little memory. */
int hb_allocate_blas_memory(void);

/* Returns the number of threads of OpenBLAS; 0 with another library. */
int hb_n_blas_threads(void);

#endif
