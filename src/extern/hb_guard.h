/* A guard around calls of libraries that die of damaged files: the process still ends, but with a message and an exit
   status. Source: POSIX.1-2017, sigaction, sigaltstack. */
#ifndef HB_GUARD_H
#define HB_GUARD_H

/* From here on, should this process receive SIGSEGV, SIGBUS, SIGFPE, SIGILL or SIGABRT, it writes `text` to standard error and
   ends at once with `exit_status`. Returns 0, or -1 where a handler cannot be set. With the address sanitizer, signals are left
   to that. A point that hb_crash.h watches at that moment is noted as crashed before. */
int hb_raise_guard(const char *text, int exit_status);

/* Gives these signals the handlers that they had before, and these their stack: what was set in between is undone. */
void hb_lower_guard(void);

#endif
