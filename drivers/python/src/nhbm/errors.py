"""What goes wrong with a model, said once and with the entry that is wrong."""


class ModelError(Exception):
    """A model, or a file that should hold one, is not what it must be."""


class NotConverged(UserWarning):
    """A motion was not found, or misses what was asked for."""
