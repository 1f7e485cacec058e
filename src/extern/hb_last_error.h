/* The message of the last error of the calling thread, for the C interface. */
#ifndef HB_LAST_ERROR_H
#define HB_LAST_ERROR_H

#include <stddef.h>

const char *hb_last_error(void); /* null-terminated; empty if there was none */

/* Stores a message of `length` bytes; the end of a long one is dropped. */
void hb_set_last_error(const char *text, size_t length);

#endif
