#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* for syscall and strnlen */
#endif
#include "hb_process.h"

#include "hb_crash.h"

#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#ifdef __linux__
#include <sys/syscall.h>
#endif
#include <time.h>
#include <unistd.h>

#ifdef __APPLE__ /* has no quick_exit() */
#define at_quick_exit(function) 0
#endif

#define MAX_TEXT 1024

static const struct {
   int number;
   const char *name;
} ending[] = {{SIGINT, "SIGINT"}, {SIGTERM, "SIGTERM"}, {SIGUSR1, "SIGUSR1"}, {SIGUSR2, "SIGUSR2"}};
static const size_t n_ending = sizeof ending / sizeof ending[0];

static volatile sig_atomic_t caught = 0;
static volatile sig_atomic_t ends_at_once = 1;
static char unfinished[4096];
static char last_message[MAX_TEXT];
static size_t last_message_length = 0;
static int last_status = 1;
static double shortest_pause = 0.0; /* [s] between two signals that count as two */
static volatile double last_signal = 0.0;

static double seconds_now(void)
{
   struct timespec now;
   return clock_gettime(CLOCK_MONOTONIC, &now) == 0 ? (double)now.tv_sec + 1.0e-9 * (double)now.tv_nsec : 0.0;
}

/* Calls only what POSIX permits in a handler. */
static void on_signal(int number)
{
   if (ends_at_once) {
      static const char words[] = "nhbm: ended by a signal before there was a result\n";
      if (unfinished[0] != '\0') (void)unlink(unfinished);
      if (write(STDERR_FILENO, words, sizeof words - 1) < 0) hb_exit_at_once(last_status);
      hb_exit_at_once(last_status);
   }
   const double now = seconds_now();
   const int is_repeated = caught != 0 && now - last_signal < shortest_pause;
   last_signal = now;
   if (is_repeated) return;
   if (caught != 0) {
      if (write(STDERR_FILENO, last_message, last_message_length) < 0) hb_exit_at_once(last_status);
      hb_exit_at_once(last_status);
   }
   caught = number;
}

static int take_signals(void)
{
   struct sigaction action;
   memset(&action, 0, sizeof action);
   action.sa_handler = on_signal;
   action.sa_flags = SA_RESTART;
   sigfillset(&action.sa_mask);
   for (size_t i = 0; i < n_ending; i++)
      if (sigaction(ending[i].number, &action, NULL) != 0) return -1;
   return 0;
}

int hb_catch_signals(const char *text, int exit_status, double pause)
{
   shortest_pause = pause;
   last_message_length = strnlen(text, MAX_TEXT);
   memcpy(last_message, text, last_message_length);
   last_status = exit_status;

   return take_signals();
}

/* Once more, for MPICH takes SIGUSR1 after it has started, as the news that a process has died. */
void hb_wait_for_points(void)
{
   ends_at_once = 0;
   (void)take_signals();
}

void hb_note_unfinished(const char *path)
{
   const size_t length = strlen(path);
   unfinished[0] = '\0';
   if (length == 0 || length >= sizeof unfinished) return;
   memcpy(unfinished + 1, path + 1, length);
   unfinished[0] = path[0]; /* last: the name is complete now */
}

void hb_survive_failed_writes(void)
{
   struct sigaction action;
   memset(&action, 0, sizeof action);
   action.sa_handler = SIG_IGN;
   (void)sigaction(SIGPIPE, &action, NULL);
   (void)sigaction(SIGXFSZ, &action, NULL);
}

int hb_caught_signal(void)
{
   return (int)caught;
}

const char *hb_caught_signal_name(void)
{
   for (size_t i = 0; i < n_ending; i++)
      if (ending[i].number == caught) return ending[i].name;
   return "no signal";
}

static char exit_words[MAX_TEXT];
static int exit_status_of_others = 0; /* 0: exit() is permitted */
static pid_t this_process;

static void on_exit_by_others(void)
{
   if (exit_status_of_others == 0) return;
   (void)fflush(stdout);
   if (write(STDERR_FILENO, exit_words, strnlen(exit_words, MAX_TEXT)) < 0) hb_exit_at_once(exit_status_of_others);
   hb_exit_at_once(exit_status_of_others);
}

void hb_reject_exit(const char *text, int exit_status)
{
   strncpy(exit_words, text, MAX_TEXT - 1);
   this_process = getpid();
   if (atexit(on_exit_by_others) == 0 && at_quick_exit(on_exit_by_others) == 0) exit_status_of_others = exit_status;
}

void hb_exit_at_once(int exit_status)
{
#ifdef __linux__
   for (;;) (void)syscall(SYS_exit_group, exit_status);
#else
   _Exit(exit_status);
#endif
}

#ifdef __linux__
/* Takes the place of the C library's for all libraries of the process: called within a point by the code of a law, it would end
   the run without a word. Children of the process end as they wish. */
void _exit(int exit_status)
{
   if (exit_status_of_others == 0 || getpid() != this_process) hb_exit_at_once(exit_status);
   const int status_within_point = hb_end_within_point("_exit()");
   if (status_within_point != 0) hb_exit_at_once(status_within_point);
   on_exit_by_others();
   hb_exit_at_once(exit_status);
}

void _Exit(int exit_status)
{
   _exit(exit_status);
}
#endif

void hb_exit(int exit_status)
{
   exit_status_of_others = 0;
   exit(exit_status);
}

static int output_error = 0; /* errno of the first failure */

void hb_say(const char *line)
{
   /* at once: a log is read while the run goes on */
   if ((puts(line) == EOF || fflush(stdout) == EOF) && output_error == 0) output_error = errno;
}

int hb_finish_output(void)
{
   if (fflush(stdout) == EOF && output_error == 0) output_error = errno;
   return output_error == EPIPE ? 0 : output_error;
}

void hb_set_default(const char *name, const char *value)
{
   (void)setenv(name, value, 0);
}
