#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* for sigaltstack and strnlen */
#endif
#include "hb_crash.h"

#include "hb_process.h"

#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/time.h>
#include <unistd.h>

#ifdef __APPLE__ /* has no quick_exit() */
#define at_quick_exit(function) 0
#endif

#define MAX_TEXT 512
#define MAX_LAST_MESSAGE 1024
#define MAX_ENTRY 128
#define STACK_SIZE 65536 /* for the handler, in case of a stack overflow */

typedef struct {
   int number;
   const char *cause;
} crash_t;

#ifdef __SANITIZE_ADDRESS__
static const crash_t crashes[] = {{0, NULL}};
static const size_t n_crashes = 0;
#else
static const crash_t crashes[] = {
   {SIGSEGV, "SIGSEGV (a forbidden address, or the end of the stack)"},
   {SIGBUS, "SIGBUS (an address that does not exist)"},
   {SIGFPE, "SIGFPE (a forbidden operation with numbers)"},
   {SIGILL, "SIGILL (a forbidden instruction)"},
   {SIGABRT, "SIGABRT (abort)"},
};
static const size_t n_crashes = sizeof crashes / sizeof crashes[0];
#endif

static atomic_llong row_under_way = -1;
static pthread_t solver; /* thread that solves it */
static hb_crash_location_t location;
static int descriptor = -1;
static pid_t watched_process;

static int is_protected = 0;
static char last_message[MAX_LAST_MESSAGE];
static size_t last_message_length = 0;
static char last_entry[MAX_ENTRY];
static size_t n_last_entry = 0;
static int last_status = 1;
static int has_limit = 0;
static struct sigaction before_limit;
static int has_less_memory = 0;
static struct rlimit memory_before;

static int is_caught = 0;
static struct sigaction before[sizeof crashes / sizeof crashes[0]];
static int has_stack = 0;
static stack_t stack_before;
static char handler_stack[STACK_SIZE];

/* The following functions call only what POSIX permits in a handler. */

static size_t append(char *text, size_t length, const char *words)
{
   while (*words != '\0' && length < MAX_TEXT) text[length++] = *words++;
   return length;
}

static size_t append_number(char *text, size_t length, long long number)
{
   char digits[24];
   size_t first = sizeof digits - 1;
   digits[first] = '\0';
   do {
      digits[--first] = (char)('0' + number % 10);
      number /= 10;
   } while (number > 0 && first > 0);
   return append(text, length, digits + first);
}

static int put(const void *bytes, size_t n_bytes, long long offset)
{
   return pwrite(descriptor, bytes, n_bytes, (off_t)offset) == (ssize_t)n_bytes;
}

/* Writes message and status of a point, the status last. */
static int put_row(long long row, const char *cause)
{
   if (location.message_offset >= 0) {
      char message[MAX_TEXT] = {0};
      size_t length = append(message, 0, "the process was ended by ");
      length = append(message, length, cause);
      append(message, length, " while this point was solved");
      if (!put(message, (size_t)location.message_length, location.message_offset + row * location.message_length)) return 0;
   }
   const unsigned value = (unsigned)location.status;
   const unsigned char bytes[4] = {(unsigned char)value, (unsigned char)(value >> 8), (unsigned char)(value >> 16),
                                   (unsigned char)(value >> 24)};
   return put(bytes, sizeof bytes, location.status_offset + row * (long long)sizeof bytes);
}

/* Records and reports that the present point has crashed; returns 0 if there is none. After a signal that ends the run nothing is
   recorded: mpirun, or its library within this process, may end it in any way, and the point remains to be solved. */
static int note_crash(const char *cause)
{
   if (getpid() != watched_process) return 0; /* a child process created by the code of a law */
   const long long row = atomic_exchange(&row_under_way, -1);
   if (row < 0) return 0;
   if (hb_caught_signal() != 0) return 1;
   const int is_noted = put_row(row, cause);
   char line[MAX_TEXT];
   size_t length = append(line, 0, "nhbm: point ");
   length = append_number(line, length, row);
   length = append(line, length, " has ended the process by ");
   length = append(line, length, cause);
   length = append(line, length, is_noted ? "; its status is crashed, and nhbm resume solves the others\n"
                                          : "; this could not be noted in the result file\n");
   return write(STDERR_FILENO, line, length) < 0 ? -1 : 1;
}

