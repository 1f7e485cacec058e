"""What goes wrong with a model, said once and with the entry that is wrong."""


class ModelError(Exception):
    """A model or a model file is invalid."""


class NotConverged(UserWarning):
    """A motion was not found, or does not satisfy its tolerance."""
