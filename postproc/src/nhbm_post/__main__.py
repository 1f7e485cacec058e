"""Runs the command line, also with `python -m nhbm_post`."""

import sys

from .cli import main
from .guard import guarded


def guarded_main() -> int:
    """The command `nhbm-post`."""
    return guarded(main, "nhbm-post")


if __name__ == "__main__":
    sys.exit(guarded_main())
