/* Signals, the end of the process and standard output, for programs only; not part of nhbm::core. Source: POSIX.1-2017. */
#ifndef HB_PROCESS_H
#define HB_PROCESS_H

/* Catches SIGINT, SIGTERM, SIGUSR1 and SIGUSR2, each of which requests the end of the run. The first is only counted; at the
   second the process writes `text` to standard error and ends at once with `exit_status`. A signal that follows another one within
   `pause` [s] is not counted. Returns 0, or -1 if a handler cannot be installed. */
int hb_catch_signals(const char *text, int exit_status, double pause);

/* Until this is called, a signal ends the process at once with the same exit status, because no results can be lost. */
void hb_wait_for_points(void);

/* Names a file that such a signal removes; an empty name for none. */
void hb_note_unfinished(const char *path);

/* Makes a write fail, instead of ending the process, if the reader has closed the pipe or a limit on the size of files is
   reached. */
void hb_survive_failed_writes(void);

/* Returns the number of the first signal caught, 0 before. */
int hb_caught_signal(void);

/* Returns its name, such as SIGTERM; "no signal" before. */
const char *hb_caught_signal_name(void);

/* From now on, if any code other than hb_exit calls exit() or, under Linux, _exit(), such as a user law, the process writes `text`
   to standard error and ends with `exit_status`, not 0. */
void hb_reject_exit(const char *text, int exit_status);

/* Ends the process, as exit() does. */
void hb_exit(int exit_status);

/* Ends the process at once, as _exit() does. */
#ifdef __GNUC__
__attribute__((noreturn))
#endif
void hb_exit_at_once(int exit_status);

/* Sets an environment variable unless it is set. */
void hb_set_default(const char *name, const char *value);

/* Writes a line to standard output. */
void hb_say(const char *line);

/* Flushes standard output; returns 0, or the error number of the first failure. A pipe closed by its reader is not a failure. */
int hb_finish_output(void);

#endif
