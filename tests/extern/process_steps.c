/* What ranks of the tests do to themselves and to the process that has started them. Source: POSIX.1-2017. */
#include <poll.h>
#include <signal.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

void end_by_signal(int number);
void signal_parent(int number);
void expect_signal(int number);
int signal_arrives(void);
void sleep_ms(int ms);
void kill_parent(void);
int survives_launcher(void (*work)(void));

static volatile sig_atomic_t has_arrived = 0;

static void note(int number)
{
   (void)number;
   has_arrived = 1;
}

void sleep_ms(int ms)
{
   const struct timespec interval = {.tv_sec = ms / 1000, .tv_nsec = ms % 1000 * 1000000L};
   nanosleep(&interval, NULL);
}

void end_by_signal(int number)
{
   raise(number);
}

void signal_parent(int number)
{
   kill(getppid(), number);
}

/* From now on the signal is noted. */
void expect_signal(int number)
{
   signal(number, note);
}

/* Whether the signal arrives within ten seconds. */
int signal_arrives(void)
{
   for (int i = 0; i < 10000 && !has_arrived; i++) sleep_ms(1);
   return has_arrived;
}

/* Ends the process that has started this one, at once; returns when that has happened. */
void kill_parent(void)
{
   const pid_t parent = getppid();
   kill(parent, SIGKILL);
   while (getppid() == parent) sleep_ms(1);
}

/* Does the work in a child process, of which it waits for all descendants. Returns 1 if the child was killed and they end within 20
   seconds. */
int survives_launcher(void (*work)(void))
{
   int ends[2], status;
   char byte;
   if (pipe(ends) != 0) return 0;
   const pid_t child = fork();
   if (child == 0) {
      close(ends[0]);
      work();
      _exit(0);
   }
   close(ends[1]);
   waitpid(child, &status, 0);
   struct pollfd end = {.fd = ends[0], .events = POLLIN};
   const int are_gone = poll(&end, 1, 20000) == 1 && read(ends[0], &byte, 1) == 0; /* nobody has the other end */
   close(ends[0]);
   return WIFSIGNALED(status) && are_gone;
}
