"""Laws that Numba compiles: functions of one sample, called without Python in between."""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from typing import Any

from nhbm.laws import Law, LawSamples


def compiled(force: Callable[..., float], slopes: Callable[..., Any], *, velocity: bool = True, **options: Any) -> Law:
    """A law of one coordinate from two functions of numbers that Numba can compile.

    Parameters
    ----------
    force : force(q, v, p), the force [N] at the displacement q [m] and velocity v [m/s]; p are the parameters of the input
    slopes : slopes(q, v, p), its derivatives (df/dq, df/dv)
    velocity : False where the force does not depend on v, which is then 0: less work
    options : of Law, such as odd=True
    """
    import importlib

    numba: Any = importlib.import_module("numba")
    types, carray, intrinsic = numba.types, numba.carray, importlib.import_module("numba.extending").intrinsic

    fields: list[Any] = [(field[0], types.int32 if field[1] is ctypes.c_int else types.intp) for field in LawSamples._fields_]
    record = types.Record.make_c_struct(fields)

    @intrinsic  # type: ignore[untyped-decorator]
    def numbers_at(typing: Any, address: Any) -> Any:
        pointer = types.CPointer(types.float64)
        return pointer(types.intp), lambda context, builder, signature, a: builder.inttoptr(a[0], context.get_value_type(pointer))

    force, slopes = numba.njit(force), numba.njit(slopes)

    @numba.cfunc(types.int32(types.CPointer(record)))  # type: ignore[untyped-decorator]
    def evaluate(pointer: Any) -> int:
        s = carray(pointer, 1)[0]
        n = s.n_samples
        z, f, p = carray(numbers_at(s.z), n), carray(numbers_at(s.f), n), carray(numbers_at(s.parameters), s.n_parameters)
        if velocity:
            v = carray(numbers_at(s.v), n)
            for i in range(n):
                f[i] = force(z[i], v[i], p)
        else:
            for i in range(n):
                f[i] = force(z[i], 0.0, p)
        if s.df_dz != 0:
            by_z = carray(numbers_at(s.df_dz), n)
            if velocity:
                v, by_v = carray(numbers_at(s.v), n), carray(numbers_at(s.df_dv), n)
                for i in range(n):
                    by_z[i], by_v[i] = slopes(z[i], v[i], p)
            else:
                for i in range(n):
                    by_z[i] = slopes(z[i], 0.0, p)[0]
        return 0

    return Law(evaluate, velocity=velocity, **options)
