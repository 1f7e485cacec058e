/* Time and memory of the process of the fuzz driver, and a limit of its memory. */
#define _POSIX_C_SOURCE 200809L
#include <sys/resource.h>
#include <time.h>

/* Largest resident memory so far [kiB]. */
long fuzz_peak_memory(void)
{
   struct rusage usage;

   return getrusage(RUSAGE_SELF, &usage) == 0 ? usage.ru_maxrss : -1;
}

/* Time that the processor has spent on this process [s]. */
double fuzz_processor_time(void)
{
   struct timespec now;

   return clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now) == 0 ? (double)now.tv_sec + 1e-9*(double)now.tv_nsec : -1.0;
}
