#include "hb_lock.h"

#include <pthread.h>

static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;

void hb_lock(void)
{
   (void)pthread_mutex_lock(&mutex);
}

void hb_unlock(void)
{
   (void)pthread_mutex_unlock(&mutex);
}
