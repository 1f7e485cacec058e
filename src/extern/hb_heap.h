/* Memory that the process has freed. Source: mallopt(3) of the GNU C library; other C libraries decide by themselves. */
#ifndef HB_HEAP_H
#define HB_HEAP_H

/* Lets this process retain so much freed memory, less than 2 GiB. */
void hb_retain_freed_memory(int n_mebibytes);

#endif
