#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* for dladdr, SEEK_DATA */
#endif
#include "hb_checksum.h"

#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define POLYNOMIAL 0xEDB88320u
#define N_TABLES 8
#define BUFFER_BYTES 1048576
#define MIN_ZEROS 256
#define MIN_SPARSE_BYTES 65536

#ifdef SEEK_DATA
#define FINDS_PARTS 1
#else /* all parts count as stored */
#define FINDS_PARTS 0
#define SEEK_DATA (-1)
#define SEEK_HOLE (-2)
#endif

static uint32_t table[N_TABLES][256];
static pthread_once_t has_tables = PTHREAD_ONCE_INIT;

static void fill_tables(void)
{
   for (uint32_t i = 0; i < 256; i++) {
      uint32_t crc = i;
      for (int k = 0; k < 8; k++) crc = (crc >> 1) ^ (POLYNOMIAL & (0u - (crc & 1u)));
      table[0][i] = crc;
   }
   for (uint32_t i = 0; i < 256; i++)
      for (int k = 1; k < N_TABLES; k++) table[k][i] = (table[k - 1][i] >> 8) ^ table[0][table[k - 1][i] & 0xFFu];
}

/* a b modulo the polynomial, the highest power in the lowest bit. */
static uint32_t multiply(uint32_t a, uint32_t b)
{
   uint32_t product = 0;

   for (uint32_t power = 1u << 31; power != 0; power >>= 1) {
      if (a & power) product ^= b;
      b = b & 1u ? (b >> 1) ^ POLYNOMIAL : b >> 1;
   }
   return product;
}

/* Effect of n zero bytes on the register: multiplication by x to the power of 8 n. Source: M. Adler, crc32_combine of zlib.
   The last power is stored: rows have the same number of zeros after each block. */
static uint32_t after_zeros(uint32_t crc, size_t n)
{
   static _Thread_local size_t last_n;
   static _Thread_local uint32_t last_power;

   if (n == 0) return crc;
   if (n != last_n) {
      uint32_t square = 1u << 23; /* x to the power of 8 */
      last_power = 1u << 31;      /* 1 */
      for (size_t left = n; left > 0; left >>= 1) {
         if (left & 1u) last_power = multiply(square, last_power);
         square = multiply(square, square);
      }
      last_n = n;
   }
   return multiply(last_power, crc);
}

/* Most elements of a row of results are unused. */
static size_t count_zeros(const unsigned char *b, size_t n_bytes)
{
   static const unsigned char zeros[MIN_ZEROS];
   size_t n = 0;

   while (n_bytes - n >= MIN_ZEROS && memcmp(b + n, zeros, MIN_ZEROS) == 0) n += MIN_ZEROS;
   return n;
}

/* Eight bytes at a time. Source: M. Kounavis, F. Berry, A systematic approach to building high performance software-based CRC
   generators, ISCC 2005. */
uint32_t hb_add_to_checksum(uint32_t checksum, const void *bytes, size_t n_bytes)
{
   const unsigned char *b = bytes;
   uint32_t crc = ~checksum;

   (void)pthread_once(&has_tables, fill_tables);
   for (; n_bytes >= 8; n_bytes -= 8, b += 8) {
      const size_t n_zeros = b[0] == 0 && b[7] == 0 ? count_zeros(b, n_bytes) : 0;
      if (n_zeros > 0) {
         crc = after_zeros(crc, n_zeros);
         b += n_zeros;
         n_bytes -= n_zeros;
         if (n_bytes < 8) break;
      }
      const uint32_t low = crc ^ ((uint32_t)b[0] | (uint32_t)b[1] << 8 | (uint32_t)b[2] << 16 | (uint32_t)b[3] << 24);
      crc = table[7][low & 0xFFu] ^ table[6][low >> 8 & 0xFFu] ^ table[5][low >> 16 & 0xFFu] ^ table[4][low >> 24] ^
            table[3][b[4]] ^ table[2][b[5]] ^ table[1][b[6]] ^ table[0][b[7]];
   }
   for (; n_bytes > 0; n_bytes--, b++) crc = (crc >> 8) ^ table[0][(crc ^ *b) & 0xFFu];
   return ~crc;
}

