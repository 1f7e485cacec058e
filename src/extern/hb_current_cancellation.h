/* What watches over the work of the calling thread: a pointer that each thread has for itself, which Fortran 2018 cannot say. */
#ifndef HB_CURRENT_CANCELLATION_H
#define HB_CURRENT_CANCELLATION_H

#include <stddef.h>

void *hb_current_cancellation(void); /* NULL: nothing does */
void hb_set_current_cancellation(void *cancellation);

#endif
