#include "hb_last_error.h"

#include <string.h>

enum { capacity = 8192 };

static _Thread_local char message[capacity];

const char *hb_last_error(void)
{
   return message;
}

void hb_set_last_error(const char *text, size_t length)
{
   if (length >= capacity) {
      length = capacity - 1;
      while (length > 0 && ((unsigned char)text[length] & 0xC0) == 0x80) --length; /* no part of a UTF-8 character */
   }
   memcpy(message, text, length);
   message[length] = '\0';
}
