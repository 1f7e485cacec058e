/* File functions of the operating system without a Fortran interface: kinds of files, locks. Source: POSIX.1-2017; flock of BSD. */
#ifndef HB_FILES_H
#define HB_FILES_H

enum { HB_NO_FILE, HB_REGULAR_FILE, HB_EMPTY_FILE, HB_FOLDER, HB_NO_REGULAR_FILE, HB_LOST_LINK };

/* Returns the kind of a file name, one of these; links are followed. HB_NO_REGULAR_FILE is a device, a pipe or a socket,
   HB_LOST_LINK a link to a missing file. */
int hb_kind_of_file(const char *path);

/* Returns whether both names refer to the same file; links are followed. */
int hb_is_same_file(const char *one, const char *other);

/* Writes the target of a link, not null-terminated; returns its length, or -1 if the name is not a link or the buffer is too short. */
int hb_read_link(const char *path, char *target, int n_bytes);

/* Writes the absolute path of a folder, links followed, not null-terminated; returns its length, or -1 if there is no such folder
   or the buffer is too short. */
int hb_full_folder(const char *path, char *full, int n_bytes);

/* Creates the file if necessary and locks it for this process; the lock ends with the process at the latest. Returns a
   descriptor for hb_release_file, -1 if the file cannot be created, -2 if another process has the lock, -3 if the name is not
   a regular file, -4 if it is an unrelated file: one that is not empty and does not have the sticky bit, which marks leftovers
   of killed processes. On a file system without locks the file counts as locked. */
int hb_lock_file(const char *path);

/* Removes the sticky bit of a complete file. */
void hb_finish_file(int descriptor);

/* Opens an existing file, returns its length, and locks it for this process if that does not conflict with parallel HDF5.
   Returns a descriptor for hb_release_file, -1 if it cannot be opened, -2 if another process has the lock. */
int hb_hold_file(const char *path, long long *n_bytes);

enum { HB_FILE_IS_SOUND, HB_FILE_WAS_DELETED, HB_FILE_WAS_MOVED, HB_FILE_WAS_CUT, HB_FILE_WAS_REPLACED };

/* Returns the state of the file since hb_hold_file, one of these. HB_FILE_WAS_MOVED: it has another name;
   HB_FILE_WAS_REPLACED: another file has its name; HB_FILE_WAS_CUT: it is shorter than it was. */
int hb_state_of_file(int descriptor, const char *path, long long n_bytes);

/* Checks whether the disk, a quota and other limits permit a file of that many bytes, by reserving and releasing them.
   Returns 0 if they do or the system cannot determine it, -1 otherwise. */
int hb_check_space(int descriptor, long long n_bytes);

/* Returns the free bytes of the file system of a path for users without privileges; -1 if they are not known. */
long long hb_free_bytes(const char *path);

/* Releases the lock; no effect for a negative descriptor. */
void hb_release_file(int descriptor);

/* Writes all data of the file to the disk; returns 0 on success. */
int hb_sync_file(const char *path);

#endif
