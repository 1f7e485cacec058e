"""Command lines. The packages nhbm_post and nhbm share this module."""

from __future__ import annotations

import argparse
import difflib
import re
import sys
from typing import Any, NoReturn


class Parser(argparse.ArgumentParser):
    """A parser that reports an error in one line, with status 2, and names the closest choice to a misspelt one."""

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """The options; words that a verb does not know are an error of this verb, with the option that they are like."""
        found, rest = self.parse_known_args(args, namespace)
        if rest:
            verbs = next((a for a in self._actions if isinstance(a, argparse._SubParsersAction)), None)
            parser = self if verbs is None else verbs.choices.get(getattr(found, verbs.dest), self)
            words = [word.partition("=")[0] for word in rest if word.startswith("-")]
            close = difflib.get_close_matches(words[0], parser._option_string_actions, 1) if words else []
            hint = f"; did you mean '{close[0]}'?" if close else ""
            given = sys.argv[1:] if args is None else list(args)
            before = next((word for word in reversed(given[: given.index(rest[0])]) if word.startswith("-")), "")
            if not words and isinstance(parser._option_string_actions.get(before), argparse._AppendAction):
                hint = f": repeat the option for each, {before} {rest[0]}"
            elif not words:
                files = [a.option_strings[-1] for a in parser._actions if a.metavar in ("STEM", "FILE") and a.option_strings]
                hint = f": give it to an option, such as {files[0]}" if files else ""
            parser.error(f"unknown: {' '.join(rest)}{hint}")
        return found

    def error(self, message: str) -> NoReturn:
        """Ends the process with the message."""
        wrong = re.search(r"invalid choice: '(.*?)' \(choose from (.*)\)", message)
        close = difflib.get_close_matches(wrong[1], re.findall(r"[\w-]+", wrong[2]), 1) if wrong else []
        if wrong and close:  # without the list of all
            message = message.replace(wrong[0], f"'{wrong[1]}' is unknown; did you mean '{close[0]}'?")
        self.exit(2, f"{self.prog}: {message} (see {self.prog} --help)\n")
