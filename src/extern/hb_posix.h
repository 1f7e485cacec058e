/* What only C can ask of the operating system: signals and locks on files. Source: POSIX.1-2017; flock of BSD. */
#ifndef HB_POSIX_H
#define HB_POSIX_H

/* Catches SIGINT, SIGTERM, SIGUSR1 and SIGUSR2, each of which then asks the run to end. The first is only counted; at the
   second the process writes `text` to standard error and ends at once with `exit_status`. Also has a write beyond a limit
   on the size of files fail instead of ending the process. Returns 0, or -1 where a handler cannot be set. */
int hb_catch_signals(const char *text, int exit_status);

/* Number of the first signal that was caught, 0 before. */
int hb_caught_signal(void);

/* Its name, such as SIGTERM; "no signal" before. */
const char *hb_caught_signal_name(void);

/* Makes the file unless it is there and locks it for this process; the lock ends with the process at the latest. Returns a
   descriptor for hb_release_file, -1 where the file cannot be made, -2 where another process has the lock. On a file
   system without locks the file counts as locked. */
int hb_take_file(const char *path);

/* Asks whether the disk, a quota and other limits leave room for a file of that many bytes, by reserving them and giving
   them back. Returns 0 for yes and where the system cannot tell, -1 for no. */
int hb_check_space(int descriptor, long long n_bytes);

/* Cuts the file to no byte at all; returns 0, or -1 where that fails. */
int hb_empty_file(int descriptor);

/* Ends the lock; nothing happens for a negative descriptor. */
void hb_release_file(int descriptor);

/* Has the system bring all data of the file to the disk; returns 0 when they are there. */
int hb_sync_file(const char *path);

#endif
