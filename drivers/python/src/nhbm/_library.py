"""The shared library: loading, structs and prototypes of nhbm.h and nhbm_user_law.h (ctypes), errors as exceptions."""

from __future__ import annotations

import ctypes
import ctypes.util
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from nhbm.errors import ModelError

API_VERSION = 1  # NHBM_API_VERSION
LAW_API = 2  # NHBM_USER_LAW_API_2
INVALID_ARGUMENT, BUSY, OUT_OF_MEMORY = -2, -4, -5  # enum nhbm_status
KEY_ROW_SIZE = 1201  # NHBM_KEY_ROW_SIZE
MAX_AXES = 4  # NHBM_MAX_AXES

INTERRUPT_CALLBACK = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p)


class ProgressOfWork(ctypes.Structure):
    """struct nhbm_progress."""

    _fields_ = [("seconds", ctypes.c_double), ("n_done", ctypes.c_int64), ("n_steps", ctypes.c_int64)]


PROGRESS_CALLBACK = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.POINTER(ProgressOfWork))
STRUCTURE_CALLBACK = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)


class Column(ctypes.Structure):
    """nhbm_column"""

    _fields_ = [
        ("data", ctypes.c_void_p),
        ("kind", ctypes.c_int),
        ("n_axes", ctypes.c_int),
        ("shape", ctypes.c_size_t * 4),
        ("n_values", ctypes.c_size_t),
        ("unit", ctypes.c_char_p),
        ("axes", ctypes.c_char_p),
    ]


class ColumnDescription(ctypes.Structure):
    """nhbm_column_description"""

    _fields_ = [
        ("long_name", ctypes.c_char_p),
        ("dof_units", ctypes.c_char_p),
        ("flag_meanings", ctypes.c_char_p),
        ("attributes", ctypes.c_char_p),
        ("lowest_flag", ctypes.c_int),
        ("kind", ctypes.c_int),
    ]


class Table(ctypes.Structure):
    """nhbm_table"""

    _fields_ = [
        ("n_rows", ctypes.c_size_t),
        ("n_columns", ctypes.c_size_t),
        ("declaration", ctypes.c_int),
        ("has_messages", ctypes.c_int),
        ("sizes", ctypes.c_void_p),
    ]


class TableColumn(ctypes.Structure):
    """nhbm_table_column"""

    _fields_ = [
        ("name", ctypes.c_char_p),
        ("unit", ctypes.c_char_p),
        ("axes", ctypes.c_char_p),
        ("description", ColumnDescription),
    ]


class Motion(ctypes.Structure):
    """nhbm_motion"""

    _fields_ = [
        ("n_tones", ctypes.c_size_t),
        ("n_harmonics", ctypes.c_size_t),
        ("n_dofs", ctypes.c_size_t),
        ("frequency", ctypes.c_void_p),
        ("tuples", ctypes.c_void_p),
        ("coefficients", ctypes.c_void_p),
        ("truncation_estimate", ctypes.c_double),
        ("aliasing_estimate", ctypes.c_double),
        ("frequency_estimate", ctypes.c_void_p),
        ("status", ctypes.c_int),
        ("n_unstable", ctypes.c_int),
    ]


class Census(ctypes.Structure):
    """nhbm_census"""

    _fields_ = [
        ("n_motions", ctypes.c_size_t),
        ("n_random", ctypes.c_int),
        ("n_random_lost", ctypes.c_int),
        ("n_directed", ctypes.c_int),
        ("n_directed_lost", ctypes.c_int),
        ("n_left", ctypes.c_int),
        ("n_once", ctypes.c_int),
        ("n_never", ctypes.c_int),
        ("is_reliable", ctypes.c_int),
        ("unseen", ctypes.c_double),
        ("unseen_bound", ctypes.c_double),
        ("missed", ctypes.c_double),
        ("least_share", ctypes.c_double),
    ]


class Sweep(ctypes.Structure):
    """nhbm_sweep"""

    _fields_ = [("n_points", ctypes.c_size_t), ("n_chains", ctypes.c_size_t)]


class CensusMotion(ctypes.Structure):
    """nhbm_census_motion"""

    _fields_ = [
        ("n_random", ctypes.c_int),
        ("n_directed", ctypes.c_int),
        ("start", ctypes.c_int),
        ("mirror_of", ctypes.c_int),
    ]


class LawInfo(ctypes.Structure):
    """nhbm_law_info_t"""

    _fields_ = [
        ("api_version", ctypes.c_int),
        ("n_coordinates", ctypes.c_int),
        ("n_parameters", ctypes.c_int),
        ("needs_velocity", ctypes.c_int),
        ("degree", ctypes.c_int),
        ("length_scale", ctypes.c_double),
        ("context", ctypes.c_void_p),
        ("needs_phases", ctypes.c_int),
        ("needs_frequencies", ctypes.c_int),
        ("n_states", ctypes.c_int),
        ("advance", ctypes.c_void_p),
        ("reserved", ctypes.c_void_p * 4),
    ]


