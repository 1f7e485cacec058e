"""Runs a command in a child process: in some damaged files the HDF5 library dies, or goes round for ever, and says nothing.

The packages nhbm_post and nhbm share this file.
"""

from __future__ import annotations

import functools
import mmap
import os
import signal
import sys
import traceback

import h5py

SECONDS, SECONDS_A_BYTE = 0.5, 2.0e-7  # of processor time that one call of the library may take, by the size of the file
_ROOM = 4096


def guarded(main, program: str) -> int:
    """Exit status of the command; 2 and a line on standard error when the library died in it, or was ended."""
    if not hasattr(os, "fork"):
        return main()
    sys.stdout.flush()
    place = mmap.mmap(-1, _ROOM)  # shared with the child, which says here what it reads
    child = os.fork()
    if child == 0:
        status = 1
        try:
            _watch(place)
            status = main()
        except SystemExit as end:  # argparse: help, or a mistake that it has told
            status = end.code if isinstance(end.code, int) else 1
        except BaseException:
            traceback.print_exc()
        finally:
            try:
                sys.stdout.flush()
                sys.stderr.flush()
            finally:
                os._exit(status)
    _, status = _wait(child)
    return _ending(status, program, place[:].partition(b"\0")[0].decode(errors="replace"))


def _watch(place: mmap.mmap) -> None:
    """From now on each call that reads says so, and the process is ended by a signal where it takes too long."""
    signal.signal(signal.SIGPROF, signal.SIG_DFL)
    is_inside = False

    def watched(call, entry, end):
        @functools.wraps(call)
        def reading(self, *args, **kwargs):
            nonlocal is_inside
            if is_inside:
                return end(call(self, *args, **kwargs))
            is_inside = True
            signal.setitimer(signal.ITIMER_PROF, SECONDS)
            try:
                file, name = entry(self, *args)
                text = os.fsencode(f"file '{file}'" + (f", at '{name}'" if name else ""))[: _ROOM - 1]
                place[: len(text) + 1] = text + b"\0"
                if os.path.isfile(file):
                    signal.setitimer(signal.ITIMER_PROF, SECONDS + SECONDS_A_BYTE * os.path.getsize(file))
                return end(call(self, *args, **kwargs))
            finally:
                signal.setitimer(signal.ITIMER_PROF, 0.0)
                is_inside = False

        return reading

    def member(self, name=None):
        return self.file.filename, name if isinstance(name, str) else self.name

    def attribute(self, name=""):
        return h5py.h5i.get_file_id(self._id).name.decode(errors="replace"), name

    def itself(value):
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
        setattr(owner, name, watched(getattr(owner, name), entry, end))


def _wait(child: int) -> tuple[int, int]:
    """Waits for the end; an interrupt of the keyboard reaches the child as well, which ends of it."""
    while True:
        try:
            return os.waitpid(child, 0)
        except KeyboardInterrupt:
            continue


def _ending(status: int, program: str, place: str) -> int:
    if os.WIFEXITED(status):
        return os.WEXITSTATUS(status)
    number = os.WTERMSIG(status)
    if number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL, signal.SIGPIPE):
        return 128 + number
    end = "found no end in it" if number == signal.SIGPROF else f"died of it ({signal.Signals(number).name})"
    told = f"{place}: HDF5 {end}; the file is damaged" if place else f"ended by {signal.Signals(number).name}"
    print(f"{program}: {told}", file=sys.stderr)
    return 2
