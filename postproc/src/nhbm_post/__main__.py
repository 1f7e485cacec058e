"""Runs the command line, also with `python -m nhbm_post`."""

import sys

from nhbm.guard import guarded

from .cli import main


def guarded_main() -> int:
    """The command `nhbm-post`."""
    return guarded(main, "nhbm-post")


if __name__ == "__main__":
    sys.exit(guarded_main())
