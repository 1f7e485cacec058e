/* The cancellation of the calling thread: a thread-local pointer, which Fortran 2018 does not have. */
#ifndef HB_CURRENT_CANCELLATION_H
#define HB_CURRENT_CANCELLATION_H

#include <stddef.h>

void *hb_current_cancellation(void); /* NULL: none */
void hb_set_current_cancellation(void *cancellation);

#endif
