/* A lock for operations that two threads of a program must not perform at the same time. Source: POSIX.1-2017. */
#ifndef HB_LOCK_H
#define HB_LOCK_H

/* Waits for the lock and acquires it. */
void hb_lock(void);

/* Releases it. */
void hb_unlock(void);

#endif
