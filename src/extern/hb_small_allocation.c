/* Small allocations of a program that fail end it with a message: compiled Fortran does not test those of assignments. Large ones
   return NULL, for which `stat` and messages exist. Linked into programs with --wrap of the linker, which renames the functions of
   their own code alone. */
#include <stdint.h>
#include <stdlib.h>
#include <unistd.h>

void *__real_malloc(size_t size);
void *__real_calloc(size_t count, size_t size);
void *__real_realloc(void *old, size_t size);
void *__wrap_malloc(size_t size);
void *__wrap_calloc(size_t count, size_t size);
void *__wrap_realloc(void *old, size_t size);

enum { small = 1048576, bad_input = 2 };                  /* bytes; status as of exit_status.f90 */

static void *checked(void *memory, size_t size)
{
   static const char text[] = "nhbm: there is not enough memory\n";
   if (memory != NULL || size == 0 || size > small) return memory;
   const ssize_t n_written = write(STDERR_FILENO, text, sizeof text - 1);
   (void)n_written;
   _exit(bad_input);
}

void *__wrap_malloc(size_t size)
{
   return checked(__real_malloc(size), size);
}

void *__wrap_calloc(size_t count, size_t size)
{
   return checked(__real_calloc(count, size), size > 0 && count > SIZE_MAX / size ? SIZE_MAX : count * size);
}

void *__wrap_realloc(void *old, size_t size)
{
   return checked(__real_realloc(old, size), size);
}
