/* Processes of one computer in the place of MPI: the process that starts them waits for them, they share memory. For programs only.
   Source: POSIX.1-2017; prctl(2) of Linux. */
#ifndef HB_PROCESSES_H
#define HB_PROCESSES_H

#include <stddef.h>

#define HB_MAX_PROCESSES 1024
#define HB_N_COUNTERS 256

/* Starts `n` processes, ranks 0 to n - 1, by fork(). Returns the rank in each of them. In the calling process it returns -1 when all
   of them have ended, with the exit status in `status`: the largest of theirs or, if one has ended before `hb_note_end`, its own one
   or 128 and the number of its signal; the others are then ended. Until then the calling process passes SIGINT, SIGTERM, SIGUSR1 and
   SIGUSR2 on to them; if it ends itself, they receive SIGTERM (Linux) and do not wait for each other for long. Returns -2 if the
   system has too few resources, with its error number in `status`. Not to be called by a rank. */
int hb_start_processes(int n, int *status);

/* Notes that this rank ends as it should. */
void hb_note_end(void);

/* The following three are collective. */

/* Waits for all ranks, without using the processor. */
void hb_wait_for_all(void);

/* Copies bytes of one rank to all others. */
void hb_broadcast_bytes(void *bytes, size_t n_bytes, int root);

/* Copies the bytes of all ranks, the same number of each, to the ranks where `all` is not null, in the order of the ranks. */
void hb_gather_bytes(const void *bytes, size_t n_bytes, void *all);

/* The remaining ones are not; `i` from 0. One process alone also has these counters. */

/* Adds to a counter; returns its value before. */
int hb_add_to_counter(int i, int increment);

/* Returns the value of a counter. */
int hb_value_of_counter(int i);

/* Sets a counter to zero. */
void hb_clear_counter(int i);

#endif
