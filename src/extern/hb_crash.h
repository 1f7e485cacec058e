/* Notes in the result file that the solution of a point has ended the process: by a fault, abort(), a trap, the end of its
   stack, exit(). Source: POSIX.1-2017, "Signal Concepts": what a handler may call.

   The same handler guards calls of libraries that die of damaged files: hb_raise_guard before, hb_lower_guard behind.

   In the order of use: hb_detect_crashes when the file is open, hb_begin_point and hb_end_point around the solution of each
   point, hb_end_cancellation. A point costs two stores. With the address sanitizer, signals are left to that. */
#ifndef HB_CRASH_H
#define HB_CRASH_H

#include <stddef.h>

/* What is noted, and where: bytes of the file, of the first row each. */
typedef struct {
   long long status_offset;  /* of rows of four bytes, least significant first */
   long long message_offset; /* of rows of message_length bytes; negative: no message is noted */
   long long message_length;
   int status;               /* that a crashed point gets */
   int exit_status;          /* of the process, where it is exit() that ends it within a point */
} hb_crash_location_t;

/* Opens the file for notes of its own and catches SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT and exit(). A signal that was
   noted is handed on to whoever caught it before, or ends the process as if nobody did. Returns 0, or -1 where nothing will
   be noted because the file cannot be opened or a handler cannot be set. */
int hb_detect_crashes(const char *path, const hb_crash_location_t *place);

/* The point of that row, from 0, is being solved from here on. */
void hb_begin_point(long long row);

/* No point is being solved any more. */
void hb_end_point(void);

/* Notes that the point under way ends the process by `cause`; returns the exit status for that, 0 where no point is under way. */
int hb_end_within_point(const char *cause);

/* Ends what hb_detect_crashes has begun; safe to call twice. */
void hb_end_cancellation(void);

/* From here on, should this process receive one of these signals, it writes `text`, cut to 1024 bytes, to standard error and ends
   at once with `exit_status`; a point under way is noted as crashed. The same when it has worked for `seconds` of its own time,
   unless that is 0. Unless `bytes` is 0, no more of the memory than so many is to be had until the guard is lowered (Linux).
   Returns 0, or -1 where a handler cannot be set. */
int hb_raise_guard(const char *text, int exit_status, double seconds, double bytes);

/* Says what a guarded library is at, for the text: `entry`, of n_bytes, is written behind it. */
void hb_guard_entry(const char *entry, size_t n_bytes);

/* Ends what hb_raise_guard has begun; handlers that were set in between are undone. */
void hb_lower_guard(void);

#endif
