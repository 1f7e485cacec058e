/* What tests let a child process do, how it ends, and what is written to standard error. Source: POSIX.1-2017. */
#include <fcntl.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

int status_of_child(void (*work)(void), const char *errors);
void collect_errors(void (*work)(void), const char *errors);
void end_by_exit(int status);
void end_by_signal(int number);
int has_crash_signals(void);

/* Does the work in a child process, whose standard error goes to a file. Returns its exit status, or 128 and the number of the
   signal that has ended it; 77 where the work returns. */
int status_of_child(void (*work)(void), const char *errors)
{
   int status;
   const pid_t child = fork();
   if (child == 0) {
      const int file = open(errors, O_WRONLY | O_CREAT | O_TRUNC, 0600);
      (void)dup2(file, STDERR_FILENO);
      work();
      _exit(77);
   }
   if (child < 0 || waitpid(child, &status, 0) != child) return -1;
   return WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
}

/* Does the work in this process, whose standard error goes to a file meanwhile. */
void collect_errors(void (*work)(void), const char *errors)
{
   const int before = dup(STDERR_FILENO);
   const int file = open(errors, O_WRONLY | O_CREAT | O_TRUNC, 0600);
   (void)dup2(file, STDERR_FILENO);
   work();
   (void)dup2(before, STDERR_FILENO);
   (void)close(before);
   (void)close(file);
}

void end_by_exit(int status)
{
   exit(status);
}

void end_by_signal(int number)
{
   (void)raise(number);
}

/* The address sanitizer catches them itself. */
int has_crash_signals(void)
{
#ifdef __SANITIZE_ADDRESS__
   return 0;
#else
   return 1;
#endif
}
