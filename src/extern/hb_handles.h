/* Objects that programs refer to by their addresses: which of them exist, and which of them a call is using. No address is
 * dereferenced, so that any address may be passed. Source of the mutex: POSIX.1-2017. */
#ifndef HB_HANDLES_H
#define HB_HANDLES_H

enum {
   HB_HANDLE_ACQUIRED = 0,
   HB_HANDLE_UNKNOWN = 1,          /* no object of this kind exists at the address */
   HB_HANDLE_BUSY_HERE = 2,        /* an earlier call of this thread, from whose callback this one comes, is using the object */
   HB_HANDLE_BUSY_ELSEWHERE = 3    /* a call of another thread is using it */
};

/* Registers an object. Returns 0, or 1 if memory is insufficient. */
int hb_register_handle(const void *object, int kind);

/* Makes the caller the only user of an object until it releases or unregisters it. */
int hb_acquire_handle(const void *object, int kind);
void hb_release_handle(const void *object);

/* Removes an object, also one that the calling thread uses; waits while another thread uses it. */
void hb_unregister_handle(const void *object);

#endif
