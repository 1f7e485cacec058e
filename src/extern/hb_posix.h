/* What only C can ask of the operating system: signals, standard output, kinds of files and locks on them. Source:
   POSIX.1-2017; flock of BSD. */
#ifndef HB_POSIX_H
#define HB_POSIX_H

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

enum { HB_NO_FILE, HB_REGULAR_FILE, HB_EMPTY_FILE, HB_FOLDER, HB_NO_REGULAR_FILE, HB_LOST_LINK };

/* What the name stands for, one of these; links are followed. HB_NO_REGULAR_FILE is a device, a pipe or a socket, HB_LOST_LINK
   a link to what is not there. */
int hb_kind_of_file(const char *path);

/* Whether both names stand for one file; links are followed. */
int hb_is_same_file(const char *one, const char *other);

/* Writes what a link says, without a null at its end; returns its length, or -1 where the name is no link or there is no room. */
int hb_read_link(const char *path, char *target, int n_bytes);

/* Writes the absolute path of a folder, links followed, without a null at its end; returns its length, or -1 where there is no such
   folder or there is no room. */
int hb_full_folder(const char *path, char *full, int n_bytes);

/* Makes the file unless it is there and locks it for this process; the lock ends with the process at the latest. Returns a
   descriptor for hb_release_file, -1 where the file cannot be made, -2 where another process has the lock, -3 where what has
   the name is no regular file, -4 where it is a file of somebody else: one that is not empty and has not the sticky bit, which
   tells what a killed process has left here. On a file system without locks the file counts as locked. */
int hb_take_file(const char *path);

/* Takes the sticky bit off a file that is complete. */
void hb_finish_file(int descriptor);

/* Opens a file that is there, tells its length, and locks it for this process where that does not get into the way of parallel
   HDF5. Returns a descriptor for hb_release_file, -1 where it cannot be opened, -2 where another process has the lock. */
int hb_hold_file(const char *path, long long *n_bytes);

enum { HB_FILE_IS_SOUND, HB_FILE_WAS_DELETED, HB_FILE_WAS_MOVED, HB_FILE_WAS_CUT, HB_FILE_WAS_REPLACED };

/* What has become of the file since hb_hold_file: one of these. HB_FILE_WAS_MOVED: it has another name;
   HB_FILE_WAS_REPLACED: another file has its name; HB_FILE_WAS_CUT: it is shorter than it was. */
int hb_state_of_file(int descriptor, const char *path, long long n_bytes);

/* Asks whether the disk, a quota and other limits leave room for a file of that many bytes, by reserving them and giving
   them back. Returns 0 for yes and where the system cannot tell, -1 for no. */
int hb_check_space(int descriptor, long long n_bytes);

/* Ends the lock; nothing happens for a negative descriptor. */
void hb_release_file(int descriptor);

/* Makes a file, which must not be there, of these bytes and brings them to the disk; returns 0, or the error number, and then leaves no
   file. */
int hb_write_file(const char *path, const void *bytes, long long n_bytes);

/* Has the system bring all data of the file to the disk; returns 0 when they are there. */
int hb_sync_file(const char *path);

#endif
