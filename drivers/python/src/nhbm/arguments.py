"""Command lines. The packages nhbm_post and nhbm share this module."""

from __future__ import annotations

import argparse
import difflib
import re
from typing import NoReturn


class Parser(argparse.ArgumentParser):
    """A parser that reports an error in one line, with status 2, and names the closest choice to a misspelt one."""

    def error(self, message: str) -> NoReturn:
        """Ends the process with the message."""
        wrong = re.search(r"invalid choice: '(.*?)' \(choose from (.*)\)", message)
        close = difflib.get_close_matches(wrong[1], re.findall(r"[\w-]+", wrong[2]), 1) if wrong else []
        message += f"; did you mean '{close[0]}'?" if close else ""
        self.exit(2, f"{self.prog}: {message} (see {self.prog} --help)\n")
