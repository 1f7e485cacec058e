"""Runs the command line in a child process: the HDF5 library dies in some files that are damaged, and then says nothing."""

from __future__ import annotations

import os
import signal
import sys

from .cli import main


def guarded_main() -> int:
    """Exit status of the command; 2 and a line on standard error when the process died of a signal."""
    if not hasattr(os, "fork"):
        return main()
    sys.stdout.flush()
    child = os.fork()
    if child == 0:
        status = 1
        try:
            status = main()
        except SystemExit as end:  # argparse: help, or a mistake that it has told
            status = end.code if isinstance(end.code, int) else 1
        finally:
            try:
                sys.stdout.flush()
                sys.stderr.flush()
            finally:
                os._exit(status)
    return _ending(*_wait(child))


def _wait(child: int) -> tuple[int, int]:
    """Waits for the end; an interrupt of the keyboard reaches the child as well, which ends of it."""
    while True:
        try:
            return os.waitpid(child, 0)
        except KeyboardInterrupt:
            continue


def _ending(_child: int, status: int) -> int:
    if os.WIFEXITED(status):
        return os.WEXITSTATUS(status)
    name = signal.Signals(os.WTERMSIG(status)).name
    if name not in ("SIGINT", "SIGTERM", "SIGKILL", "SIGPIPE"):
        print(f"nhbm-post: ended by {name} inside the HDF5 library; the file may be damaged", file=sys.stderr)
        return 2
    return 128 + os.WTERMSIG(status)
