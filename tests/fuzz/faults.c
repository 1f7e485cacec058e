/* Faults on demand, for LD_PRELOAD (Linux). FAULT_CALL names the calls that are counted, each rank its own; FAULT_AT, from 1, is the
   one at which the fault happens. FAULT_RANK names the rank that has it, of a run under mpirun; without, all have.
   clock   a look at the wall clock, as the cancellation of a run takes it before each step: the process gets the signal FAULT_NUMBER
   write   a write to a file whose name contains FAULT_FILE: this one and all later ones fail with the error FAULT_NUMBER
   sync    likewise, of fsync and fdatasync
   memory  an allocation of less than 64 kB by the program itself, not by a library (GNU C library): this one fails
   FAULT_COUNT names a file for the number of calls, written at the end. */
#ifndef _GNU_SOURCE
#define _GNU_SOURCE
#endif
#include <dlfcn.h>
#include <errno.h>
#include <link.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/uio.h>
#include <unistd.h>

static uintptr_t program_begin, program_end;

static const char *call = "", *file, *count;
static long at, number, n_calls;

static long number_of(const char *name, long otherwise)
{
   const char *text = getenv(name);
   return text != NULL ? atol(text) : otherwise;
}

static int note_program(struct dl_phdr_info *info, size_t size, void *data)
{
   (void)size;
   (void)data;
   for (int i = 0; i < info->dlpi_phnum; i++) {
      const uintptr_t first = info->dlpi_addr + info->dlpi_phdr[i].p_vaddr;
      if (info->dlpi_phdr[i].p_type != PT_LOAD) continue;
      if (program_begin == 0 || first < program_begin) program_begin = first;
      if (first + info->dlpi_phdr[i].p_memsz > program_end) program_end = first + info->dlpi_phdr[i].p_memsz;
   }
   return 1;                                              /* the first object is the program */
}

__attribute__((constructor)) static void begin(void)
{
   dl_iterate_phdr(note_program, NULL);
   if (getenv("FAULT_CALL") != NULL) call = getenv("FAULT_CALL");
   file = getenv("FAULT_FILE");
   count = getenv("FAULT_COUNT");
   number = number_of("FAULT_NUMBER", 0);
   at = number_of("FAULT_AT", 0);
   const long rank = number_of("OMPI_COMM_WORLD_RANK", number_of("PMI_RANK", 0)); /* of Open MPI, of MPICH */
   if (getenv("FAULT_RANK") != NULL && number_of("FAULT_RANK", 0) != rank) at = 0;
}

__attribute__((destructor)) static void end(void)
{
   FILE *out = count != NULL && n_calls > 0 ? fopen(count, "w") : NULL;
   if (out == NULL) return;
   fprintf(out, "%ld\n", n_calls);
   fclose(out);
}

static int fails(const char *name, int descriptor)
{
   char link[64], path[4096];
   if (file == NULL || strcmp(call, name) != 0) return 0;
   snprintf(link, sizeof link, "/proc/self/fd/%d", descriptor);
   const ssize_t length = readlink(link, path, sizeof path - 1);
   path[length > 0 ? length : 0] = '\0';
   if (strstr(path, file) == NULL) return 0;
   n_calls++;
   if (at == 0 || n_calls < at) return 0;
   errno = (int)number;
   return 1;
}

/* The function of the name, of the library that has it. */
#define REAL(type, name, ...)                                           \
   static type (*real)(__VA_ARGS__) = NULL;                             \
   if (real == NULL) *(void **)&real = dlsym(RTLD_NEXT, #name)

void _gfortran_system_clock_8(int64_t *ticks, int64_t *rate, int64_t *most)
{
   REAL(void, _gfortran_system_clock_8, int64_t *, int64_t *, int64_t *);
   real(ticks, rate, most);
   if (strcmp(call, "clock") == 0 && ++n_calls == at) raise((int)number);
}

ssize_t write(int descriptor, const void *bytes, size_t n)
{
   REAL(ssize_t, write, int, const void *, size_t);
   return fails("write", descriptor) ? -1 : real(descriptor, bytes, n);
}

ssize_t pwrite(int descriptor, const void *bytes, size_t n, off_t place)
{
   REAL(ssize_t, pwrite, int, const void *, size_t, off_t);
   return fails("write", descriptor) ? -1 : real(descriptor, bytes, n, place);
}

ssize_t pwrite64(int descriptor, const void *bytes, size_t n, off64_t place)
{
   REAL(ssize_t, pwrite64, int, const void *, size_t, off64_t);
   return fails("write", descriptor) ? -1 : real(descriptor, bytes, n, place);
}

ssize_t writev(int descriptor, const struct iovec *parts, int n)
{
   REAL(ssize_t, writev, int, const struct iovec *, int);
   return fails("write", descriptor) ? -1 : real(descriptor, parts, n);
}

ssize_t pwritev(int descriptor, const struct iovec *parts, int n, off_t place)
{
   REAL(ssize_t, pwritev, int, const struct iovec *, int, off_t);
   return fails("write", descriptor) ? -1 : real(descriptor, parts, n, place);
}

int fsync(int descriptor)
{
   REAL(int, fsync, int);
   return fails("sync", descriptor) ? -1 : real(descriptor);
}

int fdatasync(int descriptor)
{
   REAL(int, fdatasync, int);
   return fails("sync", descriptor) ? -1 : real(descriptor);
}

void *__libc_malloc(size_t size);
void *__libc_calloc(size_t number, size_t size);
void *__libc_realloc(void *old, size_t size);

static int lacks_memory(size_t size, const void *caller)
{
   enum { small = 65536 };
   const uintptr_t from = (uintptr_t)caller;
   if (size >= small || from < program_begin || from >= program_end || strcmp(call, "memory") != 0) return 0;
   return ++n_calls == at;
}

void *malloc(size_t size)
{
   return lacks_memory(size, __builtin_return_address(0)) ? NULL : __libc_malloc(size);
}

void *calloc(size_t n, size_t size)
{
   return lacks_memory(n * size, __builtin_return_address(0)) ? NULL : __libc_calloc(n, size);
}

void *realloc(void *old, size_t size)
{
   return lacks_memory(size, __builtin_return_address(0)) ? NULL : __libc_realloc(old, size);
}
