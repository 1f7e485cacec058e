#define _GNU_SOURCE /* for fallocate and statfs, of Linux alone */
#include "hb_posix.h"

#include "hb_crash.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#ifdef __linux__
#include <sys/syscall.h>
#include <sys/vfs.h>
#endif
#include <unistd.h>

#define MAX_TEXT 1024

static const struct {
   int number;
   const char *name;
} ending[] = {{SIGINT, "SIGINT"}, {SIGTERM, "SIGTERM"}, {SIGUSR1, "SIGUSR1"}, {SIGUSR2, "SIGUSR2"}};
static const size_t n_ending = sizeof ending / sizeof ending[0];

static volatile sig_atomic_t caught = 0;
static volatile sig_atomic_t ends_at_once = 1;
static char unfinished[4096];
static char last_words[MAX_TEXT];
static size_t n_last_words = 0;
static int last_status = 1;

/* Calls nothing but what POSIX allows in a handler. */
static void on_signal(int number)
{
   if (ends_at_once) {
      static const char words[] = "nhbm: ended by a signal before the first point was begun\n";
      if (unfinished[0] != '\0') (void)unlink(unfinished);
      if (write(STDERR_FILENO, words, sizeof words - 1) < 0) hb_leave(last_status);
      hb_leave(last_status);
   }
   if (caught != 0) {
      if (write(STDERR_FILENO, last_words, n_last_words) < 0) hb_leave(last_status);
      hb_leave(last_status);
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
   return 0;
}

void hb_wait_for_points(void)
{
   ends_at_once = 0;
}

void hb_note_unfinished(const char *path)
{
   const size_t length = strlen(path);
   unfinished[0] = '\0';
   if (length == 0 || length >= sizeof unfinished) return;
   memcpy(unfinished + 1, path + 1, length);
   unfinished[0] = path[0]; /* last: the name is whole now */
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
static int exit_status_of_others = 0; /* 0: exit() is ours */
static pid_t this_process;

static void on_exit_by_others(void)
{
   if (exit_status_of_others == 0) return;
   (void)fflush(stdout);
   if (write(STDERR_FILENO, exit_words, strnlen(exit_words, MAX_TEXT)) < 0) hb_leave(exit_status_of_others);
   hb_leave(exit_status_of_others);
}

void hb_refuse_exit(const char *text, int exit_status)
{
   strncpy(exit_words, text, MAX_TEXT - 1);
   this_process = getpid();
   if (atexit(on_exit_by_others) == 0 && at_quick_exit(on_exit_by_others) == 0) exit_status_of_others = exit_status;
}

void hb_leave(int exit_status)
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
   if (exit_status_of_others == 0 || getpid() != this_process) hb_leave(exit_status);
   const int status_within_point = hb_end_within_point("_exit()");
   if (status_within_point != 0) hb_leave(status_within_point);
   on_exit_by_others();
   hb_leave(exit_status);
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
   if (puts(line) == EOF && output_error == 0) output_error = errno;
}

int hb_finish_output(void)
{
   if (fflush(stdout) == EOF && output_error == 0) output_error = errno;
   return output_error == EPIPE ? 0 : output_error;
}

int hb_kind_of_file(const char *path)
{
   struct stat file;
   if (stat(path, &file) != 0) return lstat(path, &file) == 0 ? HB_LOST_LINK : HB_NO_FILE;
   if (S_ISREG(file.st_mode)) return file.st_size == 0 ? HB_EMPTY_FILE : HB_REGULAR_FILE;
   return S_ISDIR(file.st_mode) ? HB_FOLDER : HB_NO_REGULAR_FILE;
}

int hb_is_same_file(const char *one, const char *other)
{
   struct stat a, b;
   return stat(one, &a) == 0 && stat(other, &b) == 0 && a.st_dev == b.st_dev && a.st_ino == b.st_ino;
}

int hb_read_link(const char *path, char *target, int n_bytes)
{
   const ssize_t length = readlink(path, target, (size_t)n_bytes);
   return length < n_bytes ? (int)length : -1;
}

int hb_full_folder(const char *path, char *full, int n_bytes)
{
   char *const found = realpath(path, NULL);
   const size_t length = found == NULL ? 0 : strlen(found);
   const int fits = length > 0 && length <= (size_t)n_bytes;
   if (fits) memcpy(full, found, length);
   free(found);
   return fits ? (int)length : -1;
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
   struct stat file;
   const int is_there = lstat(path, &file) == 0;
   if (is_there && !S_ISREG(file.st_mode)) return -3;
   const int descriptor = open(path, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0666);
   if (descriptor < 0) return -1;
   const int is_taken = flock(descriptor, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
   if (is_taken || !is_named(descriptor, path)) {
      close(descriptor);
      return -2;
   }
   if (fstat(descriptor, &file) != 0 || (file.st_size > 0 && (file.st_mode & S_ISVTX) == 0)) {
      close(descriptor);
      return -4;
   }
   (void)fchmod(descriptor, (file.st_mode & 0777) | S_ISVTX);
   return descriptor;
}

void hb_finish_file(int descriptor)
{
   struct stat file;
   if (fstat(descriptor, &file) == 0) (void)fchmod(descriptor, file.st_mode & 0777);
}

/* Locks one byte far behind the end of the file for this descriptor: nobody who reads the file minds, as they would a lock of the
   whole file. Not on NFS and its like, where parallel HDF5 locks whole files. Returns -1 where another one has the lock. Source
   of the numbers: Linux, statfs(2). */
static int lock_for_writing(int descriptor)
{
#ifdef F_OFD_SETLK
   static const unsigned local[] = {0xEF53, 0x58465342, 0x9123683E, 0x01021994, 0x794C7630, 0x2FC12FC1, 0x858458F6};
   struct statfs system;
   struct flock lock;
   if (fstatfs(descriptor, &system) != 0) return 0;
   memset(&lock, 0, sizeof lock);
   lock.l_type = F_WRLCK;
   lock.l_whence = SEEK_SET;
   lock.l_start = (off_t)1 << (8 * sizeof(off_t) - 2);
   lock.l_len = 1;
   for (size_t i = 0; i < sizeof local / sizeof local[0]; i++)
      if ((unsigned)system.f_type == local[i] && fcntl(descriptor, F_OFD_SETLK, &lock) != 0) return errno == EAGAIN ? -1 : 0;
#else
   (void)descriptor;
#endif
   return 0;
}

int hb_hold_file(const char *path, long long *n_bytes)
{
   struct stat file;
   const int descriptor = open(path, O_RDWR | O_CLOEXEC | O_NONBLOCK);
   if (descriptor < 0 || fstat(descriptor, &file) != 0) return -1;
   *n_bytes = (long long)file.st_size;
   if (lock_for_writing(descriptor) != 0) {
      close(descriptor);
      return -2;
   }
   return descriptor;
}

int hb_state_of_file(int descriptor, const char *path, long long n_bytes)
{
   struct stat open_file, named_file;
   if (descriptor < 0 || fstat(descriptor, &open_file) != 0) return HB_FILE_IS_SOUND;
   if (stat(path, &named_file) != 0) return open_file.st_nlink == 0 ? HB_FILE_WAS_DELETED : HB_FILE_WAS_MOVED;
   if (open_file.st_dev != named_file.st_dev || open_file.st_ino != named_file.st_ino) return HB_FILE_WAS_REPLACED;
   return open_file.st_size < (off_t)n_bytes ? HB_FILE_WAS_CUT : HB_FILE_IS_SOUND;
}

int hb_check_space(int descriptor, long long n_bytes)
{
#ifdef __linux__
   if (fallocate(descriptor, 0, 0, (off_t)n_bytes) != 0 && (errno == ENOSPC || errno == EDQUOT || errno == EFBIG)) return -1;
   return ftruncate(descriptor, 0);
#else
   (void)descriptor;
   (void)n_bytes;
   return 0;
#endif
}

void hb_set_default(const char *name, const char *value)
{
   (void)setenv(name, value, 0);
}

void hb_release_file(int descriptor)
{
   if (descriptor >= 0) close(descriptor);
}

int hb_write_file(const char *path, const void *bytes, long long n_bytes)
{
   const int descriptor = open(path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC | O_NOFOLLOW, 0666);
   if (descriptor < 0) return errno;
   int status = 0;
   for (long long done = 0; done < n_bytes && status == 0;) {
      const ssize_t n = write(descriptor, (const char *)bytes + done, (size_t)(n_bytes - done));
      if (n > 0) done += n;
      if (n < 0 && errno != EINTR) status = errno;
   }
   if (status == 0 && fsync(descriptor) != 0) status = errno;
   if (close(descriptor) != 0 && status == 0) status = errno;
   if (status != 0) (void)unlink(path);
   return status;
}

int hb_sync_file(const char *path)
{
   const int descriptor = open(path, O_RDONLY | O_CLOEXEC);
   if (descriptor < 0) return -1;
   const int status = fsync(descriptor);
   close(descriptor);
   return status;
}