static void write_last_message(const char *more)
{
   char line[MAX_LAST_MESSAGE + MAX_ENTRY + MAX_TEXT];
   memcpy(line, last_message, last_message_length);
   size_t length = last_message_length;
   if (n_last_entry > 0) {
      memcpy(line + length, ", at '", 6);
      memcpy(line + length + 6, last_entry, n_last_entry);
      line[length + 6 + n_last_entry] = '\'';
      length += 7 + n_last_entry;
   }
   while (*more != '\0') line[length++] = *more++;
   line[length++] = '\n';
   const ssize_t n_written = write(STDERR_FILENO, line, length);
   (void)n_written;
}

static void on_limit(int number)
{
   (void)number;
   if (!is_protected) return;
   write_last_message("; the time limit was reached");
   (void)note_crash("SIGVTALRM (time limit reached)");
   hb_exit_at_once(last_status);
}

static void on_crash(int number, siginfo_t *information, void *context)
{
   (void)context;
   size_t i = 0;
   while (i < n_crashes && crashes[i].number != number) i++;
   if (is_protected) write_last_message("");
   if (i < n_crashes) (void)note_crash(crashes[i].cause);
   if (is_protected) hb_exit_at_once(last_status);
   if (i < n_crashes) sigaction(number, &before[i], NULL);
   if (information->si_code <= 0) raise(number); /* it was sent; a fault occurs again after the return */
}

int hb_end_within_point(const char *cause)
{
   /* A thread of MPI ends the process when mpirun has ended, by whatever signal: the point is not to blame. */
   if (!pthread_equal(pthread_self(), solver) && getpid() == watched_process && atomic_exchange(&row_under_way, -1) >= 0) {
      static const char words[] = "nhbm: a library has ended the process; its point remains to be solved by nhbm resume\n";
      return write(STDERR_FILENO, words, sizeof words - 1) < 0 ? 1 : location.exit_status;
   }
   return note_crash(cause) != 0 ? location.exit_status : 0;
}

/* Prevents exit handlers of other libraries, some of which would wait for other ranks. */
static void on_exit_of_process(void)
{
   const int status = hb_end_within_point("exit()");
   if (status != 0) hb_exit_at_once(status);
}

/* The following functions are not called in a handler. */

/* Restores the previous handlers of the first n signals. */
static void put_back(size_t n)
{
   while (n-- > 0) (void)sigaction(crashes[n].number, &before[n], NULL);
   if (has_stack) (void)sigaltstack(&stack_before, NULL);
   is_caught = 0;
}

/* Catches all crashes, also if other handlers were installed in the meantime. */
static int catch_crashes(void)
{
   if (!is_caught) {
      const stack_t stack = {.ss_sp = handler_stack, .ss_size = STACK_SIZE, .ss_flags = 0};
      has_stack = sigaltstack(&stack, &stack_before) == 0;
   }
   struct sigaction action;
   memset(&action, 0, sizeof action);
   action.sa_sigaction = on_crash;
   action.sa_flags = SA_SIGINFO | (has_stack ? SA_ONSTACK : 0);
   sigfillset(&action.sa_mask);
   for (size_t i = 0; i < n_crashes; i++) {
      if (sigaction(crashes[i].number, &action, is_caught ? NULL : &before[i]) == 0) continue;
      put_back(is_caught ? n_crashes : i);
      return -1;
   }
   is_caught = 1;
   return 0;
}

/* Removes handlers that are no longer needed. */
static void let_go(void)
{
   if (!is_caught) return;
   if (is_protected || descriptor >= 0)
      (void)catch_crashes();
   else
      put_back(n_crashes);
}

