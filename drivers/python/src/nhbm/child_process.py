"""Runs a command in a child process, because the HDF5 library crashes or loops without a message on some damaged files. The output
of the child process reaches the terminal without control characters; a file that is incomplete when the process ends is removed.

The packages nhbm_post and nhbm share this module.
"""

from __future__ import annotations

import ctypes
import functools
import mmap
import os
import secrets
import signal
import sys
import traceback
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import h5py

SECONDS, SECONDS_A_BYTE = 0.5, 2.0e-7  # of processor time that one call of the library may take, by the size of the file
_TEXT_SIZE = 4096
_PR_SET_PDEATHSIG = 1  # of linux/prctl.h
_TERMINATION = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGUSR1, signal.SIGUSR2)
_unfinished: mmap.mmap | None = None  # path of the file that the child process is writing


def run_in_child_process(main: Any, program: str, interrupted: int | None = None) -> int:
    """Exit status of the command; 2 and a line on standard error if the process crashed or exceeded its time in the library.
    After a signal `interrupted`, by default 128 plus its number."""
    global _unfinished
    if not hasattr(os, "fork"):
        return main()
    sys.stdout.flush()
    location = mmap.mmap(-1, _TEXT_SIZE)  # shared memory: what the child process is reading
    _unfinished = mmap.mmap(-1, _TEXT_SIZE)
    signal.pthread_sigmask(signal.SIG_BLOCK, _TERMINATION)  # until both processes have their handlers
    parent = os.getpid()
    child = os.fork()
    if child == 0:
        status = 1
        _end_with(parent)
        for number in _TERMINATION:
            signal.signal(number, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _TERMINATION)
        sys.stdout, sys.stderr = _Printable(sys.stdout), _Printable(sys.stderr)
        try:
            _limit_reading_time(location)
            status = main()
        except SystemExit as end:  # argparse: help, or an error that it has reported
            status = end.code if isinstance(end.code, int) else 1
        except MemoryError:
            print(f"{program}: there is not enough memory", file=sys.stderr)
            status = 2
        except BaseException:
            traceback.print_exc()
        finally:
            try:
                sys.stdout.flush()
            except BrokenPipeError:  # the reader has closed the pipe
                pass
            except OSError as error:
                status = 2
                print(f"{program}: standard output cannot be written ({error.strerror})", file=sys.stderr)
            finally:
                with suppress(OSError):
                    sys.stderr.flush()
                os._exit(status)
    # Signals end the child process; this process then removes its incomplete file.
    before = {number: signal.signal(number, lambda number, _: os.kill(child, number)) for number in _TERMINATION}
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _TERMINATION)
    _, status = os.waitpid(child, 0)
    left = _unfinished[:].partition(b"\0")[0]
    if left:
        with suppress(OSError):
            os.unlink(left)
    for number, handler in before.items():
        signal.signal(number, handler)
    if interrupted is not None and os.WIFSIGNALED(status) and os.WTERMSIG(status) in _TERMINATION:
        print(f"{program}: ended by {signal.Signals(os.WTERMSIG(status)).name} before there was a result", file=sys.stderr)
        return interrupted
    return _ending(status, program, location[:].partition(b"\0")[0].decode(errors="replace"))


def is_input(path: Any, options: Any) -> bool:
    """Whether the file that a command is to write is one that another of its options names, also as NAME=FILE."""
    words = [word for name, value in vars(options).items() if name != "output" for word in _words(value)]
    for word in [*words, *(word.partition("=")[2] for word in words)]:
        with suppress(OSError, ValueError):  # most words are not files
            if os.path.samefile(path, word):
                return True
    return False


def _words(value: Any) -> list[str]:
    if isinstance(value, (list, tuple)):
        return [word for entry in value for word in _words(entry)]
    return [os.fspath(value)] if isinstance(value, (str, Path)) else []


def _end_with(parent: int) -> None:
    """Lets this process end when its parent process does, even by SIGKILL (Linux)."""
    if sys.platform != "linux":
        return
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it ended before
        os._exit(1)


