#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* for fallocate and statfs, of Linux alone */
#endif
#include "hb_files.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#ifdef __linux__
#include <sys/vfs.h>
#endif
#include <unistd.h>

int hb_kind_of_file(const char *path)
{
   struct stat file;
   if (stat(path, &file) != 0) return lstat(path, &file) == 0 ? HB_LOST_LINK : HB_NO_FILE;
   if (S_ISREG(file.st_mode)) return file.st_size == 0 ? HB_EMPTY_FILE : HB_REGULAR_FILE;
   return S_ISDIR(file.st_mode) ? HB_FOLDER : HB_NO_REGULAR_FILE;
}

int hb_is_same_file(const char *one, const char *other)
{
   struct stat a, b;
   return stat(one, &a) == 0 && stat(other, &b) == 0 && a.st_dev == b.st_dev && a.st_ino == b.st_ino;
}

int hb_read_link(const char *path, char *target, int n_bytes)
{
   const ssize_t length = readlink(path, target, (size_t)n_bytes);
   return length < n_bytes ? (int)length : -1;
}

int hb_full_folder(const char *path, char *full, int n_bytes)
{
   char *const found = realpath(path, NULL);
   const size_t length = found == NULL ? 0 : strlen(found);
   const int fits = length > 0 && length <= (size_t)n_bytes;
   if (fits) memcpy(full, found, length);
   free(found);
   return fits ? (int)length : -1;
}

/* Whether the file of that name is the open one: it may have been renamed in the meantime. */
static int is_named(int descriptor, const char *path)
{
   struct stat open_file, named_file;
   return fstat(descriptor, &open_file) == 0 && stat(path, &named_file) == 0 && open_file.st_dev == named_file.st_dev &&
          open_file.st_ino == named_file.st_ino;
}

int hb_lock_file(const char *path)
{
   struct stat file;
   const int is_there = lstat(path, &file) == 0;
   if (is_there && !S_ISREG(file.st_mode)) return -3;
   const int descriptor = open(path, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0666);
   if (descriptor < 0) return -1;
   const int is_taken = flock(descriptor, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
   if (is_taken || !is_named(descriptor, path)) {
      close(descriptor);
      return -2;
   }
   if (fstat(descriptor, &file) != 0 || (file.st_size > 0 && (file.st_mode & S_ISVTX) == 0)) {
      close(descriptor);
      return -4;
   }
   (void)fchmod(descriptor, (file.st_mode & 0777) | S_ISVTX);
   return descriptor;
}

void hb_finish_file(int descriptor)
{
   struct stat file;
   if (fstat(descriptor, &file) == 0) (void)fchmod(descriptor, file.st_mode & 0777);
}

/* Locks one byte far behind the end of the file for this descriptor: nobody who reads the file minds, as they would a lock of the
   whole file. Not on NFS and its like, where parallel HDF5 locks whole files. Returns -1 where another one has the lock. Source
   of the numbers: Linux, statfs(2). */
static int lock_for_writing(int descriptor)
{
#if defined __linux__ && defined F_OFD_SETLK
   static const unsigned local[] = {0xEF53, 0x58465342, 0x9123683E, 0x01021994, 0x794C7630, 0x2FC12FC1, 0x858458F6};
   struct statfs system;
   struct flock lock;
   if (fstatfs(descriptor, &system) != 0) return 0;
   memset(&lock, 0, sizeof lock);
   lock.l_type = F_WRLCK;
   lock.l_whence = SEEK_SET;
   lock.l_start = (off_t)1 << (8 * sizeof(off_t) - 2);
   lock.l_len = 1;
   for (size_t i = 0; i < sizeof local / sizeof local[0]; i++)
      if ((unsigned)system.f_type == local[i] && fcntl(descriptor, F_OFD_SETLK, &lock) != 0) return errno == EAGAIN ? -1 : 0;
#else
   (void)descriptor;
#endif
   return 0;
}

int hb_hold_file(const char *path, long long *n_bytes)
{
   struct stat file;
   const int descriptor = open(path, O_RDWR | O_CLOEXEC | O_NONBLOCK);
   if (descriptor < 0 || fstat(descriptor, &file) != 0) return -1;
   *n_bytes = (long long)file.st_size;
   if (lock_for_writing(descriptor) != 0) {
      close(descriptor);
      return -2;
   }
   return descriptor;
}

int hb_state_of_file(int descriptor, const char *path, long long n_bytes)
{
   struct stat open_file, named_file;
   if (descriptor < 0 || fstat(descriptor, &open_file) != 0) return HB_FILE_IS_SOUND;
   if (stat(path, &named_file) != 0) return open_file.st_nlink == 0 ? HB_FILE_WAS_DELETED : HB_FILE_WAS_MOVED;
   if (open_file.st_dev != named_file.st_dev || open_file.st_ino != named_file.st_ino) return HB_FILE_WAS_REPLACED;
   return open_file.st_size < (off_t)n_bytes ? HB_FILE_WAS_CUT : HB_FILE_IS_SOUND;
}

int hb_check_space(int descriptor, long long n_bytes)
{
#ifdef __linux__
   if (fallocate(descriptor, 0, 0, (off_t)n_bytes) != 0 && (errno == ENOSPC || errno == EDQUOT || errno == EFBIG)) return -1;
   return ftruncate(descriptor, 0);
#else
   (void)descriptor;
   (void)n_bytes;
   return 0;
#endif
}

long long hb_free_bytes(const char *path)
{
   struct statvfs system;
   return statvfs(path, &system) == 0 ? (long long)system.f_bavail * (long long)system.f_frsize : -1LL;
}

void hb_release_file(int descriptor)
{
   if (descriptor >= 0) close(descriptor);
}

int hb_sync_file(const char *path)
{
   const int descriptor = open(path, O_RDONLY | O_CLOEXEC);
   if (descriptor < 0) return -1;
   const int status = fsync(descriptor);
   close(descriptor);
   return status;
}
