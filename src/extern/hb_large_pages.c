#ifdef __linux__
#define _DEFAULT_SOURCE
#endif
#include "hb_large_pages.h"

#ifdef __linux__
#include <stdint.h>
#include <sys/mman.h>
#include <unistd.h>
#endif

void hb_prefer_large_pages(void *memory, size_t n_bytes)
{
#if defined(__linux__) && defined(MADV_HUGEPAGE)
   const uintptr_t page = (uintptr_t)sysconf(_SC_PAGESIZE);
   const uintptr_t first = ((uintptr_t)memory + page - 1) & ~(page - 1);
   const uintptr_t end = ((uintptr_t)memory + n_bytes) & ~(page - 1);
   if (end > first)
      (void)madvise((void *)first, end - first, MADV_HUGEPAGE);
#else
   (void)memory;
   (void)n_bytes;
#endif
}