@contextmanager
def atomic_write(path: Any) -> Any:
    """Yields the name of a temporary file beside `path`, synchronises it with the disk and renames it to `path`. If this fails or
    the process ends before, an existing file is unchanged and the temporary file is removed. A symbolic link is followed."""
    path = Path(os.path.realpath(path))
    if path.exists() and not path.is_file():
        raise OSError(0, "it is a folder" if path.is_dir() else "not a regular file", str(path))
    name = str(path.with_name(f"{path.stem[:40]}.{secrets.token_hex(4)}.part{path.suffix}"))
    _note_unfinished(name)
    try:
        try:
            descriptor = os.open(name, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(path)) from None
        try:
            if path.exists():
                os.fchmod(descriptor, path.stat().st_mode & 0o777)
        finally:
            os.close(descriptor)
        yield name
        _sync(name)
        os.replace(name, path)
    except BaseException:
        with suppress(OSError):
            os.unlink(name)
        raise
    finally:
        _note_unfinished("")
    _sync(path.parent)


def _sync(path: Any) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _note_unfinished(name: str) -> None:
    """Records the file that the parent process removes if this process ends before it is complete."""
    if _unfinished is None:
        return
    text = os.fsencode(os.path.abspath(name) if name else "")
    if len(text) < _TEXT_SIZE:
        _unfinished[: len(text) + 1] = text + b"\0"


def printable(text: str) -> str:
    """A text from files or command lines without control characters, which are shown as `\\x1b`."""
    return "".join(c if c == "\n" or c.isprintable() else _shown(c) for c in text)


def _shown(character: str) -> str:
    code = ord(character)
    code = code - 0xDC00 if 0xDC80 <= code <= 0xDCFF else code  # a byte of a name that is no UTF-8
    return f"\\x{code:02x}" if code < 256 else f"\\u{code:04x}"


class _Printable:
    """A stream that writes printable characters only."""

    def __init__(self, stream: Any) -> None:
        self._stream = stream
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")

    def write(self, text: str) -> int:
        self._stream.write(printable(text))
        return len(text)

    def __getattr__(self, name: Any) -> Any:
        return getattr(self._stream, name)


def _limit_reading_time(location: mmap.mmap) -> None:
    """From now on each call that reads records what it reads, and SIGPROF ends the process if the call takes too long."""
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    is_inside = False

    def limited(call: Any, entry: Any, end: Any) -> Any:
        @functools.wraps(call)
        def reading(self: Any, *args: Any, **kwargs: Any) -> Any:
            nonlocal is_inside
            if is_inside:
                return end(call(self, *args, **kwargs))
            is_inside = True
            signal.setitimer(signal.ITIMER_PROF, SECONDS)
            try:
                file, name = entry(self, *args)
                text = os.fsencode(f"file '{file}'" + (f", at '{name}'" if name else ""))[: _TEXT_SIZE - 1]
                location[: len(text) + 1] = text + b"\0"
                if isinstance(file, (str, bytes, os.PathLike)) and os.path.isfile(file):
                    signal.setitimer(signal.ITIMER_PROF, SECONDS + SECONDS_A_BYTE * os.path.getsize(file))
                return end(call(self, *args, **kwargs))
            finally:
                signal.setitimer(signal.ITIMER_PROF, 0.0)
                is_inside = False

        return reading

    def member(self: Any, name: Any = None) -> Any:
        return self.file.filename, name if isinstance(name, str) else self.name

    def attribute(self: Any, name: str = "") -> Any:
        return h5py.h5i.get_file_id(self._id).name.decode(errors="replace"), name

    def itself(value: Any) -> Any:
        return value

    for owner, name, entry, end in (
        (h5py.File, "__init__", lambda self, path, *_: (path, ""), itself),
        (h5py.Group, "__getitem__", member, itself),
        (h5py.Group, "__contains__", member, itself),
        (h5py.Group, "__iter__", member, lambda names: iter(list(names))),
        (h5py.Dataset, "__getitem__", lambda self, *_: member(self), itself),
        (h5py.AttributeManager, "__getitem__", attribute, itself),
        (h5py.AttributeManager, "__contains__", attribute, itself),
    ):
        setattr(owner, name, limited(getattr(owner, name), entry, end))


def _ending(status: int, program: str, location: str) -> int:
    if os.WIFEXITED(status):
        return os.WEXITSTATUS(status)
    number = os.WTERMSIG(status)
    if number in (*_TERMINATION, signal.SIGKILL, signal.SIGPIPE):
        return 128 + number
    end = "exceeded its time" if number == signal.SIGPROF else f"crashed ({signal.Signals(number).name})"
    text = f"{location}: HDF5 {end}; the file is damaged" if location else f"ended by {signal.Signals(number).name}"
    print(printable(f"{program}: {text}"), file=sys.stderr)
    return 2
