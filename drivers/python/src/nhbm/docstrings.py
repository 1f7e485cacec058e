"""Parameters that several methods have in common are described once."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable
from typing import TypeVar

_Function = TypeVar("_Function", bound=Callable[..., object])
_SHARED = {
    "tolerance and order": """\
tolerance : float, optional
    Relative error of the motion; the harmonics are chosen accordingly. 1e-2 if neither this nor `order` is given.
order : int, optional
    Highest order of the harmonics; instead of a tolerance, not in addition.""",
    "warm": """\
warm : bool
    Start from the last motion.""",
}


def documented(function: _Function) -> _Function:
    """Replaces ``{warm}`` and ``{tolerance and order}`` in a docstring by the shared words."""
    function.__doc__ = re.sub(
        r"^( *)\{([a-z ]+)\}$",
        lambda found: textwrap.indent(_SHARED[found[2]], found[1]),
        function.__doc__ or "",
        flags=re.MULTILINE,
    )
    return function
