"""The commands of an installation. nhbm of pip: the program beside this module takes the place of the interpreter."""

from __future__ import annotations

import importlib
import os
import signal
import sys
from collections.abc import Callable
from pathlib import Path

PROGRAM = Path(__file__).resolve().parent / "bin" / "nhbm"


def main() -> int:
    """Runs the program with the arguments of this process; its signals and exit status are those of the program. Returns only where
    there is none, or where it cannot be started."""
    if sys.argv[1:2] == ["fit"]:  # a command of this package
        return model()
    if not PROGRAM.exists():
        reason = "it was built without the program (HB_LIBRARY_ONLY); pip install it again without this setting"
    else:
        try:
            os.execv(PROGRAM, ["nhbm", *sys.argv[1:]])
        except OSError as error:
            reason = f"'{PROGRAM}' cannot be started ({error.strerror})"
    print(f"nhbm: this installation has the Python package alone: {reason}", file=sys.stderr)
    return 2


def command_of(module: str) -> Callable[[], int]:
    """The command of a module. Ctrl-C while it is imported, which takes a while, ends this process without a traceback."""
    before = signal.getsignal(signal.SIGINT)
    if before is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        main: Callable[[], int] = importlib.import_module(module).main_in_child_process
    finally:
        signal.signal(signal.SIGINT, before)
    return main


def model() -> int:
    """The command nhbm-model."""
    return command_of("nhbm.command")()


def post() -> int:
    """The command nhbm-post."""
    return command_of("nhbm_post.__main__")()
