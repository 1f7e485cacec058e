#include "hb_handles.h"

#include "hb_blas.h"

#include <pthread.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

typedef struct entry {
   const void *object;
   int kind;
   bool is_busy;
   pthread_t user; /* of a busy object */
   struct entry *next;
} entry_t;

enum { n_lists = 1024, no_kind = 0 };

static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t released = PTHREAD_COND_INITIALIZER;
static entry_t *lists[n_lists]; /* by address */
static int n_busy = 0;
static int blas_threads; /* of the program, while objects are busy */

/* The following two are called under the mutex: while any object is busy, BLAS uses as many threads as nhbm requests. */
static void make_busy(entry_t *entry)
{
   if (n_busy++ == 0) blas_threads = hb_borrow_blas();
   entry->is_busy = true;
   entry->user = pthread_self();
}

static void make_idle(entry_t *entry)
{
   if (!entry->is_busy) return;
   entry->is_busy = false;
   if (--n_busy == 0) hb_return_blas(blas_threads);
}

/* Address of the pointer to the entry of an object, or of the null pointer at the end of its list. */
static entry_t **find(const void *object)
{
   entry_t **entry = &lists[(uintptr_t)object/64 % n_lists];
   while (*entry && (*entry)->object != object) entry = &(*entry)->next;
   return entry;
}

int hb_register_handle(const void *object, int kind)
{
   entry_t *entry = calloc(1, sizeof *entry), **last;
   if (!entry) return 1;
   entry->object = object;
   entry->kind = kind;
   (void)pthread_mutex_lock(&mutex);
   last = find(object);
   *last = entry;
   (void)pthread_mutex_unlock(&mutex);
   return 0;
}

int hb_acquire_handle(const void *object, int kind)
{
   int result = HB_HANDLE_ACQUIRED;
   entry_t *entry;
   (void)pthread_mutex_lock(&mutex);
   entry = *find(object);
   if (!entry || entry->kind != kind) {
      result = HB_HANDLE_UNKNOWN;
   } else if (entry->is_busy) {
      result = pthread_equal(entry->user, pthread_self()) ? HB_HANDLE_BUSY_HERE : HB_HANDLE_BUSY_ELSEWHERE;
   } else {
      make_busy(entry);
   }
   (void)pthread_mutex_unlock(&mutex);
   return result;
}

void hb_release_handle(const void *object)
{
   entry_t *entry;
   (void)pthread_mutex_lock(&mutex);
   entry = *find(object);
   if (entry) make_idle(entry);
   (void)pthread_cond_broadcast(&released);
   (void)pthread_mutex_unlock(&mutex);
}

void hb_unregister_handle(const void *object)
{
   entry_t **place, *entry;
   (void)pthread_mutex_lock(&mutex);
   entry = *find(object);
   if (entry) {
      entry->kind = no_kind; /* unknown to new calls */
      while (entry->is_busy && !pthread_equal(entry->user, pthread_self())) (void)pthread_cond_wait(&released, &mutex);
      make_idle(entry);
      place = find(object);
      *place = entry->next;
   }
   (void)pthread_mutex_unlock(&mutex);
   free(entry);
}
