#include "hb_heap.h"

#include <stdlib.h>
#ifdef __GLIBC__
#include <malloc.h>
#endif

/* Source of the numbers: glibc, malloc.h. */
void hb_retain_freed_memory(int n_mebibytes)
{
#ifdef __GLIBC__
   enum { mebibyte = 1048576 };
   (void)mallopt(M_TRIM_THRESHOLD, n_mebibytes * mebibyte);
   (void)mallopt(M_MMAP_THRESHOLD, 32 * mebibyte);
#else
   (void)n_mebibytes;
#endif
}
