"""What shells and `man` show of a command, from its argparse table: completion for bash and zsh, and the manual page."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Any


def add_verbs(command: argparse.ArgumentParser, verbs: Any) -> None:
    """Adds the verbs `completion` and `help` to `verbs` of a command; `run` of their options prints."""
    name = command.prog
    verb = verbs.add_parser(
        "completion",
        help="completion in bash or zsh",
        description=f"Prints the script by which a shell completes verbs, options and words: source <({name} completion bash).",
    )
    verb.add_argument("shell", choices=("bash", "zsh"), help="bash or zsh")
    verb.set_defaults(run=lambda options: _print(completion(command, options.shell)), file=None)
    text = f"this text; {name} help VERB: one verb; {name} help man: all as a manual page, for man"
    verb = verbs.add_parser("help", help=text, description=f"Prints {text}.")
    verb.add_argument("topic", nargs="?", choices=(*verbs.choices, "man"), metavar="VERB", help="a verb, or man")
    verb.set_defaults(run=lambda options: _print(_help(command, options.topic)), file=None)


def _print(text: str) -> int:
    print(text)
    return 0


def _help(command: argparse.ArgumentParser, topic: str | None) -> str:
    if topic == "man":
        return manual(command)
    return (_verbs(command)[topic][0] if topic else command).format_help().rstrip()


def _verbs(command: argparse.ArgumentParser) -> dict[str, tuple[argparse.ArgumentParser, str]]:
    """Parser and line of help of each verb."""
    found = next(action for action in command._actions if isinstance(action, argparse._SubParsersAction))
    return {entry.dest: (found.choices[entry.dest], entry.help or "") for entry in found._choices_actions}


def _arguments(verb: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    return (action for action in verb._actions if action.help != argparse.SUPPRESS)


def completion(command: argparse.ArgumentParser, shell: str) -> str:
    """The script by which bash, or zsh with the ways of bash, completes verbs, their options, words of options and files."""
    verbs = {name: verb for name, (verb, _) in _verbs(command).items()}
    function = "_" + command.prog.replace("-", "_")
    lines = [f"#compdef {command.prog}", "autoload -U +X bashcompinit && bashcompinit"] if shell == "zsh" else []
    lines += [
        f"{function}() {{",
        "   local word=${COMP_WORDS[COMP_CWORD]} words=",
        f"   [ $COMP_CWORD = 1 ] && words='{' '.join(verbs)}' || case \"${{COMP_WORDS[1]}} ${{COMP_WORDS[COMP_CWORD-1]}}\" in",
    ]
    for name, verb in verbs.items():
        for action in _arguments(verb):
            patterns = "|".join(f"'{name} {before}'" for before in action.option_strings or [name])
            words = action.choices or getattr(action, "examples", ())  # some of the values that it takes
            if words:
                lines.append(f"   {patterns}) words='{' '.join(map(str, words))}' ;;")
    lines += ["   *) [[ $word == -* ]] && case ${COMP_WORDS[1]} in"]
    for name, verb in verbs.items():
        options = [option for action in _arguments(verb) for option in action.option_strings]
        lines.append(f"      {name}) words='{' '.join(options)}' ;;")
    lines += [
        "      esac ;;",
        "   esac",
        '   COMPREPLY=($(compgen -W "$words" -- "$word"))',
        "}",
        f"complete -o default -F {function} {command.prog}",
    ]
    if shell == "zsh":  # run by the first completion itself, as a file of $fpath
        lines.append(f"(($#compstate)) && _bash_complete -o default -F {function}")
    return "\n".join(lines)


def manual(command: argparse.ArgumentParser) -> str:
    """The manual page in troff."""
    from nhbm import __version__

    opening, _, details = (command.description or "").partition("\n\n")
    lines = [
        f'.TH {command.prog.upper()} 1 "" "nhbm {__version__}" "User commands"',
        ".SH NAME",
        f"{command.prog} \\- {_troff(opening.strip())}",
        ".SH SYNOPSIS",
        f".B {_troff(command.prog)}",
        "VERB [FILE] [options]",
    ]
    if details:
        lines += [".SH DESCRIPTION", _troff(details)]
    lines.append(".SH VERBS")
    for name, (verb, line) in _verbs(command).items():
        files = " ".join(_invocation(action) for action in _arguments(verb) if not action.option_strings)
        lines += [f".SS {name} {_troff(files)}", _troff(verb.description or line)]
        for action in _arguments(verb):
            if action.help and action.dest != "help":
                lines += [".TP", f".B {_troff(_invocation(action))}", _troff(_text(verb, action))]
    return "\n".join(lines)


def _invocation(action: argparse.Action) -> str:
    """An argument as it is written: `--output, -o PATH`."""
    words = "{" + ",".join(map(str, action.choices)) + "}" if action.choices else action.dest.upper()
    value = "" if action.nargs == 0 else str(action.metavar or words)
    return " ".join(part for part in (", ".join(action.option_strings), value) if part)


def _text(verb: argparse.ArgumentParser, action: argparse.Action) -> str:
    return verb._get_formatter()._expand_help(action)


def _troff(text: str) -> str:
    """A text in one line that troff prints as it stands."""
    text = " ".join(text.split()).replace("\\", "\\e").replace("-", "\\-")
    return "\\&" + text if text[:1] in (".", "'") or not text else text
