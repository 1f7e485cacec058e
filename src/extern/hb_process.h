/* Signals, the end of the process and standard output: for programs alone. nhbm::core has nothing of it. Source: POSIX.1-2017. */
#ifndef HB_PROCESS_H
#define HB_PROCESS_H

/* Catches SIGINT, SIGTERM, SIGUSR1 and SIGUSR2, each of which then asks the run to end. The first is only counted; at the
   second the process writes `text` to standard error and ends at once with `exit_status`. Returns 0, or -1 where a handler
   cannot be set. */
int hb_catch_signals(const char *text, int exit_status);

/* A signal ends the process at once, with the same exit status, until this is called: before there are points, nothing is lost. */
void hb_wait_for_points(void);

/* Names a file that such a signal removes; an empty name for none. */
void hb_note_unfinished(const char *path);

/* Has a write fail, instead of ending the process, where the reader has closed the pipe or a limit on the size of files is
   reached. */
void hb_survive_failed_writes(void);

/* Number of the first signal that was caught, 0 before. */
int hb_caught_signal(void);

/* Its name, such as SIGTERM; "no signal" before. */
const char *hb_caught_signal_name(void);

/* From here on, should anybody but hb_exit call exit() or, under Linux, _exit(), such as a law of the user's own, the process writes `text` to standard
   error and ends with `exit_status`, not 0. */
void hb_refuse_exit(const char *text, int exit_status);

/* Ends the process, as exit() does. */
void hb_exit(int exit_status);

/* Ends the process at once, as _exit() does. */
#ifdef __GNUC__
__attribute__((noreturn))
#endif
void hb_leave(int exit_status);

/* Sets a variable of the environment unless it is set. */
void hb_set_default(const char *name, const char *value);

/* Writes a line to standard output. */
void hb_say(const char *line);

/* Brings all lines to where they go; returns 0, or the error number of the first that was lost. A pipe whose reader is gone
   loses nothing that anybody wants. */
int hb_finish_output(void);

#endif
