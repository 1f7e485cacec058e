#ifndef HB_BLAS_H
#define HB_BLAS_H

/* Has OpenBLAS work with one thread, unless OPENBLAS_NUM_THREADS, GOTO_NUM_THREADS or OMP_NUM_THREADS is set; nothing happens
 * with another library. */
void hb_use_one_blas_thread(void);

/* Has OpenBLAS take the memory that it works in: at its first call it would ask for it again and again where a limit such as
 * ulimit -v does not allow for it. Returns 0, or -1 where there is too little. */
int hb_take_blas_memory(void);

/* Threads that OpenBLAS works with; 0 with another library. */
int hb_n_blas_threads(void);

#endif
