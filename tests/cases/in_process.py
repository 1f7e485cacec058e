"""The shared library under test, and common parts of its tests from Python: a Duffing oscillator, sessions, comparison of
columns."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

LIBRARY = Path(os.environ["NHBM"]).resolve().parents[1] / "lib" / "libnhbm.so"
if not LIBRARY.is_file():
    pytest.skip("the shared library was not built", allow_module_level=True)
os.environ["NHBM_LIBRARY"] = str(LIBRARY)

import nhbm  # noqa: E402
from nhbm import Model, Session  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
INCLUDES = [f"-I{ROOT / 'src' / folder}" for folder in ("api", "laws")]
DUFFING = """&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0
   ground_stiffness = 1.0, damping_mass = 0.1 /
&tones frequency = 0.9 /
&load dof = 'x1', tuple = 1, cos = 0.3 /
&law type = 'cubic_spring', label = 'spring', dof = 'x1', stiffness = 0.5 /
"""
STOP = DUFFING.replace("type = 'cubic_spring'", "type = 'elastic_stop', gap = 0.2").replace("= 0.5 /", "= 20.0 /")
FRICTION = (  # under a load that makes it slip and stick
    "&structure type = 'chain', n_masses = 1, ends = 'free', mass = 1.0, coupling_stiffness = 0.0, "
    "ground_stiffness = 1.0, damping_mass = 0.05 /\n"
    "&tones frequency = 1.1 /\n&harmonics order = 15 /\n&load dof = 'x1', tuple = 1, cos = 0.5 /\n"
)


def session_of(text):
    session = Session()
    session.read(text)
    return session


def same(ours, stored, name):
    """Whether a column has the bits of a row of a file, which is padded if points have their own sets."""
    stored = stored[tuple(slice(n) for n in np.shape(ours))] if np.ndim(ours) else stored
    assert np.array_equal(ours, stored, equal_nan=True), name


def duffing(**spring):
    model = Model(
        nhbm.Chain(n_masses=1, ends="free", mass=1.0, coupling_stiffness=0.0, ground_stiffness=1.0, damping_mass=0.1), tones=[0.9]
    )
    model.load("x1", 1, cos=0.3)
    if not spring:
        model.law("cubic_spring", "x1", label="spring", stiffness=0.5)
    return model


def cubic(q):
    return 0.5 * q**3


def shaft(diameter):
    rotor = nhbm.Rotor()
    rotor.shaft(np.linspace(0.0, 1.0, 4), diameter)
    return rotor


def stopped():
    model = duffing(spring=True)
    model.law("elastic_stop", "x1", stiffness=20.0, gap=0.2)
    return model