uint32_t hb_add_zeros_to_checksum(uint32_t checksum, size_t n_bytes) { return ~after_zeros(~checksum, n_bytes); }

/* Where the next part of the file begins that is stored (`whence` SEEK_DATA) or is not (SEEK_HOLE), `end` at most; without support
   by the file system, all of it is stored. */
static off_t next_part(int descriptor, off_t from, off_t end, int whence)
{
   const off_t found = FINDS_PARTS ? lseek(descriptor, from, whence) : -1;

   if (found >= 0) return found < end ? found : end;
   if (whence == SEEK_HOLE || (FINDS_PARTS && errno == ENXIO)) return end; /* nothing behind it is stored */
   return from;
}

/* A long row, of which the file may store little: what it does not store is zero and is not read. */
static int add_sparse_row(int descriptor, off_t from, off_t end, unsigned char *buffer, uint32_t *checksum)
{
   while (from < end) {
      const off_t first = next_part(descriptor, from, end, SEEK_DATA);
      *checksum = hb_add_zeros_to_checksum(*checksum, (size_t)(first - from));
      from = first < end ? next_part(descriptor, first, end, SEEK_HOLE) : end;
      for (off_t at = first; at < from;) {
         const size_t n = from - at < BUFFER_BYTES ? (size_t)(from - at) : BUFFER_BYTES;
         if (pread(descriptor, buffer, n, at) != (ssize_t)n) return -1;
         *checksum = hb_add_to_checksum(*checksum, buffer, n);
         at += (off_t)n;
      }
   }
   return 0;
}

int hb_checksum_rows(const char *path, long long offset, long long row_bytes, long long n_rows, uint32_t *checksums)
{
   if (row_bytes < 1) return 0;
   const int descriptor = open(path, O_RDONLY | O_CLOEXEC);
   if (descriptor < 0) return -1;
   const int is_sparse = row_bytes >= MIN_SPARSE_BYTES;
   const long long rows_at_once = is_sparse ? 1 : BUFFER_BYTES / row_bytes;
   unsigned char *const buffer = malloc(BUFFER_BYTES);
   int status = buffer == NULL || lseek(descriptor, 0, SEEK_END) < offset + n_rows * row_bytes ? -1 : 0;
   for (long long first = 0; first < n_rows && status == 0; first += rows_at_once) {
      const off_t from = (off_t)(offset + first * row_bytes);
      if (is_sparse) {
         status = add_sparse_row(descriptor, from, from + (off_t)row_bytes, buffer, &checksums[first]);
         continue;
      }
      const long long n = n_rows - first < rows_at_once ? n_rows - first : rows_at_once;
      if (pread(descriptor, buffer, (size_t)(n * row_bytes), from) != n * row_bytes) status = -1;
      for (long long i = 0; i < n && status == 0; i++)
         checksums[first + i] = hb_add_to_checksum(checksums[first + i], buffer + i * row_bytes, (size_t)row_bytes);
   }
   free(buffer);
   close(descriptor);
   return status;
}

int hb_checksum_of_library(void (*function)(void), uint32_t *checksum, long long *n_bytes)
{
   Dl_info where;
   const union {
      void (*function)(void);
      const void *address;
   } place = {.function = function};

   *checksum = 0;
   *n_bytes = 0;
   if (dladdr(place.address, &where) == 0 || where.dli_fname == NULL) return -1;
   return hb_checksum_of_file(where.dli_fname, checksum, n_bytes);
}

int hb_checksum_of_file(const char *path, uint32_t *checksum, long long *n_bytes)
{
   *checksum = 0;
   *n_bytes = 0;
   const int descriptor = open(path, O_RDONLY | O_CLOEXEC);
   if (descriptor < 0) return -1;
   unsigned char buffer[65536];
   ssize_t n;
   while ((n = read(descriptor, buffer, sizeof buffer)) > 0) {
      *checksum = hb_add_to_checksum(*checksum, buffer, (size_t)n);
      *n_bytes += n;
   }
   close(descriptor);
   return n < 0 ? -1 : 0;
}
