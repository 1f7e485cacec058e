/* What only C can ask of the operating system about files: their kinds, locks on them. Source: POSIX.1-2017; flock of BSD. */
#ifndef HB_FILES_H
#define HB_FILES_H

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

/* Has the system bring all data of the file to the disk; returns 0 when they are there. */
int hb_sync_file(const char *path);

#endif