/* Requests a signal after some seconds of processor time. */
static int set_limit(double seconds)
{
   const time_t whole = (time_t)seconds;
   const struct itimerval timer = {.it_value = {.tv_sec = whole, .tv_usec = (suseconds_t)(1.0e6 * (seconds - (double)whole))}};
   struct sigaction action;
   memset(&action, 0, sizeof action);
   action.sa_handler = on_limit;
   action.sa_flags = has_stack ? SA_ONSTACK : 0;
   sigfillset(&action.sa_mask);
   if (sigaction(SIGVTALRM, &action, has_limit ? NULL : &before_limit) != 0) return -1;
   has_limit = 1;
   return setitimer(ITIMER_VIRTUAL, &timer, NULL);
}

/* Limits the address space to the present size plus a number of bytes. */
static void limit_memory(double bytes)
{
   FILE *const pages = fopen("/proc/self/statm", "r");
   double n_pages = 0.0;
   if (pages == NULL) return;
   const int n_read = fscanf(pages, "%lf", &n_pages);
   fclose(pages);
   if (n_read != 1 || has_less_memory || getrlimit(RLIMIT_AS, &memory_before) != 0) return;
   struct rlimit less = memory_before;
   bytes += n_pages * (double)sysconf(_SC_PAGESIZE);
   if (less.rlim_cur != RLIM_INFINITY && (double)less.rlim_cur <= bytes) return;
   less.rlim_cur = (rlim_t)bytes;
   has_less_memory = setrlimit(RLIMIT_AS, &less) == 0;
}

int hb_install_crash_handler(const char *text, int exit_status, double seconds, double bytes)
{
   n_last_entry = 0;
   last_message_length = strnlen(text, MAX_LAST_MESSAGE);
   memcpy(last_message, text, last_message_length);
   last_status = exit_status;
   is_protected = catch_crashes() == 0;
   if (is_protected && seconds > 0.0) (void)set_limit(seconds);
   if (is_protected && bytes > 0.0) limit_memory(bytes);
   return is_protected ? 0 : -1;
}

void hb_record_entry(const char *entry, size_t n_bytes)
{
   if (!is_protected) return;
   n_last_entry = 0;
   const size_t n_entry = n_bytes < MAX_ENTRY ? n_bytes : MAX_ENTRY;
   memcpy(last_entry, entry, n_entry);
   n_last_entry = n_entry;
}

void hb_remove_crash_handler(void)
{
   is_protected = 0;
   if (has_less_memory) (void)setrlimit(RLIMIT_AS, &memory_before);
   has_less_memory = 0;
   if (has_limit) {
      const struct itimerval none = {.it_value = {.tv_sec = 0}};
      (void)setitimer(ITIMER_VIRTUAL, &none, NULL);
      (void)sigaction(SIGVTALRM, &before_limit, NULL);
      has_limit = 0;
   }
   let_go();
}

int hb_detect_crashes(const char *path, const hb_crash_location_t *where)
{
   static int is_exit_caught = 0;

   hb_end_crash_detection();
   if (where->status_offset < 0 || where->message_length > MAX_TEXT) return -1;
   descriptor = open(path, O_WRONLY | O_CLOEXEC);
   if (descriptor < 0) return -1;
   location = *where;
   watched_process = getpid();
   if (!is_exit_caught) is_exit_caught = atexit(on_exit_of_process) == 0 && at_quick_exit(on_exit_of_process) == 0;
   if (is_exit_caught && catch_crashes() == 0) return 0;
   close(descriptor);
   descriptor = -1;
   return -1;
}

void hb_begin_point(long long row)
{
   solver = pthread_self();
   if (descriptor >= 0) atomic_store(&row_under_way, row);
}

void hb_end_point(void)
{
   atomic_store(&row_under_way, -1);
}

void hb_end_crash_detection(void)
{
   hb_end_point();
   if (descriptor < 0) return;
   close(descriptor);
   descriptor = -1;
   let_go();
}
