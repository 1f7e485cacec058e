/* What ranks of the tests do to themselves and to the process that has started them. Source: POSIX.1-2017. */
#include <signal.h>
#include <time.h>
#include <unistd.h>

void end_by_signal(int number);
void signal_parent(int number);
void expect_signal(int number);
int signal_arrives(void);
void sleep_ms(int ms);

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
