/* What watches over the work of the calling thread: a pointer that each thread has for itself, which Fortran 2018 cannot say. */
#ifndef HB_CURRENT_WATCH_H
#define HB_CURRENT_WATCH_H

#include <stddef.h>

void *hb_current_watch(void); /* NULL: nothing does */
void hb_set_current_watch(void *watch);

#endif