class LawSamples(ctypes.Structure):
    """nhbm_law_samples_t, what a compiled law gets a pointer to."""

    _fields_ = [
        ("n_samples", ctypes.c_int),
        ("n_coordinates", ctypes.c_int),
        ("stride", ctypes.c_int),
        ("n_parameters", ctypes.c_int),
        ("z", ctypes.c_void_p),
        ("v", ctypes.c_void_p),
        ("parameters", ctypes.c_void_p),
        ("f", ctypes.c_void_p),
        ("df_dz", ctypes.c_void_p),
        ("df_dv", ctypes.c_void_p),
        ("context", ctypes.c_void_p),
        ("n_tones", ctypes.c_int),
        ("n_states", ctypes.c_int),
        ("phases", ctypes.c_void_p),
        ("frequencies", ctypes.c_void_p),
        ("states", ctypes.c_void_p),
        ("df_ds", ctypes.c_void_p),
    ]


class LawStep(ctypes.Structure):
    """nhbm_law_step_t, what a compiled `advance` gets a pointer to."""

    _fields_ = [
        ("n_samples", ctypes.c_int),
        ("n_coordinates", ctypes.c_int),
        ("n_states", ctypes.c_int),
        ("stride", ctypes.c_int),
        ("n_parameters", ctypes.c_int),
        ("z", ctypes.c_void_p),
        ("z_before", ctypes.c_void_p),
        ("rise", ctypes.c_void_p),
        ("rise_before", ctypes.c_void_p),
        ("states_before", ctypes.c_void_p),
        ("parameters", ctypes.c_void_p),
        ("states", ctypes.c_void_p),
        ("ds_dbefore", ctypes.c_void_p),
        ("ds_dz", ctypes.c_void_p),
        ("ds_dz_before", ctypes.c_void_p),
        ("ds_drise", ctypes.c_void_p),
        ("ds_drise_before", ctypes.c_void_p),
        ("context", ctypes.c_void_p),
    ]

EVALUATE = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.POINTER(LawSamples))
ADVANCE = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.POINTER(LawStep))


def whole_numbers(values: Any) -> Any:
    """An array of C that holds these numbers, or shares those of an int32 array.

    An argument whose conversion runs Python code, as those of numpy.ctypeslib do, turns an interrupt into an ArgumentError."""
    held: Any = np.require(values, np.int32, ("C", "W"))
    return (ctypes.c_int * held.size).from_buffer(held)


def real_numbers(values: Any) -> Any:
    """An array of C that holds these numbers, or shares those of a float64 array."""
    held: Any = np.require(values, np.float64, ("C", "W"))
    return (ctypes.c_double * held.size).from_buffer(held)


def _paths() -> Iterator[str]:
    """Where the shared library may be: NHBM_LIBRARY, beside this package, in the build of this checkout, in the folder `lib` of
    this installation, of the system."""
    if "NHBM_LIBRARY" in os.environ:
        yield os.environ["NHBM_LIBRARY"]
        return
    here = Path(__file__).resolve()
    for path in (here.parent / "libnhbm.so", *(parent / "build/release/lib/libnhbm.so" for parent in here.parents)):
        if path.is_file():
            yield str(path)
    for pattern in ("libnhbm.so", "*/libnhbm.so"):
        yield from map(str, here.parents[3].glob(pattern))
    found = ctypes.util.find_library("nhbm")
    if found:
        yield found


def _load() -> ctypes.CDLL:
    paths = list(_paths())
    if not paths:
        raise ModelError("libnhbm.so was not found; NHBM_LIBRARY may hold its path")
    try:
        loaded = ctypes.CDLL(paths[0])
        version = loaded.nhbm_get_api_version()
    except (OSError, AttributeError) as fault:
        raise ModelError(f"{paths[0]} is not a library of this version of nhbm: {fault}") from None
    if version != API_VERSION:
        raise ModelError(f"{paths[0]} has version {version} of the interface, this package needs {API_VERSION}")
    _declare(loaded)
    return loaded


