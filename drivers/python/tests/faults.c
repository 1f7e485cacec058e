/* Preloaded into a process: from when it is armed, one of the calls by which it changes files in a folder fails, or never returns.
   Source: POSIX.1-2017; dlsym(3) with RTLD_NEXT of GNU. */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE
#endif
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static int calls_left = 0;  /* until the one that fails; 0: not armed */
static int error_number = 0; /* 0: it waits for ever */
static char folder[4096];

void fault_arm(int calls, int number, const char *path)
{
   strncpy(folder, path, sizeof folder - 1);
   error_number = number;
   calls_left = calls;
}

__attribute__((constructor)) static void arm_by_environment(void)
{
   const char *calls = getenv("FAULT_CALLS"), *path = getenv("FAULT_FOLDER");
   if (calls != NULL && path != NULL) fault_arm(atoi(calls), 0, path);
}

/* Whether this call is the one. */
static int strikes(const char *path)
{
   if (calls_left == 0 || strncmp(path, folder, strlen(folder)) != 0) return 0;
   if (--calls_left > 0) return 0;
   if (error_number == 0)
      for (;;) pause();
   errno = error_number;
   return 1;
}

static int strikes_open(int descriptor)
{
   char link[64], path[4096];
   const int saved = errno;
   if (calls_left == 0) return 0;
   snprintf(link, sizeof link, "/proc/self/fd/%d", descriptor);
   const ssize_t n = readlink(link, path, sizeof path - 1);
   if (n < 0) {
      errno = saved;
      return 0;
   }
   path[n] = '\0';
   errno = saved;
   return strikes(path);
}

#define NEXT(name) ((__typeof__(&name))dlsym(RTLD_NEXT, #name))

ssize_t write(int d, const void *b, size_t n) { return strikes_open(d) ? -1 : NEXT(write)(d, b, n); }
ssize_t pwrite(int d, const void *b, size_t n, off_t at) { return strikes_open(d) ? -1 : NEXT(pwrite)(d, b, n, at); }
ssize_t pwrite64(int d, const void *b, size_t n, off64_t at) { return strikes_open(d) ? -1 : NEXT(pwrite64)(d, b, n, at); }
int ftruncate(int d, off_t n) { return strikes_open(d) ? -1 : NEXT(ftruncate)(d, n); }
int ftruncate64(int d, off64_t n) { return strikes_open(d) ? -1 : NEXT(ftruncate64)(d, n); }
int fsync(int d) { return strikes_open(d) ? -1 : NEXT(fsync)(d); }
int rename(const char *from, const char *to) { return strikes(from) ? -1 : NEXT(rename)(from, to); }
