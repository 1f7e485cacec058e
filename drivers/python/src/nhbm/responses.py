"""Names of responses, "x1", "x1 (1)", "max x1", and their values for the motion that a session has found last. With an asterisk, as
in "x* (1)", a response is the largest of all degrees of freedom whose names match."""

from __future__ import annotations

import fnmatch
import math
import re
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from nhbm.errors import ModelError

if TYPE_CHECKING:
    from nhbm.session import Session

_LARGEST = "max "
_MOST_PLACES = 100  # that a session remembers


def response_of(session: Session, of: str) -> float:
    """A response of the motion found last: "x1", the root mean square of what oscillates, or "x1 (1)", the amplitude of a
    harmonic; NaN if its set does not have this harmonic."""
    if is_pattern(_text_of(of)):
        return max(response_of(session, one) for one in _each(session, of))
    tuples = session.column("tuples").values
    i_dof, harmonics = _places_of(session, of, tuples)
    pairs = session.column("coefficients").values[i_dof, harmonics].ravel().tolist()
    is_total = parts_of(of)[1] is None  # root mean square of all that oscillates, which may be nothing
    if not (pairs or is_total):
        return float("nan")
    return math.sqrt(sum(value * value for value in pairs) / (2.0 if is_total else 1.0))


def _places_of(session: Session, of: str, tuples: np.ndarray[Any, Any]) -> tuple[int, list[int]]:
    """Degree of freedom and harmonics of a response among those of a motion; found once for an input and its sets."""
    key = of, tuples.shape, tuples.tobytes()
    found: tuple[int, list[int]] | None = session.places.get(key)
    if found is not None:
        return found
    dof, wanted = parts_of(of)
    i_dof = _index(session, of, dof)
    if wanted is None:
        counts = tuples.any(axis=1)
    elif len(wanted) != tuples.shape[1]:
        raise ModelError(f"'{of}' has a tuple of {len(wanted)}; it needs {tuples.shape[1]}, a whole number for each tone")
    else:
        # not ==, in which NumPy takes a KeyboardInterrupt during the conversion of `wanted` for a comparison that is false
        counts = np.equal(tuples, wanted).all(axis=1) | np.equal(tuples, np.negative(wanted)).all(axis=1)
    if len(session.places) >= _MOST_PLACES:
        session.places.clear()
    session.places[key] = found = i_dof, np.flatnonzero(counts).tolist()
    return found


def required_response_of(session: Session, of: str) -> float:
    """That response; ModelError for a harmonic that is not in the set."""
    value = response_of(session, of)
    if np.isnan(value):
        raise ModelError(absence_of(session, of))
    return value


def absence_of(session: Session, of: str) -> str:
    """Why a motion has no such response."""
    highest = int(np.abs(session.column("tuples").values).max())
    _, wanted = parts_of(of)
    why = f"the highest entry is {highest}"
    if wanted is not None and max(map(abs, wanted)) <= highest:
        why = "it is below what the tolerance needs, or zero, as even ones of odd motions are; give an order to have its value"
    return f"'{of}': the set of harmonics does not have this tuple; {why}"


def gradient_of(session: Session, of: str) -> np.ndarray[Any, Any]:
    """Derivatives of that response by the values of the group &gradient; NaN where they are not known."""
    try:
        alone = session.column("response_gradient").values
        return np.full(len(session.labels("gradient_value")), np.nan) if alone is None else alone.copy()
    except KeyError:
        pass  # those of all coefficients are known
    dof, wanted = parts_of(of)
    if is_pattern(dof):
        return gradient_of(session, max(_each(session, of), key=lambda one: response_of(session, one)))
    i_dof, by = _index(session, of, dof), session.column("gradient").values
    if by is None:
        return np.full(len(session.labels("gradient_value")), np.nan)
    motion, tuples = session.column("coefficients").values[i_dof], session.column("tuples").values
    size = response_of(session, of)
    if wanted is None:
        counts, size = tuples.any(axis=1), 2 * size
    else:
        counts = np.equal(tuples, wanted).all(axis=1) | np.equal(tuples, np.negative(wanted)).all(axis=1)
    slopes: np.ndarray[Any, Any] = (by[:, i_dof] * motion)[:, counts].sum(axis=(1, 2)) / (size or np.nan)
    return slopes


