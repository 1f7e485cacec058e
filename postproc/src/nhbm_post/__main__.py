"""Runs the command line, also with `python -m nhbm_post`."""

import sys

from nhbm.child_process import run_in_child_process

from .cli import main


def main_in_child_process() -> int:
    """The command `nhbm-post`."""
    return run_in_child_process(main, "nhbm-post")


if __name__ == "__main__":
    sys.exit(main_in_child_process())
