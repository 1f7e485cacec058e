#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* for MAP_ANONYMOUS */
#endif
#include "hb_processes.h"

#include "../hb_process.h"

#include <errno.h>
#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/types.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
#ifdef __linux__
#include <sys/prctl.h>
#endif

#define AREA_SIZE 16384
#define SECONDS_TO_END 5.0 /* after SIGTERM, of a rank that computes */
#define SECONDS_ALONE 2    /* of a rank that waits for others */

typedef struct {
   atomic_int is_waiting;
   atomic_int has_ended;
   unsigned char area[AREA_SIZE]; /* what this rank tells the others */
} rank_t;

typedef struct {
   pthread_mutex_t mutex;
   pthread_cond_t all_are_here;
   int n_here;
   unsigned round;
   atomic_int counters[HB_N_COUNTERS];
   rank_t ranks[];
} shared_t;

static shared_t *shared = NULL; /* null: one process alone */
static int n_ranks = 1, this_rank = 0;
static pid_t launcher; /* the process that has started this rank */
static atomic_int own_counters[HB_N_COUNTERS];
static atomic_int *counters = own_counters;

static const int passed_on[] = {SIGINT, SIGTERM, SIGUSR1, SIGUSR2};
static const size_t n_passed_on = sizeof passed_on / sizeof passed_on[0];

static size_t bytes_for(int n)
{
   return sizeof(shared_t) + (size_t)n * sizeof(rank_t);
}