def is_pattern(dof: str) -> bool:
    """Whether a name stands for all degrees of freedom that match it."""
    return "*" in dof


def matches(dof: str, labels: Sequence[str]) -> list[str]:
    """The labels that a pattern stands for; ModelError if there are none."""
    found = fnmatch.filter(labels, dof.replace("[", "[[]"))
    if not found:
        raise ModelError(f"no degree of freedom matches '{dof}'; known: {', '.join(labels)}")
    return found


def _each(session: Session, of: str) -> list[str]:
    """The responses of a pattern."""
    dof, _ = parts_of(of)
    return [of.replace(dof, one, 1) for one in matches(dof, session.labels("dof"))]


def _index(session: Session, of: str, dof: str) -> int:
    """Position of a degree of freedom, by its label or by its set."""
    labels = session.labels("dof")
    label = session.dofs_of_sets.get(dof, dof)
    if label not in labels:
        known = ", ".join([*labels, *session.dofs_of_sets])
        raise ModelError(f"'{of}' is not a response: there is no degree of freedom '{dof}'; known: {known}")
    return labels.index(label)


def parts_of(of: str) -> tuple[str, tuple[int, ...] | None]:
    """Degree of freedom and tuple of a response: "x1", "x1 (1)", "v3 (1,0)"."""
    parts = re.fullmatch(r"\s*([^()]*[^()\s])\s*(?:\(\s*([-+]?\d+(?:\s*,\s*[-+]?\d+)*)\s*\))?\s*", _text_of(of))
    if parts is None:
        raise ModelError(f"'{of}' is not a response; 'x1', 'x1 (1)' and 'x1 (1,0)' are")
    return parts[1], tuple(map(int, parts[2].split(","))) if parts[2] else None


def largest_of(of: str) -> str | None:
    """The degree of freedom of "max x1", its largest displacement, which is not a response of the input; None for others."""
    text = _text_of(of).strip()
    return text[len(_LARGEST) :].strip() if text.startswith(_LARGEST) else None


def responses_in(given: Any, key: str) -> list[str]:
    """The responses of a key of an input; ModelError for what is no text, which the input would take for a degree of freedom."""
    several = [given] if isinstance(given, str) or not isinstance(given, Iterable) else list(given)
    return [_text_of(one, f"{key}: ") for one in several if given is not None]


def _text_of(of: Any, place: str = "") -> str:
    if not isinstance(of, str):
        raise ModelError(f"{place}a response is a text such as 'x1', 'x1 (1)' or 'x1 (1,0)', not {of!r}")
    return of


def reject_largest(*responses: Any) -> None:
    """Raises ModelError for a largest displacement where a response of the input is needed."""
    for of in responses:
        if isinstance(of, str) and largest_of(of) is not None:
            raise ModelError(f"'{of}' is a response of datasets, dataset.nhbm.response('{of}'); here 'x1' (root mean square) or "
                             "'x1 (1)' (amplitude of a harmonic)")  # fmt: skip


def words_of(of: str) -> str:
    """A response of a motion in words, as axes have it."""
    dof = largest_of(of)
    if is_pattern(dof or of):
        return f"Largest of {of}"
    if dof is not None:
        return f"Largest displacement |{dof}|"
    dof, tuple_ = parts_of(of)
    if tuple_ is None:
        return f"Root mean square of {dof}"
    return f"Amplitude of {dof}, {words_of_tuple(tuple_)}"


def words_of_tuple(wanted: Sequence[int]) -> str:
    """A tuple in words: harmonic 3, tuple (1, 0)."""
    return f"harmonic {wanted[0]}" if len(wanted) == 1 else f"tuple ({', '.join(map(str, wanted))})"
