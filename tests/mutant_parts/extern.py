"""Mutants of src/extern."""

from mutant_parts.mutant import of

MUTANTS = [
    *of(
        "extern/hb_blas.c",
        (
            "blas_threads",
            "test_hb_blas_threads",
            "BLAS keeps all its threads",
            "   openblas_set_num_threads(1);",
            "   (void)0;",
        ),
        (
            "blas_asked",
            "test_hb_blas_threads",
            "BLAS gets one thread against what the user asks for",
            "if (value != NULL && *value != '\\0') return;",
            "if (value != NULL && *value == '\\1') return;",
        ),
    ),
    *of(
        "extern/hb_checksum.c",
        (
            "checksum_zeros",
            "test_hb_checksum",
            "long runs of zeros do not count",
            "crc = after_zeros(crc, n_zeros);",
            "",
        ),
        (
            "checksum_tail",
            "test_hb_checksum",
            "the last bytes of a row do not count",
            "for (; n_bytes > 0; n_bytes--, b++) crc",
            "for (; n_bytes > 7; n_bytes--, b++) crc",
        ),
        (
            "checksum_byte",
            "test_hb_checksum",
            "one byte of eight does not count",
            "table[1][b[6]] ^",
            "table[1][0] ^",
        ),
        (
            "checksum_row",
            "test_hb_checksum",
            "rows go on with the checksum of the first",
            "checksums[first + i] = hb_add_to_checksum(checksums[first + i], buffer",
            "checksums[first + i] = hb_add_to_checksum(checksums[first], buffer",
        ),
    ),
    *of(
        "extern/hb_lock.c",
        (
            "lock_none",
            "test_two_threads",
            "two threads touch the store of plans at once",
            "(void)pthread_mutex_lock(&mutex);",
            "(void)mutex;",
        ),
    ),
    *of(
        "extern/hb_hdf5.f90",
        (
            "hdf5_axes",
            "test_hb_hdf5",
            "a matrix is read as a vector",
            "if (size(found) /= size(extents)) then",
            "if (size(found) > 2) then",
        ),
        (
            "hdf5_expected",
            "test_hb_hdf5",
            "a vector of another length is taken",
            "else if (any(found /= extents)) then",
            "else if (any(found < extents)) then",
        ),
    ),
]
