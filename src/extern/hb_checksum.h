/* Checksums by which damage is seen: CRC-32, as zlib has it (IEEE 802.3, 3.2.9). */
#ifndef HB_CHECKSUM_H
#define HB_CHECKSUM_H

#include <stddef.h>
#include <stdint.h>

/* Goes on with a checksum, 0 at the beginning, over further bytes. */
uint32_t hb_add_to_checksum(uint32_t checksum, const void *bytes, size_t n_bytes);

/* Goes on with the checksum of each row over the bytes that it has in a part of a file, where rows follow each other. Returns 0, or
   -1 where the file cannot be read there. */
int hb_checksum_rows(const char *path, long long offset, long long row_bytes, long long n_rows, uint32_t *checksums);

/* Checksum and length of the file from which the code of a function was loaded. Returns 0, or -1 where it cannot be read. */
int hb_checksum_of_library(void (*function)(void), uint32_t *checksum, long long *n_bytes);

#endif
