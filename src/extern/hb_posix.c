#define _GNU_SOURCE /* for fallocate, of Linux alone */
#include "hb_posix.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#define MAX_TEXT 1024

static const struct {
   int number;
   const char *name;
} ending[] = {{SIGINT, "SIGINT"}, {SIGTERM, "SIGTERM"}, {SIGUSR1, "SIGUSR1"}, {SIGUSR2, "SIGUSR2"}};
static const size_t n_ending = sizeof ending / sizeof ending[0];

static volatile sig_atomic_t caught = 0;
static char last_words[MAX_TEXT];
static size_t n_last_words = 0;
static int last_status = 1;

/* Calls nothing but what POSIX allows in a handler. */
static void on_signal(int number)
{
   if (caught != 0) {
      if (write(STDERR_FILENO, last_words, n_last_words) < 0) _exit(last_status);
      _exit(last_status);
   }
   caught = number;
}

int hb_catch_signals(const char *text, int exit_status)
{
   n_last_words = strnlen(text, MAX_TEXT);
   memcpy(last_words, text, n_last_words);
   last_status = exit_status;

   struct sigaction action;
   memset(&action, 0, sizeof action);
   action.sa_handler = on_signal;
   action.sa_flags = SA_RESTART;
   sigfillset(&action.sa_mask);
   for (size_t i = 0; i < n_ending; i++)
      if (sigaction(ending[i].number, &action, NULL) != 0) return -1;

   action.sa_handler = SIG_IGN;
   return sigaction(SIGXFSZ, &action, NULL);
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

/* Whether the file of that name is the one that is open: its maker may have given it another name meanwhile. */
static int is_named(int descriptor, const char *path)
{
   struct stat open_file, named_file;
   return fstat(descriptor, &open_file) == 0 && stat(path, &named_file) == 0 && open_file.st_dev == named_file.st_dev &&
          open_file.st_ino == named_file.st_ino;
}

int hb_take_file(const char *path)
{
   const int descriptor = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0666);
   if (descriptor < 0) return -1;
   const int is_taken = flock(descriptor, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
   if (is_taken || !is_named(descriptor, path)) {
      close(descriptor);
      return -2;
   }
   return descriptor;
}

int hb_check_space(int descriptor, long long n_bytes)
{
#ifdef __linux__
   if (fallocate(descriptor, 0, 0, (off_t)n_bytes) != 0 && (errno == ENOSPC || errno == EDQUOT || errno == EFBIG)) return -1;
   return hb_empty_file(descriptor);
#else
   (void)descriptor;
   (void)n_bytes;
   return 0;
#endif
}

int hb_empty_file(int descriptor)
{
   return ftruncate(descriptor, 0);
}

void hb_release_file(int descriptor)
{
   if (descriptor >= 0) close(descriptor);
}

int hb_sync_file(const char *path)
{
   const int descriptor = open(path, O_RDONLY | O_CLOEXEC);
   if (descriptor < 0) return -1;
   const int status = fsync(descriptor);
   close(descriptor);
   return status;
}
