/* Checksums that detect damage: CRC-32 as in zlib (IEEE 802.3, 3.2.9). */
#ifndef HB_CHECKSUM_H
#define HB_CHECKSUM_H

#include <stddef.h>
#include <stdint.h>

/* Continues a checksum, 0 at the beginning, over further bytes. */
uint32_t hb_add_to_checksum(uint32_t checksum, const void *bytes, size_t n_bytes);

/* Continues a checksum over bytes that are zero. */
uint32_t hb_add_zeros_to_checksum(uint32_t checksum, size_t n_bytes);

/* Continues the checksum of each row over its bytes in a part of a file in which rows are contiguous; parts that the file does not
   store are zero and are not read. Returns 0, or -1 if the file cannot be read there. */
int hb_checksum_rows(const char *path, long long offset, long long row_bytes, long long n_rows, uint32_t *checksums);

/* Checksum and length of a file. Returns 0, or -1 if it cannot be read. */
int hb_checksum_of_file(const char *path, uint32_t *checksum, long long *n_bytes);

/* The same of the file from which the code of a function was loaded. */
int hb_checksum_of_library(void (*function)(void), uint32_t *checksum, long long *n_bytes);

#endif
