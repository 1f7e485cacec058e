/* A lock around what two threads of a program must not do at once. Source: POSIX.1-2017. */
#ifndef HB_LOCK_H
#define HB_LOCK_H

/* Waits until nobody holds the lock, and takes it. */
void hb_lock(void);

/* Gives it back. */
void hb_unlock(void);

#endif
