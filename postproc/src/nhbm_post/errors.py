"""Errors that the caller can correct; the command line prints them as one line and ends with status 2."""


class NhbmPostError(Exception):
    """Base class of the errors that nhbm_post raises."""


class ReaderError(NhbmPostError):
    """A file, point, degree of freedom or harmonic does not exist or is invalid; the message names it and the alternatives."""


class UsageError(NhbmPostError):
    """A picture or table cannot be made from the data as requested."""