/* Memory that processes share which are started later; null, with the error number in errno, if there is none. */
static shared_t *new_memory(int n)
{
   const size_t n_bytes = bytes_for(n);
   shared_t *const memory = mmap(NULL, n_bytes, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
   if (memory == MAP_FAILED) return NULL;
   pthread_mutexattr_t of_mutex;
   pthread_condattr_t of_condition;
   int error = pthread_mutexattr_init(&of_mutex);
   if (error == 0) error = pthread_condattr_init(&of_condition);
   if (error == 0) error = pthread_mutexattr_setpshared(&of_mutex, PTHREAD_PROCESS_SHARED);
   if (error == 0) error = pthread_condattr_setpshared(&of_condition, PTHREAD_PROCESS_SHARED);
   if (error == 0) error = pthread_mutex_init(&memory->mutex, &of_mutex);
   if (error == 0) error = pthread_cond_init(&memory->all_are_here, &of_condition);
   if (error == 0) return memory;
   (void)munmap(memory, n_bytes);
   errno = error;
   return NULL;
}

/* The process that waits for the ranks */

static void send_all(const pid_t *processes, int number)
{
   for (int i = 0; i < n_ranks; i++)
      if (processes[i] > 0) (void)kill(processes[i], number);
}

static void sleep_for_ms(long ms)
{
   const struct timespec interval = {.tv_sec = ms / 1000, .tv_nsec = ms % 1000 * 1000000};
   (void)nanosleep(&interval, NULL);
}

typedef struct {
   pid_t *processes;  /* 0: has ended */
   int n_left;
   int status;        /* so far */
   int is_broken;     /* a rank has ended too early; its status remains */
   int last_passed_on;
} watch_t;

/* Reaps a process that has ended. */
static void note_process(watch_t *watch, pid_t process, int ending)
{
   int rank = 0;
   while (rank < n_ranks && watch->processes[rank] != process) rank++;
   if (rank == n_ranks) return;
   watch->processes[rank] = 0;
   watch->n_left--;
   if (watch->is_broken) return;
   const int status = WIFSIGNALED(ending) ? 128 + WTERMSIG(ending) : WEXITSTATUS(ending);
   if (WIFEXITED(ending) && atomic_load(&shared->ranks[rank].has_ended)) {
      if (status > watch->status) watch->status = status;
      return;
   }
   watch->is_broken = 1;
   watch->status = status;
   if (WIFSIGNALED(ending) && WTERMSIG(ending) != watch->last_passed_on)
      fprintf(stderr, "nhbm: the process of rank %d was ended by signal %d (%s); the run ends\n", rank, WTERMSIG(ending),
              strsignal(WTERMSIG(ending)));
}

static void reap(watch_t *watch)
{
   int ending;
   pid_t process;
   while ((process = waitpid(-1, &ending, WNOHANG)) > 0) note_process(watch, process, ending);
}

/* Ends the ranks that are left: those that wait for the missing one at once, those that compute when they have written their
   results, or after some seconds. */
static void end_the_others(watch_t *watch)
{
   const long interval = 10;
   send_all(watch->processes, SIGTERM);
   for (long ms = 0; watch->n_left > 0; ms += interval) {
      for (int i = 0; i < n_ranks; i++) {
         const int is_over = (ms > 0 && atomic_load(&shared->ranks[i].is_waiting)) || (double)ms > 1.0e3 * SECONDS_TO_END;
         if (is_over && watch->processes[i] > 0) (void)kill(watch->processes[i], SIGKILL);
      }
      sleep_for_ms(interval);
      reap(watch);
   }
}

static void do_nothing(int number)
{
   (void)number;
}

/* Returns the exit status of the ranks when all have ended; `signals` are blocked. */
static int wait_for_ranks(pid_t *processes, const sigset_t *signals)
{
   watch_t watch = {.processes = processes, .n_left = n_ranks};
   while (watch.n_left > 0 && !watch.is_broken) {
      int number;
      if (sigwait(signals, &number) != 0) continue;
      if (number == SIGCHLD) {
         reap(&watch);
      } else {
         watch.last_passed_on = number;
         send_all(processes, number);
      }
   }
   if (watch.is_broken) end_the_others(&watch);
   return watch.status;
}

/* The ranks */

/* What a rank does first; it ends with the process that has started it. */
static int begin_rank(int rank, const struct sigaction *of_child, const sigset_t *mask)
{
   this_rank = rank;
#ifdef __linux__
   (void)prctl(PR_SET_PDEATHSIG, SIGTERM);
#endif
   if (getppid() != launcher) raise(SIGTERM);
   (void)sigaction(SIGCHLD, of_child, NULL);
   (void)sigprocmask(SIG_SETMASK, mask, NULL);
   return rank;
}

/* Starts the ranks; returns the rank in each of them, -1 in the calling process, or -2 if the system cannot start them all. */
static int start_ranks(pid_t *processes, const struct sigaction *of_child, const sigset_t *mask)
{
   launcher = getpid();
   for (int rank = 0; rank < n_ranks; rank++) {
      processes[rank] = fork();
      if (processes[rank] == 0) return begin_rank(rank, of_child, mask);
      if (processes[rank] > 0) continue;
      const int error = errno;
      while (rank-- > 0) {
         (void)kill(processes[rank], SIGKILL);
         (void)waitpid(processes[rank], NULL, 0);
      }
      errno = error;
      return -2;
   }
   return -1;
}

int hb_start_processes(int n, int *status)
{
   sigset_t signals, mask;
   struct sigaction action, of_child;

   *status = EINVAL;
   if (n < 1 || n > HB_MAX_PROCESSES) return -2;
   pid_t *const processes = calloc((size_t)n, sizeof *processes);
   shared = processes == NULL ? NULL : new_memory(n);
   if (shared == NULL) {
      *status = errno;
      free(processes);
      return -2;
   }
   n_ranks = n;
   counters = shared->counters;
   sigemptyset(&signals);
   for (size_t i = 0; i < n_passed_on; i++) sigaddset(&signals, passed_on[i]);
   sigaddset(&signals, SIGCHLD);
   (void)sigprocmask(SIG_BLOCK, &signals, &mask);
   memset(&action, 0, sizeof action);
   action.sa_handler = do_nothing; /* an ignored signal would not be waited for */
   sigemptyset(&action.sa_mask);
   (void)sigaction(SIGCHLD, &action, &of_child);
   const int rank = start_ranks(processes, &of_child, &mask);
   if (rank < 0) {
      *status = rank == -1 ? wait_for_ranks(processes, &signals) : errno;
      (void)munmap(shared, bytes_for(n));
      shared = NULL;
      n_ranks = 1;
      counters = own_counters;
      (void)sigaction(SIGCHLD, &of_child, NULL);
      (void)sigprocmask(SIG_SETMASK, &mask, NULL);
   }
   free(processes);
   return rank;
}

void hb_note_end(void)
{
   if (shared != NULL) atomic_store(&shared->ranks[this_rank].has_ended, 1);
}

/* Waits until the round is over. Without the process that has started the ranks nobody notes that one has ended: this one then
   ends soon, too, rather than wait for it. */
static void wait_for_end_of(unsigned round)
{
   for (int n_seconds_alone = 0; shared->round == round && n_seconds_alone < SECONDS_ALONE;) {
      struct timespec limit;
      (void)clock_gettime(CLOCK_REALTIME, &limit);
      limit.tv_sec++;
      (void)pthread_cond_timedwait(&shared->all_are_here, &shared->mutex, &limit);
      if (getppid() != launcher) n_seconds_alone++;
   }
   if (shared->round != round) return;
   (void)pthread_mutex_unlock(&shared->mutex);
   hb_exit_at_once(128 + SIGTERM);
}

void hb_wait_for_all(void)
{
   if (n_ranks == 1) return;
   (void)pthread_mutex_lock(&shared->mutex);
   const unsigned round = shared->round;
   if (++shared->n_here == n_ranks) {
      shared->n_here = 0;
      shared->round++;
      (void)pthread_cond_broadcast(&shared->all_are_here);
   } else {
      atomic_store(&shared->ranks[this_rank].is_waiting, 1);
      wait_for_end_of(round);
      atomic_store(&shared->ranks[this_rank].is_waiting, 0);
   }
   (void)pthread_mutex_unlock(&shared->mutex);
}

static size_t smaller(size_t a, size_t b)
{
   return a < b ? a : b;
}

void hb_broadcast_bytes(void *bytes, size_t n_bytes, int root)
{
   if (n_ranks == 1) return;
   for (size_t first = 0; first < n_bytes; first += AREA_SIZE) {
      const size_t n = smaller(AREA_SIZE, n_bytes - first);
      unsigned char *const here = (unsigned char *)bytes + first;
      if (this_rank == root) memcpy(shared->ranks[root].area, here, n);
      hb_wait_for_all();
      if (this_rank != root) memcpy(here, shared->ranks[root].area, n);
      hb_wait_for_all();
   }
}

void hb_gather_bytes(const void *bytes, size_t n_bytes, void *all)
{
   if (n_ranks == 1) {
      if (all != NULL && n_bytes > 0) memcpy(all, bytes, n_bytes);
      return;
   }
   for (size_t first = 0; first < n_bytes; first += AREA_SIZE) {
      const size_t n = smaller(AREA_SIZE, n_bytes - first);
      memcpy(shared->ranks[this_rank].area, (const unsigned char *)bytes + first, n);
      hb_wait_for_all();
      for (int rank = 0; rank < n_ranks && all != NULL; rank++)
         memcpy((unsigned char *)all + (size_t)rank * n_bytes + first, shared->ranks[rank].area, n);
      hb_wait_for_all();
   }
}

int hb_add_to_counter(int i, int increment)
{
   return atomic_fetch_add(&counters[i], increment);
}

int hb_value_of_counter(int i)
{
   return atomic_load(&counters[i]);
}

void hb_clear_counter(int i)
{
   atomic_store(&counters[i], 0);
}
