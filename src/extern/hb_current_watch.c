#include "hb_current_watch.h"

static _Thread_local void *current = NULL;

void *hb_current_watch(void)
{
   return current;
}

void hb_set_current_watch(void *watch)
{
   current = watch;
}