def _declare(loaded: ctypes.CDLL) -> None:
    """The prototypes of nhbm.h; functions return a status unless this says something else."""
    text, number, real, pointer = ctypes.c_char_p, ctypes.c_int, ctypes.c_double, ctypes.c_void_p
    count, texts, numbers, column = ctypes.c_size_t, ctypes.POINTER(text), ctypes.POINTER(number), ctypes.POINTER(Column)
    description = ctypes.POINTER(ColumnDescription)
    integers, reals = ctypes.POINTER(number), ctypes.POINTER(real)  # `whole_numbers`, `real_numbers`
    for name, arguments in {
        "create": (ctypes.POINTER(pointer),),
        "destroy": (ctypes.POINTER(pointer),),
        "read_input": (pointer, text, text),
        "get_input": (pointer, texts),
        "get_given_input": (pointer, texts),
        "get_libraries": (pointer, texts),
        "clear": (pointer, text),
        "add_group": (pointer, text, numbers),
        "find_group": (pointer, text, numbers),
        "remove_group": (pointer, number),
        "set_real": (pointer, number, text, real),
        "set_reals": (pointer, number, text, count, reals),
        "set_integers": (pointer, number, text, count, integers),
        "set_logicals": (pointer, number, text, count, integers),
        "set_texts": (pointer, number, text, count, texts),
        "check_group": (pointer, number),
        "check": (pointer,),
        "set_structure_callback": (pointer, STRUCTURE_CALLBACK, pointer),
        "structure_set_dofs": (pointer, text, text, real),
        "structure_set_matrix": (pointer, text, count, count, integers, integers, reals),
        "structure_add_load": (pointer, text, count, integers, reals),
        "structure_set_nodes": (pointer, count, count, integers, text),
        "structure_set_coordinates": (pointer, count, reals),
        "structure_add_node_set": (pointer, text, count, integers),
        "structure_set_error": (pointer, text),
        "register_law": (text, ctypes.POINTER(LawInfo), EVALUATE),
        "unregister_law": (text,),
        "set_interrupt_callback": (pointer, INTERRUPT_CALLBACK, pointer),
        "set_progress_callback": (pointer, PROGRESS_CALLBACK, pointer),
        "solve": (pointer, number),
        "set_point_count": (pointer, count),
        "curve_begin": (pointer,),
        "curve_lengthen": (pointer, count),
        "curve_next": (pointer, numbers),
        "sweep_begin": (pointer, ctypes.POINTER(Sweep)),
        "sweep_select": (pointer, count, count),
        "sweep_next": (pointer, numbers),
        "sweep_number_branches": (pointer, count, count, integers, integers, reals, integers),
        "integrate": (pointer,),
        "set_verification_time": (pointer, real),
        "verify": (pointer, number),
        "verify_motion": (pointer, ctypes.POINTER(Motion), number),
        "take_census": (pointer, number, number, ctypes.c_double, ctypes.POINTER(Census)),
        "select_census_motion": (pointer, count, ctypes.POINTER(CensusMotion)),
        "get_advice": (pointer, number, texts),
        "describe_advice": (pointer, text, count, pointer, text, texts),
        "get_natural_frequencies": (pointer, ctypes.POINTER(count), ctypes.POINTER(pointer)),
        "get_column": (pointer, text, column),
        "get_column_names": (pointer, texts),
        "describe_column": (pointer, text, description),
        "describe_time_column": (pointer, text, description),
        "get_time_column": (pointer, text, column),
        "get_time_column_names": (pointer, texts),
        "clear_table": (pointer,),
        "add_row": (pointer,),
        "get_table": (pointer, ctypes.POINTER(Table)),
        "describe_table_column": (pointer, count, ctypes.POINTER(TableColumn)),
        "copy_columns": (pointer, count, count, pointer, count),
        "get_row_message": (pointer, count, texts),
        "get_table_labels": (pointer, text, texts),
        "get_outcome": (pointer, numbers, numbers),
        "get_labels": (pointer, text, texts),
        "get_message": (pointer, texts),
        "get_key_row": (count, text, count),
    }.items():
        getattr(loaded, f"nhbm_{name}").argtypes = arguments
    loaded.nhbm_get_last_error.restype = loaded.nhbm_get_version.restype = loaded.nhbm_get_commit.restype = text
    loaded.nhbm_get_key_count.restype = count


_loaded: ctypes.CDLL | None = None


def library() -> ctypes.CDLL:
    """The shared library, loaded at the first call."""
    global _loaded
    if _loaded is None:
        _loaded = _load()
    return _loaded


def last_error() -> str:
    """Message of the last function that failed in this thread."""
    message: bytes = library().nhbm_get_last_error()
    return message.decode(errors="replace")


def raise_error(status: int) -> NoReturn:
    """Raises the last error of this thread: RuntimeError if the model is in use, MemoryError, else ModelError."""
    if status == BUSY:
        raise RuntimeError(f"{last_error()}; a session can be used by one thread at a time, and not from its own callbacks")
    raise MemoryError(last_error()) if status == OUT_OF_MEMORY else ModelError(last_error())
