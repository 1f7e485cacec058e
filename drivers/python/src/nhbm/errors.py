"""Errors of a model, each reported once and with the entry that is wrong."""

from __future__ import annotations

import difflib
import functools
import importlib
import os
import stat
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any, TypeVar, cast

_Function = TypeVar("_Function", bound=Callable[..., Any])
_EXTRAS = {"matplotlib": "plot", "meshio": "fe", "pyyeti": "op4", "ross": "ross", "skfem": "fe"}  # of pyproject.toml


class ModelError(Exception):
    """A model or a model file is invalid."""


class NotConverged(UserWarning):
    """A motion was not found, or is doubtful: less accurate than requested, or with a law whose derivatives are wrong."""


class Jump(UserWarning):
    """Neighbouring points of a sweep belong to different branches of motions."""


class Implausible(UserWarning):
    """A model can be solved, but suggests a mistake: a stop that no motion reaches, a gap of a kilometre, negative damping, a tone
    far above or below all natural frequencies, no load."""


def without_own_frames(function: _Function) -> _Function:
    """A public function whose errors end where it was called: the frames below, unless they are of functions of the user, are not
    shown."""

    @functools.wraps(function)
    def call(*arguments: Any, **options: Any) -> Any:
        __tracebackhide__ = True
        try:
            return function(*arguments, **options)
        except (ModelError, KeyError) as error:
            raise error.with_traceback(foreign_frames(error)) from error.__cause__

    return cast(_Function, call)


def foreign_frames(error: BaseException) -> TracebackType | None:
    """The frames of an error that a public function raises again: none if all of them are of this package."""
    frames = error.__traceback__
    below = frames
    while below is not None:
        if str(below.tb_frame.f_globals.get("__name__", "")).partition(".")[0] != "nhbm":
            return frames
        below = below.tb_next
    return None


def check_file(path: Any, what: str = "file") -> None:
    """Raises ModelError where there is no file to be read: none, a folder, or one behind a folder that is closed."""
    try:
        mode = os.stat(path).st_mode
    except (FileNotFoundError, NotADirectoryError):
        raise ModelError(f"{what} '{path}' does not exist") from None
    except OSError as error:
        raise ModelError(f"{what} '{path}' cannot be read: {error.strerror}") from None
    if stat.S_ISDIR(mode):
        raise ModelError(f"'{path}' is a folder")


def imported(module: str, purpose: str, package: str = "") -> Any:
    """An optional module; ModelError names the package that has it, and the extra of nhbm that installs it."""
    try:
        return importlib.import_module(module)
    except ImportError:
        top = module.split(".")[0]
        extra = f", or in the folder of nhbm: pip install '.[{_EXTRAS[top]}]'" if top in _EXTRAS else ""
        name = package or top
        raise ModelError(f"{purpose} {name}, which is not installed: pip install {name}{extra}") from None


def meant(name: str, known: Sequence[str]) -> str:
    """The end of a message on an unknown name: the known one that is like it, if there is one."""
    lower = {other.lower(): other for other in reversed(known)}
    close = difflib.get_close_matches(name.lower(), lower, 1, 0.7)
    return f"; did you mean '{lower[close[0]]}'?" if close else ""


def among(name: str, known: Sequence[str]) -> str:
    """The end of a message on an unknown name: the known one that is like it, or all known ones."""
    return meant(name, known) or f"; known: {', '.join(known)}"
