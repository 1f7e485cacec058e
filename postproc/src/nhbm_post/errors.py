"""Errors that are the caller's to mend; the command line prints them as one line and ends with status 2."""


class NhbmPostError(Exception):
    """Base of all errors that nhbm_post raises on purpose."""


class ReaderError(NhbmPostError):
    """A file, point, degree of freedom or harmonic is not as asked for; says which, and what there is."""


class UsageError(NhbmPostError):
    """A picture or table cannot be made from the data as asked."""
