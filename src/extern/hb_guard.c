#define _GNU_SOURCE
#include "hb_guard.h"

#include "hb_crash.h"

#include <signal.h>
#include <string.h>
#include <unistd.h>

#define MAX_TEXT 1024
#define STACK_BYTES 65536

#ifdef __SANITIZE_ADDRESS__
static const int deadly[] = {0};
static const size_t n_deadly = 0;
#else
static const int deadly[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};
static const size_t n_deadly = sizeof deadly / sizeof deadly[0];
#endif

static char last_words[MAX_TEXT];
static size_t n_last_words = 0;
static int last_status = 1;
static struct sigaction before[sizeof deadly / sizeof deadly[0]];
static stack_t stack_before;
static int has_spare_stack = 0;
static int is_raised = 0;
static char spare_stack[STACK_BYTES]; /* a library that ran out of stack leaves none for the handler */

/* Calls nothing but what POSIX allows in a handler. */
static void on_death(int number)
{
   const ssize_t n_written = write(STDERR_FILENO, last_words, n_last_words);
   (void)n_written;
   (void)hb_note_signal(number);
   _exit(last_status);
}

/* Gives the first n signals their handlers, and handlers their stack. */
static void put_back(size_t n)
{
   while (n-- > 0) (void)sigaction(deadly[n], &before[n], NULL);
   if (has_spare_stack) (void)sigaltstack(&stack_before, NULL);
   is_raised = 0;
}

int hb_raise_guard(const char *text, int exit_status)
{
   n_last_words = strnlen(text, MAX_TEXT);
   memcpy(last_words, text, n_last_words);
   last_status = exit_status;
   if (is_raised) return 0;

   const stack_t stack = {.ss_sp = spare_stack, .ss_size = STACK_BYTES, .ss_flags = 0};
   has_spare_stack = sigaltstack(&stack, &stack_before) == 0;
   struct sigaction action;
   memset(&action, 0, sizeof action);
   action.sa_handler = on_death;
   action.sa_flags = has_spare_stack ? SA_ONSTACK : 0;
   sigfillset(&action.sa_mask);
   is_raised = 1;
   for (size_t i = 0; i < n_deadly; i++) {
      if (sigaction(deadly[i], &action, &before[i]) == 0) continue;
      put_back(i);
      return -1;
   }
   return 0;
}

void hb_lower_guard(void)
{
   if (is_raised) put_back(n_deadly);
}
