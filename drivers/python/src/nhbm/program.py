"""The command nhbm of an installation by pip: the program beside this module takes the place of the interpreter."""

from __future__ import annotations

import os
import sys
from pathlib import Path

PROGRAM = Path(__file__).resolve().parent / "bin" / "nhbm"


def main() -> int:
    """Runs the program with the arguments of this process; its signals and exit status are those of the program. Returns only where
    there is none, or where it cannot be started."""
    if sys.argv[1:2] == ["fit"]:  # a command of this package
        from nhbm.command import main_in_child_process

        return main_in_child_process()
    if not PROGRAM.exists():
        reason = "it was built without the program (HB_LIBRARY_ONLY); pip install it again without this setting"
    else:
        try:
            os.execv(PROGRAM, ["nhbm", *sys.argv[1:]])
        except OSError as error:
            reason = f"'{PROGRAM}' cannot be started ({error.strerror})"
    print(f"nhbm: this installation has the Python package alone: {reason}", file=sys.stderr)
    return 2
