#define _GNU_SOURCE
#include "hb_guard.h"

#include <signal.h>
#include <string.h>
#include <unistd.h>

#define MAX_TEXT 1024
#define STACK_BYTES 65536

static const int deadly[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};
#define N_DEADLY (sizeof deadly / sizeof deadly[0])

static char last_words[MAX_TEXT];
static size_t n_last_words = 0;
static int last_status = 1;
static struct sigaction before[N_DEADLY];
static int is_raised = 0;
static char spare_stack[STACK_BYTES]; /* a library that ran out of stack leaves none for the handler */

/* Calls nothing but what POSIX allows in a handler. */
static void on_death(int number)
{
   (void)number;
   if (write(STDERR_FILENO, last_words, n_last_words) < 0) _exit(last_status);
   _exit(last_status);
}

int hb_raise_guard(const char *text, int exit_status)
{
   n_last_words = strnlen(text, MAX_TEXT);
   memcpy(last_words, text, n_last_words);
   last_status = exit_status;
   if (is_raised) return 0;

   const stack_t stack = {.ss_sp = spare_stack, .ss_size = STACK_BYTES, .ss_flags = 0};
   struct sigaction action;
   memset(&action, 0, sizeof action);
   action.sa_handler = on_death;
   action.sa_flags = sigaltstack(&stack, NULL) == 0 ? SA_ONSTACK : 0;
   sigfillset(&action.sa_mask);
   for (size_t i = 0; i < N_DEADLY; i++)
      if (sigaction(deadly[i], &action, &before[i]) != 0) return -1;
   is_raised = 1;
   return 0;
}

void hb_lower_guard(void)
{
   if (!is_raised) return;
   for (size_t i = 0; i < N_DEADLY; i++)
      (void)sigaction(deadly[i], &before[i], NULL);
   is_raised = 0;
}
