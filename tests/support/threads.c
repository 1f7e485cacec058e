/* Threads for tests. Source: POSIX.1-2017. */
#include <pthread.h>

#define MAX_THREADS 16

typedef struct {
   void (*work)(int);
   int number;
} task_t;

void run_in_threads(void (*work)(int), int n_threads);

static void *run(void *task)
{
   const task_t *mine = task;

   mine->work(mine->number);
   return NULL;
}

/* Calls work(1), ..., work(n_threads) at the same time, and waits for all of them. */
void run_in_threads(void (*work)(int), int n_threads)
{
   pthread_t threads[MAX_THREADS];
   task_t tasks[MAX_THREADS];
   int n = 0;

   for (int i = 0; i < n_threads && i < MAX_THREADS; i++) {
      tasks[i] = (task_t){work, i + 1};
      if (pthread_create(&threads[n], NULL, run, &tasks[i]) == 0) n++;
   }
   for (int i = 0; i < n; i++) (void)pthread_join(threads[i], NULL);
}
