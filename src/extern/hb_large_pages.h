/* Memory in large pages. Source: madvise(2) of Linux; elsewhere nothing is done. */
#ifndef HB_LARGE_PAGES_H
#define HB_LARGE_PAGES_H

#include <stddef.h>

/* Lets the system use large pages for memory that has not been touched yet: less time to clear and to find them. */
void hb_prefer_large_pages(void *memory, size_t n_bytes);

#endif
