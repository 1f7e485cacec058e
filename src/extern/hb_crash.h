/* Records in the result file that the process ended during the solution of a point: by a fault, abort(), a trap, a stack
   overflow or exit(). Source: POSIX.1-2017, "Signal Concepts": the functions that a handler may call.

   The same handler protects calls of libraries that crash on damaged files: hb_install_crash_handler before the call,
   hb_remove_crash_handler after it.

   Order of use: hb_detect_crashes when the file is open, hb_begin_point and hb_end_point around the solution of each point,
   hb_end_crash_detection. Each point costs two stores. Under the address sanitizer, no signal is caught. */
#ifndef HB_CRASH_H
#define HB_CRASH_H

#include <stddef.h>

/* What is recorded, and where: byte offsets of the first rows in the file. */
typedef struct {
   long long status_offset;  /* of rows of four bytes, least significant first */
   long long message_offset; /* of rows of message_length bytes; negative: no message is recorded */
   long long message_length;
   int status;               /* status of a crashed point */
   int exit_status;          /* exit status if exit() ends the process within a point */
} hb_crash_location_t;

/* Opens the file for its records and catches SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT and exit(). A recorded signal is passed on
   to the previous handler, or ends the process as without a handler. Returns 0, or -1 if nothing will be recorded because the
   file cannot be opened or a handler cannot be installed. */
int hb_detect_crashes(const char *path, const hb_crash_location_t *location);

/* Marks the beginning of the point of that row, counted from 0. */
void hb_begin_point(long long row);

/* Marks the end of the present point. */
void hb_end_point(void);

/* Records that the present point ends the process by `cause`; returns the exit status for this, 0 if there is no present point. */
int hb_end_within_point(const char *cause);

/* Reverts hb_detect_crashes; safe to call twice. */
void hb_end_crash_detection(void);

/* From now on, if this process receives one of these signals, it writes `text`, cut to 1024 bytes, to standard error and ends
   at once with `exit_status`; the present point is recorded as crashed. The same after `seconds` of processor time, unless that
   is 0. Unless `bytes` is 0, at most this much memory can be allocated until hb_remove_crash_handler (Linux).
   Returns 0, or -1 if a handler cannot be installed. */
int hb_install_crash_handler(const char *text, int exit_status, double seconds, double bytes);

/* Records what a protected library is processing: `entry`, of n_bytes, is appended to the text. */
void hb_record_entry(const char *entry, size_t n_bytes);

/* Reverts hb_install_crash_handler; handlers installed in between are removed. */
void hb_remove_crash_handler(void);

#endif
