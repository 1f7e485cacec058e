#include "hb_current_cancellation.h"

static _Thread_local void *current = NULL;

void *hb_current_cancellation(void)
{
   return current;
}

void hb_set_current_cancellation(void *cancellation)
{
   current = cancellation;
}
